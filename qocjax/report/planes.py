"""QoC over two parameters at once, the deadline by a slider: the chart of a sweep of several parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from qocjax.figures.joint_map import plane_at
from qocjax.report.charts import axis, colour_scale, layout
from qocjax.report.html import number
from qocjax.report.labels import MARKERS, label, symbol, value_text, values_words
from qocjax.study.axes import axes_of

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["best_chart", "plane_chart"]


def plane_chart(results: pd.DataFrame, policies: pd.DataFrame, sweep: str) -> dict[str, Any]:
    """Heat maps of QoC over the first two parameters of a sweep, one for each deadline, of which a slider shows one.

    Of further parameters each cell takes the values that are best there.

    Args:
        results: Table of the study, with a column for each parameter.
        policies: Table of its policies.
        sweep: Names of the parameters, separated by commas.
    """
    rows, first = results[results["sweep"] == sweep], axes_of(sweep)[:2]
    axes = (first[0], first[1])
    deadlines = np.unique(rows["deadline"])
    chosen = policies[(policies["sweep"] == sweep) & policies["qoc"].notna()].to_dict("records")
    begin = int(np.argmin(np.abs(deadlines - (chosen[0]["deadline"] if chosen else deadlines[0]))))
    across, up = (np.unique(rows[name]) for name in reversed(axes))
    ends = (float(rows["qoc"].min()), float(rows["qoc"].max()))
    heats = [_heat(rows, axes, float(deadline), ends) | {"visible": k == begin} for k, deadline in enumerate(deadlines)]
    marks = [_mark(row, axes, up, across, deadlines) for row in chosen]
    steps = [{
        "label": number(1e3 * deadline), "method": "restyle",
        "args": ["visible", [*(k == j for j in range(deadlines.size)), *(place == k for place, _ in marks)]],
    } for k, deadline in enumerate(deadlines)]  # fmt: skip
    data = [*heats, *(trace | {"visible": place == begin} for place, trace in marks)]
    slider = {"active": begin, "steps": steps, "pad": {"t": 44, "b": 4}, "ticklen": 3, "minorticklen": 0,
              "currentvalue": {"prefix": "Δ = ", "suffix": " ms"}}  # fmt: skip
    return {
        "data": data,
        "layout": layout(
            xaxis=axis(label(axes[1]), tickvals=list(range(across.size)), ticks="",
                       ticktext=[value_text(axes[1], value) for value in across]),
            yaxis=axis(label(axes[0]), tickvals=list(range(up.size)), ticks="",
                       ticktext=[value_text(axes[0], value) for value in up]),
            sliders=[slider], margin={"l": 62, "r": 10, "t": 20, "b": 100},
        ),
    }  # fmt: skip


def best_chart(results: pd.DataFrame, sweep: str) -> dict[str, Any]:
    """QoC of the best combination at each deadline, with one standard error, and which it is."""
    rows, axes = results[results["sweep"] == sweep], axes_of(sweep)
    best = rows.loc[rows.groupby("deadline")["qoc"].idxmax().dropna()].sort_values("deadline")
    words = [values_words({name: row[name] for name in axes}) for row in best.to_dict("records")]
    line = {
        "type": "scatter", "mode": "lines+markers", "x": 1e3 * best["deadline"].to_numpy(), "y": best["qoc"].to_numpy(),
        "error_y": {"type": "data", "array": np.nan_to_num(best["qoc_se"].to_numpy(), posinf=0.0), "thickness": 1},
        "customdata": words, "line": {"width": 2}, "marker": {"size": 5},
        "hovertemplate": "Δ = %{x:g} ms: %{customdata}<br>QoC %{y:.4f}<extra></extra>",
    }  # fmt: skip
    return {"data": [line], "layout": layout(xaxis=axis("Deadline Δ (ms)"), yaxis=axis("QoC of the best combination"),
                                             hovermode="closest")}  # fmt: skip


def _heat(rows: pd.DataFrame, axes: tuple[str, str], deadline: float, ends: tuple[float, float]) -> dict[str, Any]:
    plane = plane_at(rows, axes, deadline)
    names = [symbol(axes[0]), symbol(axes[1])]
    texts = [[[value_text(axes[0], y, with_unit=True), value_text(axes[1], x, with_unit=True)] for x in plane.columns]
             for y in plane.index]  # fmt: skip
    return {
        "type": "heatmap", "x": list(range(plane.shape[1])), "y": list(range(plane.shape[0])), "z": plane.to_numpy(),
        "colorscale": colour_scale(), "zmin": ends[0], "zmax": ends[1], "customdata": texts,
        "colorbar": {"title": {"text": "QoC", "side": "right"}, "thickness": 12, "outlinewidth": 0, "ticks": "outside",
                     "ticklen": 3},
        "hovertemplate": f"{names[0]} = %{{customdata[0]}}, {names[1]} = %{{customdata[1]}}<br>"
                         f"Δ = {number(1e3 * deadline)} ms: QoC %{{z:.4f}}<extra></extra>",
    }  # fmt: skip


def _mark(
    row: dict[str, Any], axes: tuple[str, str], up: np.ndarray, across: np.ndarray, deadlines: np.ndarray
) -> tuple[int, dict[str, Any]]:
    """The place of a policy's deadline, and its mark in that map."""
    y, x = (int(np.argmin(np.abs(values - row[name]))) for name, values in zip(axes, (up, across), strict=True))
    look = {"symbol": MARKERS.get(row["policy"], "diamond"), "size": 13, "color": "rgba(255,255,255,0.75)",
            "line": {"width": 2, "color": "#000000"}}  # fmt: skip
    trace = {"type": "scatter", "mode": "markers", "x": [x], "y": [y], "marker": look, "hoverinfo": "skip"}
    return int(np.argmin(np.abs(deadlines - row["deadline"]))), trace
