"""The distribution of loop times, with the policies' deadlines on it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from qocjax.figures.style import POLICIES
from qocjax.report.charts import axis, layout
from qocjax.report.html import escape, number
from qocjax.report.labels import MARKERS, RELIABILITY, symbol

__all__ = ["delay_chart", "delay_facts"]

_PERCENTILES = (0.5, 0.95, 0.99)


def delay_chart(deadlines: np.ndarray, reliability: np.ndarray, policies: pd.DataFrame) -> dict[str, Any]:
    """F(Δ) with each policy's choices.

    Args:
        deadlines: Where it is known, ascending (s).
        reliability: F there.
        policies: Table of the study.
    """
    curve = {
        "type": "scatter", "mode": "lines", "x": 1e3 * deadlines, "y": reliability, "uid": "ink", "line": {"width": 2},
        "customdata": [[number(1e3 * at), number(share, ".4f")] for at, share in zip(deadlines, reliability,
                                                                                     strict=True)],
        "hovertemplate": "Δ = %{customdata[0]} ms<br><i>F</i>(Δ) = %{customdata[1]}<extra></extra>",
    }  # fmt: skip
    marks = [_marks(name, rows) for name, rows in policies[policies["qoc"].notna()].groupby("policy", sort=False)]
    y = axis(RELIABILITY, range=[-0.02, 1.04], tickformat=".0%", dtick=0.2)
    return {"data": [curve, *marks],
            "layout": layout(xaxis=axis("Loop time, or deadline Δ (ms)"), yaxis=y, hovermode="closest",
                             margin={"l": 62, "r": 14, "t": 14, "b": 48})}  # fmt: skip


def delay_facts(deadlines: np.ndarray, reliability: np.ndarray) -> dict[str, str]:
    """Percentiles of the loop time as far as the axis goes."""
    found = {}
    for level in _PERCENTILES:
        reached = np.flatnonzero(reliability >= level)
        text = f"&gt; {number(1e3 * deadlines[-1])} ms"
        if reached.size and reached[0] > 0:
            ends = slice(reached[0] - 1, reached[0] + 1)
            text = f"{number(1e3 * float(np.interp(level, reliability[ends], deadlines[ends])), '.3g')} ms"
        elif reached.size:
            text = f"≤ {number(1e3 * deadlines[0])} ms"
        found[f"{level:.0%} of the loops within"] = text
    return found


def _marks(name: Any, rows: pd.DataFrame) -> dict[str, Any]:
    """One policy's deadlines; where sweeps agree, one mark that names them."""
    look = POLICIES.get(name)
    at = rows.groupby("deadline").agg(share=("reliability", "first"), sweeps=("sweep", list)).reset_index()
    texts = [[number(1e3 * row.deadline), number(row.share, ".4f"), ", ".join(symbol(each) for each in row.sweeps)]
             for row in at.itertuples()]  # fmt: skip
    return {
        "type": "scatter", "mode": "markers", "x": 1e3 * at["deadline"].to_numpy(), "y": at["share"].to_numpy(),
        "marker": {"symbol": MARKERS.get(name, "diamond"), "size": 15 if name == "Co-design" else 12,
                   "color": look.colour if look else "#777777", "line": {"width": 1.2, "color": "#000000"}},
        "customdata": texts, "uid": f"mark{MARKERS.get(name, 'other')}", "cliponaxis": False,
        "hovertemplate": f"<b>{escape(name)}</b><br>Δ = %{{customdata[0]}} ms, <i>F</i>(Δ) = %{{customdata[1]}}<br>"
                         "sweeps of %{customdata[2]}<extra></extra>",
    }  # fmt: skip
