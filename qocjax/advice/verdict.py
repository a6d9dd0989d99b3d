"""What is said of a design in a word: may it be recommended, may it stay, which policy does it amount to."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qocjax.advice.margins import Margin

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ANSWERS", "VERDICTS", "answer_of", "policy_of", "verdict_of"]

VERDICTS = ("recommended", "not shown", "unsafe")
"""Of a design: it keeps the limit on collisions; fresh seeds do not show that it does; they show that it does not."""

ANSWERS = ("yes", "yes: hardly matters", "no: target", "no: collisions", "not shown")
"""Whether what one has may stay; hardly matters: only because what it loses is little (`little_of`)."""


def verdict_of(safe: bool, row: pd.Series, limit: float) -> str:
    """Whether a choice that kept the limit keeps it on fresh seeds, even at the upper end of its collision share."""
    if safe and row["collision_high"] <= limit:
        return "recommended"
    return "unsafe" if row["collision_low"] > limit else "not shown"


def answer_of(row: pd.Series, margin: Margin, limit: float) -> str:
    """Whether the current design may stay: within the margin of its target, and within the limit on collisions."""
    if row["collision_low"] > limit:
        return "no: collisions"
    if not margin.holds(float(row["deadline"])):
        return "no: target"
    if row["collision_high"] > limit:
        return "not shown"
    target = margin.target
    eased = target.little is not None and row["qoc"] < target.value * margin.merit.mean
    return "yes: hardly matters" if eased else "yes"


def policy_of(deadline: float, margin: Margin) -> str:
    """Which policy a deadline amounts to: within the margin of its gains Co-design, before MinDelay, after MaxRel."""
    low, high = margin.ends
    if deadline < low * (1 - 1e-9):
        return "MinDelay"
    return "MaxRel" if deadline > high * (1 + 1e-9) else "Co-design"
