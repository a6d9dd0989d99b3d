"""`nav2=FILE` on a command line: options that follow from a parameter file, ahead of what is given by hand."""

from __future__ import annotations

from collections.abc import Sequence

from qocjax.nav2.options import stack_options, to_options
from qocjax.nav2.read import read_params

__all__ = ["with_nav2"]


def with_nav2(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """The arguments with those that `nav2=FILE` stands for in front, so that others win; and what to tell.

    The controller's own values are taken only with `controller=navigation`.

    Raises:
        ValueError: There is no such file, or ROS's parser would refuse it.
        OSError: It cannot be read.
    """
    files = [each.partition("=")[2].strip("\"'") for each in arguments if each.startswith("nav2=")]
    if not files or files[-1] in ("", "null"):
        return list(arguments), []
    params = read_params(files[-1])
    options: dict[str, float | None] = dict(to_options(params))
    if "controller=navigation" in arguments:
        options |= stack_options(params)
    given = [_override(name, value) for name, value in options.items()]
    notes = [f"{files[-1]} sets {', '.join(each.lstrip('+') for each in given) or 'nothing that is simulated'}"]
    notes += [f"{files[-1]}: left alone: {each}" for each in params.unknown]
    return [*given, *arguments], notes + [str(each) for each in params.remarks]


def _override(name: str, value: float | None) -> str:
    """As Hydra takes it: a critic's parameter need not be in the configuration, and one that is not there goes."""
    if value is None:
        return f"~{name}"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return f"{'++' if '.critics.' in name else ''}{name}={text}"
