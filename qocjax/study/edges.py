"""Choices at the end of what was tried: the best may lie beyond."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

__all__ = ["edges_of", "edges_text"]


def edges_of(rows: pd.DataFrame, choice: Mapping[str, Any] | pd.Series, policy: str) -> str:
    """Which ends of its grid a choice lies at, such as `largest kappa, smallest deadline`; empty for none.

    Args:
        rows: The results of its sweep.
        choice: Its value and deadline, NaN for none.
        policy: MinDelay and MaxRel take an end of the deadlines by their rule, which says nothing.
    """
    axes = {str(rows["sweep"].iloc[0]): "value"} | ({"deadline": "deadline"} if policy == "Co-design" else {})
    found = []
    for name, column in axes.items():
        low, high = rows[column].min(), rows[column].max()
        if low < high and np.isfinite(choice[column]) and choice[column] in (low, high):
            found.append(f"{'smallest' if choice[column] == low else 'largest'} {name}")
    return ", ".join(found)


def edges_text(policies: pd.DataFrame) -> str:
    """The choices at an end in a sentence; empty where there is none."""
    at: dict[str, list[str]] = {}
    for row in policies.to_dict("records"):
        for end in filter(None, row["at_edge"].split(", ")):
            name = end if end.endswith(f" {row['sweep']}") else f"{end} in {row['sweep']}"
            at.setdefault(name, []).append(row["policy"])
    ends = "; ".join(f"{end} ({', '.join(names)})" for end, names in at.items())
    return f"at an end of what was tried, the best may lie beyond: {ends}" if ends else ""
