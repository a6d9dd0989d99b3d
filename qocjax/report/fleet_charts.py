"""Charts over the number of robots: QoC, use of air and edge, F of each fleet."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from qocjax.fleets.tables import FleetStudy
from qocjax.report.charts import axis, colour_style, layout, legend_item, series_uid
from qocjax.report.html import escape, interval, number, percent, plus_minus
from qocjax.report.labels import DEADLINE, RELIABILITY
from qocjax.study.reliability import share_text

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "LINES",
    "TEXT",
    "USES",
    "completion_chart",
    "completion_legend",
    "qoc_chart",
    "state_text",
    "style",
    "uses_chart",
]

# Column, line on the page, words, symbol; the first is that of the gains as they are given.
LINES = {
    "": ("nfa", "gains as given, best Δ", "diamond"), "co_design_": ("nfb", "Co-design", "star"),
    "mindelay_": ("nfc", "MinDelay", "circle"), "maxrel_": ("nfd", "MaxRel", "square"),
}  # fmt: skip
USES = {"uplink_usage": ("nfu", "uplink", "circle"), "edge_usage": ("nfv", "edge", "square"),
        "downlink_usage": ("nfw", "downlink", "triangle-up")}  # fmt: skip
_COLOURS = {"nfb": "#2b8fd6", "nfc": "#E69F00", "nfd": "#009E73", "nfu": "#2b8fd6", "nfv": "#D55E00", "nfw": "#009E73",
            "nfs": "#2b8fd6", "nft": "#8a949e", "nfx": "#D55E00"}  # fmt: skip
TEXT = "%{customdata}<extra></extra>"
_FLAT = 0.999  # share of the highest F from which on a curve shows nothing new


def style() -> str:
    """Style sheet of the lines."""
    return ".nfa,[class*=tracenfa]{--hue:var(--ink)}" + "".join(map(colour_style, _COLOURS, _COLOURS.values()))


def qoc_chart(study: FleetStudy) -> dict[str, Any]:
    """QoC with 95 % intervals over N, the target, and where it is passed."""
    points, robots = study.points, study.points["robots"].to_numpy(float)
    ends, nearest = _ends(robots), float(np.min(robots[1:] / robots[:-1], initial=1.2))
    traces = [
        {
            "type": "scatter",
            "mode": "lines",
            "x": ends,
            "y": [study.asked.qoc] * 2,
            "uid": "inktarget",
            "line": {"width": 1, "dash": "dash"},
            "hovertemplate": f"target {study.asked.qoc:.4f}<extra></extra>",
        }
    ]
    for place, (prefix, (uid, name, shape)) in enumerate(LINES.items()):
        if f"{prefix}qoc" in points:
            aside = robots * nearest ** (0.1 * (place - 1.5))  # intervals must not hide one another
            traces.append(_line(points, f"{prefix}qoc", uid, shape, aside, [_of_fleet(row, prefix, name) for row in
                                points.to_dict("records")]))  # fmt: skip
    return {"data": traces, "layout": _over_robots(study, axis("QoC", range=[-0.03, 1.03]))}


def uses_chart(study: FleetStudy) -> dict[str, Any]:
    """How busy air and edge are, in percent."""
    points, robots = study.points, study.points["robots"].to_numpy(float)
    traces = []
    for column, (uid, name, shape) in USES.items():
        if column in points:
            shares = zip(robots, 100 * points[column], 100 * points[f"{column}_se"], strict=True)
            texts = [f"{n:g} robots: {name} in use {plus_minus(used, error, '.2f')} %" for n, used, error in shares]
            traces.append({"type": "scatter", "mode": "lines+markers", "uid": uid, "x": robots, "customdata": texts,
                           "y": 100 * points[column].to_numpy(), "line": {"width": 2},
                           "marker": {"size": 7, "symbol": shape}, "hovertemplate": TEXT})  # fmt: skip
    return {"data": traces, "layout": _over_robots(study, axis("In use (%)", range=[-3, 105]))}


def completion_chart(study: FleetStudy) -> dict[str, Any]:
    """F(Δ) of each fleet, with a star at its best deadline."""
    table, points = study.completion, study.points.set_index("robots")
    fleets = list(dict.fromkeys(table["robots"]))
    traces: list[dict[str, Any]] = []
    for k, robots in enumerate(fleets):
        rows, uid = table[table["robots"] == robots], series_uid(k, len(fleets))
        texts = [f"{robots} robots: <i>F</i>({number(1e3 * row.deadline)} ms) = "
                 f"{share_text(row.reliability, row.reliability_se, 4)}" for row in rows.itertuples()]  # fmt: skip
        traces.append({"type": "scatter", "mode": "lines", "x": 1e3 * rows["deadline"].to_numpy(), "uid": uid,
                       "y": rows["reliability"].to_numpy(), "line": {"width": 2}, "customdata": texts,
                       "hovertemplate": TEXT})  # fmt: skip
        best = points.loc[robots]
        traces.append({"type": "scatter", "mode": "markers", "x": [1e3 * best["deadline"]], "y": [best["reliability"]],
                       "uid": f"{uid}m", "marker": {"symbol": "star", "size": 14, "line": {"width": 0}},
                       "cliponaxis": False, "customdata": [f"{robots} robots: {state_text(best)}"],
                       "hovertemplate": TEXT})  # fmt: skip
    top = table.groupby("robots")["reliability"].transform("max")
    rising = table.loc[table["reliability"] < _FLAT * top, "deadline"].max()
    end = min(1.15 * np.fmax(rising, study.points["deadline"].max()), table["deadline"].max())
    return {"data": traces, "layout": layout(
        xaxis=axis(DEADLINE, range=[0, 1e3 * end]), yaxis=axis(RELIABILITY, rangemode="tozero", tickformat=".2~%"),
        hovermode="closest", margin={"l": 62, "r": 14, "t": 14, "b": 48},
    )}  # fmt: skip


def completion_legend(study: FleetStudy) -> str:
    """The lines of `completion_chart`, as buttons."""
    fleets = list(dict.fromkeys(study.completion["robots"]))
    items = [legend_item(series_uid(k, len(fleets)), str(n)) for k, n in enumerate(fleets)]
    return f'<div class="legend" role="group" aria-label="Robots"><span>Robots</span>{"".join(items)}</div>'


def _line(points: pd.DataFrame, column: str, uid: str, shape: str, x: np.ndarray, texts: list[str]) -> dict[str, Any]:
    middle = points[column].to_numpy()
    return {
        "type": "scatter", "mode": "lines+markers", "uid": uid, "x": x, "y": middle,
        "error_y": {"type": "data", "symmetric": False, "array": points[f"{column}_high"].to_numpy() - middle,
                    "arrayminus": middle - points[f"{column}_low"].to_numpy(), "thickness": 1.3, "width": 3},
        "line": {"width": 2.2 if uid == "nfa" else 1.2, "dash": "solid" if uid == "nfa" else "dot"},
        "marker": {"size": 9 if shape == "star" else 7, "symbol": shape, "line": {"width": 0}},
        "customdata": texts, "hovertemplate": TEXT,
    }  # fmt: skip


def _of_fleet(row: dict[str, Any], prefix: str, name: str) -> str:
    head = f"<b>{name}</b>, {row['robots']} robots: "
    if not prefix:
        return head + state_text(row)
    ends = interval(row[f"{prefix}qoc_low"], row[f"{prefix}qoc_high"], ".4f")
    return (f"{head}QoC {plus_minus(row[f'{prefix}qoc'], row[f'{prefix}qoc_se'])} {ends}<br>"
            f"Δ = {number(1e3 * row[f'{prefix}deadline'])} ms, {escape(row[f'{prefix}sweep'])} = "
            f"{number(row[f'{prefix}value'])}")  # fmt: skip


def state_text(row: Any) -> str:
    """A fleet at its best deadline, in words."""
    text = (f"QoC {plus_minus(row['qoc'], row['qoc_se'])}<br>Δ = {number(1e3 * row['deadline'])} ms, <i>F</i>(Δ) = "
            f"{share_text(row['reliability'], row['reliability_se'])}<br>too close in "
            f"{percent(row['collision_share'])} of the runs")  # fmt: skip
    used = [f"{name} {percent(row[column])}" for column, (_, name, _) in USES.items() if column in row]
    return text + (f"<br>in use: {', '.join(used)}" if used else "")


def _over_robots(study: FleetStudy, up: dict[str, Any]) -> dict[str, Any]:
    """The layout of a chart over N, with the place where QoC passes the target."""
    robots = study.points["robots"].to_numpy(float)
    across = axis("Robots N", type="log", range=list(np.log10(_ends(robots))), tickvals=robots,
                  ticktext=[f"{n:g}" for n in robots])  # fmt: skip
    return layout(xaxis=across, yaxis=up, hovermode="closest", shapes=_passed(study, _ends(robots)),
                  margin={"l": 62, "r": 14, "t": 14, "b": 48})  # fmt: skip


def _ends(robots: np.ndarray) -> list[float]:
    return [float(robots[0]) / 1.3, float(robots[-1]) * 1.3]


def _passed(study: FleetStudy, ends: list[float]) -> list[dict[str, Any]]:
    """A line where QoC passes the target, and its interval as far as it is known."""
    limit = study.limit
    if limit.value is None:
        return []
    band = {"type": "rect", "yref": "paper", "y0": 0, "y1": 1, "x0": limit.low or ends[0], "x1": limit.high or ends[1],
            "fillcolor": "#8a949e", "opacity": 0.25, "line": {"width": 0}}  # fmt: skip
    line = {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "x0": limit.value, "x1": limit.value,
            "line": {"width": 1.5, "color": "#8a949e"}}  # fmt: skip
    return [band, line]
