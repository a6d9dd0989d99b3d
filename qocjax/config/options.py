"""Numbers of a configuration by their names: read, and set to others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import ValidationError

from qocjax.config.part import Part, line_of

__all__ = ["PARTS", "flat", "number_at", "with_numbers"]

PARTS = ("robot", "controller", "loop", "scenario", "network")  # what runs depend on

C = TypeVar("C", bound=Part)


def flat(values: Any, prefix: str = "") -> Any:
    """Nested mappings as one with dotted names; what is none is left to be refused where its type is checked."""
    if not isinstance(values, Mapping):
        return values
    found: dict[str, Any] = {}
    for name, value in values.items():
        found |= flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return found


def number_at(config: Part, name: str) -> float:
    """The number of an option, such as `controller.mppi.temperature`.

    Raises:
        ValueError: There is none of that name, or it is no number.
    """
    part, *path = name.split(".")
    here: Any = getattr(config, part, None) if part in PARTS else None
    for step in path:
        if isinstance(here, Mapping):
            here = here.get(step)
        else:
            here = getattr(here, step, None)
    if isinstance(here, bool) or not isinstance(here, (int, float)):
        got = "no number" if here is None or isinstance(here, (Part, Mapping)) else repr(here)
        raise ValueError(f"{name}: got {got}, expected an option of {', '.join(PARTS)} that is set to a number, as by "
                         f"{name}=1.0 beside it")  # fmt: skip
    return float(here)


def with_numbers(config: C, values: Mapping[str, float]) -> C:
    """The configuration with numbers in place of its own, checked as one that was given.

    Raises:
        ValueError: A number is none that the option takes; the message names it.
    """
    raw = config.model_dump()
    for name, value in values.items():
        *path, last = name.split(".")
        here = raw
        for step in path:
            here = here[step]
        whole = isinstance(here[last], int) and float(value).is_integer()
        here[last] = int(value) if whole else float(value)
    try:
        return type(config).model_validate(raw)
    except ValidationError as error:
        raise ValueError("; ".join(line_of(item, raw) for item in error.errors())) from None
