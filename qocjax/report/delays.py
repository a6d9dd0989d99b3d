"""The distribution of loop times, with the policies' deadlines on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from qocjax.figures.style import POLICIES
from qocjax.network.interface import Reliability
from qocjax.report.charts import axis, layout
from qocjax.report.html import escape, number
from qocjax.report.labels import MARKERS, RELIABILITY, symbol
from qocjax.study.reliability import share_text

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Completion", "completion_words", "delay_chart", "delay_facts", "late_chart"]

_RAREST = 1e-6  # share of loops; below it is the rounding of F
_LATE = "Loops that take longer, 1 − <i>F</i>(Δ)"
_PERCENTILES = (0.5, 0.95, 0.99)


@dataclass(frozen=True)
class Completion:
    """How many loops complete at one sampling period."""

    tau: float  # s
    deadlines: np.ndarray  # s, ascending
    reliability: Reliability  # F there


def delay_chart(completion: Sequence[Completion], policies: pd.DataFrame) -> dict[str, Any]:
    """F(Δ) with each policy's choices.

    Args:
        completion: At each sampling period at which F is another, the usual one first.
        policies: Table of the study.
    """
    curves = [_curve(each, k == 0, len(completion) > 1) for k, each in enumerate(completion)]
    marks = [_marks(name, rows) for name, rows in policies[policies["qoc"].notna()].groupby("policy", sort=False)]
    y = axis(RELIABILITY, range=[-0.02, 1.04], tickformat=".0%", dtick=0.2)
    return {"data": [*reversed(curves), *marks],
            "layout": layout(xaxis=axis("Loop time, or deadline Δ (ms)"), yaxis=y, hovermode="closest",
                             margin={"l": 62, "r": 14, "t": 14, "b": 48})}  # fmt: skip


def late_chart(completion: Sequence[Completion], policies: pd.DataFrame) -> dict[str, Any]:
    """The share of loops that take longer than a deadline, 1 - F(Δ), on a logarithmic axis: the tail of the delay.

    Args:
        completion: As of `delay_chart`.
        policies: Table of the study; a choice that no loop misses has no mark.
    """
    chart = delay_chart(completion, policies)
    rarest = 1.0
    for trace in chart["data"]:
        later = 1.0 - np.asarray(trace["y"], float)
        seen = later > _RAREST
        rarest = min(rarest, later[seen].min(initial=1.0))
        trace["y"] = [float(each) if known else None for each, known in zip(later, seen, strict=True)]
    low = float(np.log10(0.7 * rarest))
    chart["layout"]["yaxis"] = axis(_LATE, type="log", range=[low, 0.06], tickformat="~g")
    return chart


def completion_words(completion: Sequence[Completion]) -> str:
    """What a reader must know of F besides the curve."""
    words = ""
    if len(completion) > 1:
        words += (f" It depends on τ: the thick line is that of {number(1e3 * completion[0].tau)} ms, the thin ones "
                  "are the other sampling periods of the study.")  # fmt: skip
    if completion[0].reliability.error.max(initial=0.0) > 0:
        words += " It is estimated by simulating the network alone; the standard error stands beside each number."
    return words


def delay_facts(completion: Completion) -> dict[str, str]:
    """Percentiles of the loop time as far as the axis goes."""
    deadlines, reliability = completion.deadlines, completion.reliability.share
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


def _curve(completion: Completion, usual: bool, named: bool) -> dict[str, Any]:
    share, error = completion.reliability
    texts = [[number(1e3 * at), share_text(one, spread, 4)]
             for at, one, spread in zip(completion.deadlines, share, error, strict=True)]  # fmt: skip
    tau = f"<br>τ = {number(1e3 * completion.tau)} ms" if named else ""
    return {
        "type": "scatter", "mode": "lines", "x": 1e3 * completion.deadlines, "y": share, "uid": "ink",
        "line": {"width": 2 if usual else 0.7}, "customdata": texts,
        "hovertemplate": f"Δ = %{{customdata[0]}} ms<br><i>F</i>(Δ) = %{{customdata[1]}}{tau}<extra></extra>",
    }  # fmt: skip


def _marks(name: Any, rows: pd.DataFrame) -> dict[str, Any]:
    """One policy's deadlines; where sweeps agree, one mark that names them."""
    look = POLICIES.get(name)
    same = ["deadline", "reliability", "reliability_se"]
    at = rows.groupby(same).agg(sweeps=("sweep", list)).reset_index().rename(columns={"reliability": "share"})
    texts = [
        [number(1e3 * row.deadline), share_text(row.share, row.reliability_se, 4), ", ".join(map(symbol, row.sweeps))]
        for row in at.itertuples()
    ]
    return {
        "type": "scatter", "mode": "markers", "x": 1e3 * at["deadline"].to_numpy(), "y": at["share"].to_numpy(),
        "marker": {"symbol": MARKERS.get(name, "diamond"), "size": 15 if name == "Co-design" else 12,
                   "color": look.colour if look else "#777777", "line": {"width": 1.2, "color": "#000000"}},
        "customdata": texts, "uid": f"mark{MARKERS.get(name, 'other')}", "cliponaxis": False,
        "hovertemplate": f"<b>{escape(name)}</b><br>Δ = %{{customdata[0]}} ms, <i>F</i>(Δ) = %{{customdata[1]}}<br>"
                         "sweeps of %{customdata[2]}<extra></extra>",
    }  # fmt: skip
