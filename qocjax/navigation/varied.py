"""The stack with some of its numbers as arrays: what a design varies, in one compiled program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from jax import Array

from qocjax.navigation.stack_parts import StackParts

__all__ = ["value_at", "varied"]

_PART = "controller."  # what names of the stack's parameters begin with in a design

T = TypeVar("T", bound=StackParts)


def varied(stack: T, values: Mapping[str, Array]) -> T:
    """The stack with these values in place of its own; what is made of its map is kept.

    Args:
        stack: The stack.
        values: By name in the configuration, such as `controller.mppi.critics.CostCritic.cost_weight`.
    """
    if not values:
        return stack
    kept: dict[str, Any] = {"static": stack.static}
    if not any(name.removeprefix(_PART).startswith("inflation.") for name in values):
        kept["closed"] = stack.closed
    for name, value in values.items():
        stack = _with(stack, name.removeprefix(_PART).split("."), value)
    vars(stack).update(kept)
    return stack


def value_at(part: Any, name: str) -> Any:
    """A value of the stack by its name.

    Raises:
        AttributeError: There is none.
    """
    for step in name.removeprefix(_PART).split("."):
        part = _critic(part, step) if isinstance(part, tuple) else getattr(part, step)
    return part


def _with(part: Any, path: Sequence[str], value: Any) -> Any:
    """A part with a value at a path; in a tuple of critics a step is the name of one."""
    if not path:
        return value
    if isinstance(part, tuple):
        chosen = _critic(part, path[0])
        return tuple(_with(each, path[1:], value) if each is chosen else each for each in part)
    return replace(part, **{path[0]: _with(getattr(part, path[0]), path[1:], value)})


def _critic(critics: Sequence[Any], name: str) -> Any:
    found = next((each for each in critics if type(each).__name__ == name), None)
    if found is None:
        raise AttributeError(f"{name}: got a critic that is not used, expected one of "
                             f"{', '.join(type(each).__name__ for each in critics)}")  # fmt: skip
    return found
