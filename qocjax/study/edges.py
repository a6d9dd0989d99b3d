"""Choices at the end of what was tried: the best may lie beyond."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from qocjax.study.axes import axes_of, is_joint

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["at_bounds", "bounds_text", "edges_of", "edges_text"]

_CLOSE = 0.05  # of a range in its own scale; so near to its end is at its end
_TINY = 0.01  # of a range in linear scale, as of a gain that may as well be 0


def edges_of(rows: pd.DataFrame, choice: Mapping[str, Any] | pd.Series, policy: str) -> str:
    """Which ends of its grid a choice lies at, such as `largest kappa, smallest deadline`; empty for none.

    Args:
        rows: The results of its sweep.
        choice: Its value and deadline, NaN for none.
        policy: MinDelay and MaxRel take an end of the deadlines by their rule, which says nothing.
    """
    swept = axes_of(str(rows["sweep"].iloc[0]))
    axes = {swept[0]: "value"} if len(swept) == 1 else {name: name for name in swept}
    axes |= {"deadline": "deadline"} if policy == "Co-design" else {}
    found = []
    for name, column in axes.items():
        low, high = rows[column].min(), rows[column].max()
        if low < high and np.isfinite(choice[column]) and choice[column] in (low, high):
            found.append(f"{'smallest' if choice[column] == low else 'largest'} {name}")
    return ", ".join(found)


def at_bounds(
    design: Mapping[str, Any] | pd.Series, bounds: Mapping[str, Sequence[float]], lists: Mapping[str, Sequence[float]]
) -> str:
    """Which ends of what was searched a design lies at, as `edges_of` says it; empty for none.

    Args:
        design: Its values by name.
        bounds: (low, high) of the continuous parameters, in log scale where low is positive.
        lists: The values that others were chosen from; one alone was no choice.
    """
    found = []
    for name, (low, high) in bounds.items():
        linear = share = (design[name] - low) / (high - low)
        if low > 0:
            share = np.log(design[name] / low) / np.log(high / low)
        if min(share, 1.0 - share) <= _CLOSE or min(linear, 1.0 - linear) <= _TINY:
            found.append(f"{'smallest' if share < 0.5 else 'largest'} {name}")
    for name, values in lists.items():
        low, high = min(values), max(values)
        if low < high and (np.isclose(design[name], low) or np.isclose(design[name], high)):
            found.append(f"{'smallest' if np.isclose(design[name], low) else 'largest'} {name}")
    return ", ".join(found)


def bounds_text(at: str) -> str:
    """Ends from `at_bounds` in a sentence; empty where there is none."""
    return f"At a bound of the search, the best may lie beyond: {at}." if at else ""


def edges_text(policies: pd.DataFrame) -> str:
    """The choices at an end in a sentence; empty where there is none."""
    at: dict[str, list[str]] = {}
    for row in policies.to_dict("records"):
        for end in filter(None, row["at_edge"].split(", ")):
            name = f"{end} in {row['sweep']}" if end.endswith(" deadline") or is_joint(row["sweep"]) else end
            at.setdefault(name, []).append(row["policy"])
    ends = "; ".join(f"{end} ({', '.join(names)})" for end, names in at.items())
    return f"at an end of what was tried, the best may lie beyond: {ends}" if ends else ""
