"""Numbers of the page: milliseconds, numbers with their intervals, bounds that end where the search does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from qocjax.advice.advice import Advice
from qocjax.advice.margins import Margin
from qocjax.advice.reaching import Bound
from qocjax.statistics.collisions import is_alone

__all__ = [
    "GAINS",
    "bound_text",
    "collisions_text",
    "ms",
    "percent",
    "safety_of",
    "unless_alone",
    "with_collisions",
    "with_ends",
]

GAINS = ("kappa", "gamma", "eta", "c_miss", "v_max", "omega_max", "d_safe")


def ms(seconds: object) -> str:
    """Milliseconds of a time in seconds."""
    return f"{1e3 * float(np.asarray(seconds)):.4g}"


def percent(value: float, of: float) -> str:
    """By how much a value differs from another."""
    return f"{value / of - 1.0:+.0%}"


def with_ends(row: Mapping[str, Any], name: str, form: str) -> str:
    """A number of a row with its 95 % interval, each in a format."""
    mean, low, high = (format(row[f"{name}{end}"], form) for end in ("", "_low", "_high"))
    return f"{mean} [{low}, {high}]"


def collisions_text(row: Mapping[str, Any]) -> str:
    """The share of runs with a collision with its interval; of one robot no number."""
    if is_alone(row["collision_high"]):
        return "none"
    return f"{row['collision_share']:.1%} [{row['collision_low']:.1%}, {row['collision_high']:.1%}]"


def with_collisions(row: Mapping[str, Any], what: str) -> str:
    """What more to say of a row: its collisions, behind some words; nothing of one robot."""
    return "" if is_alone(row["collision_high"]) else f", {what} {collisions_text(row)}"


def unless_alone(advice: Advice, text: str) -> str:
    """What is to be said of collisions; nothing of one robot."""
    return "" if is_alone(advice.judged["collision_high"].iloc[-1]) else text


def safety_of(advice: Advice, margin: Margin) -> str:
    """Whether collisions keep their limit within a margin; alone, where one robot has nobody to collide with."""
    return "alone" if is_alone(advice.judged["collision_high"].iloc[-1]) else margin.safety


def bound_text(bound: Bound, scale: float = 1e3) -> str:
    """A bound with its interval; what was looked at may end before it."""
    numbers = ["none" if v is None else f"{scale * v:.3g}" for v in (bound.value, bound.low, bound.high)]
    if bound.value is None:
        return "none that was looked at,"
    if bound.at_edge:
        return f"{numbers[0]} (where the search ends)"
    if bound.low == bound.value == bound.high:  # where collisions end it, whose limit is held by their upper end
        return numbers[0]
    ends = [f"{text} or beyond" if end else text
            for text, end in zip(numbers[1:], (bound.low_at_edge, bound.high_at_edge), strict=True)]  # fmt: skip
    return f"{numbers[0]} [{ends[0]}, {ends[1]}]"
