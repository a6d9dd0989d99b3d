"""`nav2=FILE` on a command line: options that follow from a parameter file, ahead of what is given by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import yaml

from qocjax.config.part import conf_dir
from qocjax.config.robots import UNICYCLE
from qocjax.nav2.known import MPPI
from qocjax.nav2.options import NO_HEADING, critics_of, stack_options, to_options
from qocjax.nav2.read import NavParams, read_params

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
    options, ignored = _of_the_robot(to_options(params), arguments)
    stack = "controller=navigation" in arguments
    if stack:
        options |= stack_options(params)
    given = {name: _override(name, value) for name, value in options.items()}
    by_hand = {each.partition("=")[0] for each in arguments}
    sets = ", ".join(text.lstrip("+") for name, text in given.items() if name not in by_hand)
    notes = [f"{files[-1]} sets {sets or 'nothing that is simulated'}"]
    notes += [f"{files[-1]}: left alone: {each}" for each in params.unknown]
    if ignored:
        notes.append(f"{files[-1]}: left alone: {', '.join(ignored)}: this robot obeys commands at once")
    notes += [f"{files[-1]}: {each}" for each in (_on_the_stack(params) if stack else [])]
    return [*given.values(), *arguments], notes + [str(each) for each in params.remarks]


def _of_the_robot(options: Mapping[str, float], arguments: Sequence[str]) -> tuple[dict[str, float | None], list[str]]:
    """Caps and accelerations of a file, but no more than what a robot can do that was named by hand.

    Returns:
        The options, and the names of accelerations that such a robot has no limits for.
    """
    found: dict[str, float | None] = dict(options)
    named = [each.partition("=")[2] for each in arguments if each.startswith("robot=")]
    place = conf_dir() / "robot" / f"{named[-1]}.yaml" if named else None
    if place is None or not place.is_file():
        return found, []
    robot = yaml.safe_load(place.read_text(encoding="utf-8"))
    for name in ("v_max", "omega_max", "ax_max", "ax_min", "az_max"):
        own, given = robot.get(name), options.get(f"robot.{name}")
        if own is not None and given is not None:
            found[f"robot.{name}"] = min(given, own, key=abs)
    if robot.get("_target_", UNICYCLE) == UNICYCLE:
        return found, []
    accelerations = [name for name in found if name.startswith("robot.a")]
    return {name: value for name, value in found.items() if name not in accelerations}, accelerations


def _on_the_stack(params: NavParams) -> list[str]:
    """Where the simulated stack is not the file's controller."""
    first = params.controllers[0] if params.controllers else None
    if first is None or first.kind != MPPI:
        kind = "not known" if first is None else first.kind.rpartition("::")[2]
        return [f"its controller is {kind}; the simulated stack is MPPI, with values of its own"]
    said = [] if critics_of(first) else [f"{first.name} names no critic that is simulated; the stack keeps its own"]
    named = first.values.get("critics")
    if isinstance(named, list) and NO_HEADING in named:
        said.append(f"left alone: {first.name}.{NO_HEADING}: simulated goals have no heading")
    return said


def _override(name: str, value: float | None) -> str:
    """As Hydra takes it: a critic's parameter need not be in the configuration, and one that is not there goes."""
    if value is None:
        return f"~{name}"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return f"{'++' if '.critics.' in name else ''}{name}={text}"
