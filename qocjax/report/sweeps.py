"""QoC over value and deadline, and AUC against the deadline: the charts of each sweep."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from qocjax.figures.colliding import BREAKS, OPEN, collision_cells
from qocjax.figures.tables import baseline_index, grid
from qocjax.report.charts import axis, colour_scale, layout, legend_item, series_uid
from qocjax.report.html import escape, number, percent, plus_minus
from qocjax.report.labels import DEADLINE, MARKERS, label, name_of, symbol, value_cell, value_text
from qocjax.study.reliability import share_text

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["auc_chart", "auc_legend", "qoc_chart"]

_LEVELS = (0.01, 0.5, 0.99)  # of F(Δ), marked at the top
_RELIABLE = 0.5  # F(Δ) from which on the loop works, as in the figures
_CELL = (
    " = %{customdata[0]}<br>Δ = %{customdata[1]} ms, <i>F</i>(Δ) = %{customdata[2]}<br>QoC %{customdata[3]}<br>"
    "AUC %{customdata[4]} s<br>smallest distance %{customdata[5]} m%{customdata[6]}<extra></extra>"
)
_POINT = (
    " = %{customdata[0]}<br>Δ = %{customdata[1]} ms, <i>F</i>(Δ) = %{customdata[2]}<br>AUC %{customdata[4]} s<br>"
    "QoC %{customdata[3]}<extra></extra>"
)

Baseline = Mapping[str, float] | None


def qoc_chart(
    results: pd.DataFrame, policies: pd.DataFrame, sweep: str, limit: float | None = None, baseline: Baseline = None
) -> dict[str, Any]:
    """A heat map of QoC over deadline and value, with the policies' choices, crossed where too many runs collide.

    Args:
        results: Table of the study; colours span all of it, so that its sweeps can be compared.
        policies: Table of its policies.
        sweep: The parameter.
        limit: Largest share of runs with a collision; None crosses nothing.
        baseline: Values by parameter, which are emphasised; those not given are read from the other sweeps.
    """
    rows = results[results["sweep"] == sweep]
    values, deadlines, scores = grid(rows, "qoc")
    places = [value_text(sweep, value) for value in values]
    cells = _cells(rows, sweep, policies)
    heat = {
        "type": "heatmap", "x": 1e3 * deadlines, "y": list(range(values.size)), "z": scores,
        "customdata": [cells[k * deadlines.size : (k + 1) * deadlines.size] for k in range(values.size)],
        "colorscale": colour_scale(), "zmin": float(results["qoc"].min()), "zmax": float(results["qoc"].max()),
        "colorbar": {"title": {"text": "QoC", "side": "right"}, "thickness": 12, "outlinewidth": 0, "len": 1,
                     "ticks": "outside", "ticklen": 3},
        "hovertemplate": symbol(sweep) + _CELL,
    }  # fmt: skip
    base = baseline_index(results, sweep, values, baseline)
    texts = [f"<b>{text}</b>" if k == base else text for k, text in enumerate(places)]
    bottom = axis(DEADLINE, range=_ends(1e3 * deadlines))
    up = axis(
        label(sweep), tickvals=list(range(values.size)), ticktext=texts, ticks="", range=[-0.5, values.size - 0.5]
    )
    share = rows.groupby("deadline")["reliability"].agg(["min", "max", "mean"])
    return {
        "data": [heat, *_crosses(rows, limit), *_choices(policies, sweep, values), *_top(1e3 * deadlines, share)],
        "layout": layout(xaxis=bottom, yaxis=up, xaxis2=_top_axis(1e3 * deadlines, share),
                         margin={"l": 62, "r": 10, "t": 44, "b": 48}),
        "symbol": symbol(sweep),
        "grid": [1e3 * deadlines, list(range(values.size))],
    }  # fmt: skip


def auc_chart(results: pd.DataFrame, sweep: str, baseline: Baseline = None) -> dict[str, Any]:
    """Lines of AUC over the deadline with a band of one standard error, one per value."""
    rows = results[results["sweep"] == sweep]
    values, deadlines, auc = grid(rows, "auc")
    error = np.nan_to_num(grid(rows, "auc_se")[2], nan=0.0, posinf=0.0)
    cells, x = _cells(rows, sweep, None), 1e3 * deadlines
    base = baseline_index(results, sweep, values, baseline)
    traces: list[dict[str, Any]] = []
    for k in range(values.size):
        uid, known = series_uid(k, values.size), np.isfinite(auc[k])
        low, high = np.maximum(auc[k] - error[k], 1e-3 * auc[k])[known], (auc[k] + error[k])[known]
        traces.append({
            "type": "scatter", "mode": "lines", "x": np.concatenate([x[known], x[known][::-1]]),
            "y": np.concatenate([high, low[::-1]]), "fill": "toself", "line": {"width": 0}, "hoverinfo": "skip",
            "fillcolor": "#808080", "uid": uid + "b",
        })  # fmt: skip
        traces.append({
            "type": "scatter", "mode": "lines+markers" if x.size < 12 else "lines", "x": x, "y": auc[k],
            "line": {"width": 3.2 if k == base else 1.6}, "marker": {"size": 5}, "uid": uid,
            "customdata": cells[k * x.size : (k + 1) * x.size], "hovertemplate": symbol(sweep) + _POINT,
        })  # fmt: skip
    return {"data": traces, "layout": layout(xaxis=axis(DEADLINE), yaxis=axis("AUC (s)", **_span(rows)),
                                             hovermode="closest"), "views": _views(rows)}  # fmt: skip


def auc_legend(results: pd.DataFrame, sweep: str, baseline: Baseline = None) -> str:
    """The lines of `auc_chart`, as buttons."""
    values = np.unique(results.loc[results["sweep"] == sweep, "value"])
    base = baseline_index(results, sweep, values, baseline)
    items = [
        legend_item(series_uid(k, values.size),
                    value_text(sweep, value) + (" (baseline)" if k == base else ""), strong=k == base)
        for k, value in enumerate(values)
    ]  # fmt: skip
    head = f'<div class="legend" role="group" aria-label="{name_of(sweep)}"><span>{label(sweep)}</span>'
    return f"{head}{''.join(items)}</div>"


def _cells(rows: pd.DataFrame, sweep: str, policies: pd.DataFrame | None) -> list[list[str]]:
    """What is said of each cell, values and deadlines ascending, in the formats of the policies' table."""
    chosen: dict[tuple[float, float], str] = {}
    if policies is not None:
        for row in policies[policies["sweep"] == sweep].to_dict("records"):
            key = (row["value"], row["deadline"])
            chosen[key] = chosen.get(key, "") + (
                f"<br><b>{escape(row['policy'])}</b>: QoC {plus_minus(row['qoc'], row['qoc_se'])} on fresh seeds"
            )
    found = []
    for row in rows.sort_values(["value", "deadline"]).to_dict("records"):
        notes = chosen.get((row["value"], row["deadline"]), "")
        for column, text in (("collision_share", "closer than two radii"), ("diverged_share", "diverged")):
            if row.get(column, 0) > 0:
                notes = f"<br>{text} in {percent(row[column])} of the runs" + notes
        found.append([
            value_cell(row), number(1e3 * row["deadline"]),
            share_text(row["reliability"], row["reliability_se"]), plus_minus(row["qoc"], row["qoc_se"]),
            plus_minus(row["auc"], row["auc_se"], ".3f"),
            plus_minus(row.get("min_distance", np.nan), row.get("min_distance_se", np.nan), ".3f"), notes,
        ])  # fmt: skip
    return found


def _ends(centres: np.ndarray) -> list[float]:
    """Where the first cell begins and the last one ends: half a step beyond their middles."""
    if centres.size == 1:
        return [float(centres[0]) - 0.5, float(centres[0]) + 0.5]
    return [float(1.5 * centres[0] - 0.5 * centres[1]), float(1.5 * centres[-1] - 0.5 * centres[-2])]


def _crosses(rows: pd.DataFrame, limit: float | None) -> list[dict[str, Any]]:
    """Small crosses on cells that break the limit on collisions for sure, dots where that is open."""
    if limit is None:
        return []
    cells, deadlines, found = collision_cells(rows, limit), np.unique(rows["deadline"]), []
    for kind, mark in ((BREAKS, "x-thin"), (OPEN, "circle")):
        k, at = np.nonzero(cells == kind)
        look = {"symbol": mark, "size": 4 if kind == BREAKS else 2, "color": "#222222",
                "line": {"width": 1, "color": "#222222"}}  # fmt: skip
        found.append({"type": "scatter", "mode": "markers", "x": 1e3 * deadlines[at], "y": k.tolist(), "marker": look,
                      "hoverinfo": "skip"})  # fmt: skip
    return [each for each in found if len(each["y"])]


def _choices(policies: pd.DataFrame, sweep: str, values: np.ndarray) -> list[dict[str, Any]]:
    """Hollow markers with a white rim, to be seen on dark cells, light cells and around one another."""
    traces = []
    for row in policies[(policies["sweep"] == sweep) & policies["qoc"].notna()].to_dict("records"):
        at = {"x": [1e3 * row["deadline"]], "y": [int(np.argmin(np.abs(values - row["value"])))]}
        name = MARKERS.get(row["policy"], "diamond")
        filled = name == "star"
        size = {"star": 11, "circle": 12, "square": 15}.get(name, 12)
        for colour, width in (("#ffffff", 4.5), ("#000000", 1.6)):
            look = {"symbol": name if filled else f"{name}-open", "size": size, "color": colour,
                    "line": {"width": width, "color": colour}}  # fmt: skip
            if filled and colour == "#000000":
                look["color"] = "#ffffff"
            traces.append({"type": "scatter", "mode": "markers", "marker": look, "hoverinfo": "skip",
                           "cliponaxis": False} | at)  # fmt: skip
    return traces


def _top(x: np.ndarray, share: pd.DataFrame) -> list[dict[str, Any]]:
    """An unseen line, without which the axis at the top would not be drawn."""
    if not _crossings(x, share):
        return []
    return [{"type": "scatter", "x": x[[0, -1]], "y": [0, 0], "xaxis": "x2", "opacity": 0, "hoverinfo": "skip",
             "mode": "lines"}]  # fmt: skip


def _top_axis(x: np.ndarray, share: pd.DataFrame) -> dict[str, Any]:
    """Where F(Δ) passes some levels."""
    found = _crossings(x, share)
    return axis("<i>F</i>(Δ)", side="top", overlaying="x", matches="x", tickvals=list(found.values()),
                ticktext=[f"{level:.0%}" for level in found], showgrid=False, visible=bool(found))  # fmt: skip


def _crossings(x: np.ndarray, share: pd.DataFrame) -> dict[float, float]:
    """Levels of F(Δ) that are passed, and where (ms); none where it depends on the value."""
    if x.size < 2 or not np.allclose(share["min"], share["max"]):
        return {}
    curve = np.maximum.accumulate(share["mean"].to_numpy(float))
    return {level: float(np.interp(level, curve, x)) for level in _LEVELS if curve[0] < level <= curve[-1]}


def _span(rows: pd.DataFrame) -> dict[str, Any]:
    """A logarithmic axis where AUC spans much."""
    auc = rows["auc"][np.isfinite(rows["auc"])]
    wide = len(auc) > 0 and auc.min() > 0 and auc.max() > 4 * auc.min()
    return {"type": "log", "dtick": "D2" if auc.max() < 100 * auc.min() else 1} if wide else {"type": "linear"}


def _views(rows: pd.DataFrame) -> dict[str, Any]:
    """Axes that show all, and those that show where the loop works."""
    reliable = rows[(rows["reliability"] >= _RELIABLE) & np.isfinite(rows["auc"])]
    if reliable.empty or "log" not in _span(rows).values():
        return {}
    low, high = float(reliable["auc"].min()), float(reliable["auc"].max())
    margin = 0.06 * (high - low) or 0.05 * high
    deadlines = 1e3 * reliable["deadline"]
    return {
        "All": {"yaxis.type": "log", "yaxis.dtick": _span(rows)["dtick"], "yaxis.autorange": True,
                "xaxis.autorange": True},
        f"F(Δ) ≥ {_RELIABLE:.0%}": {"yaxis.type": "linear", "yaxis.dtick": None, "yaxis.autorange": False,
                                    "yaxis.range": [low - margin, high + margin], "xaxis.autorange": False,
                                    "xaxis.range": [float(deadlines.min()), float(deadlines.max())]},
    }  # fmt: skip
