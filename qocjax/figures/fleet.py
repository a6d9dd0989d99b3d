"""A network's fleets as figures: QoC over the number of robots, and the air and the edge that they fill."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

from qocjax.figures.fleet_loops import completion_figure, steps_figure
from qocjax.figures.fleet_maps import maps_figure
from qocjax.figures.save import save
from qocjax.figures.style import GREY, OKABE_ITO, POLICIES, SINGLE_COLUMN, paper_style
from qocjax.figures.tables import check_table
from qocjax.fleets.tables import FleetStudy

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["draw_fleet", "fleet_figure"]

_COLUMNS = ("robots", "deadline", "qoc", "qoc_low", "qoc_high", "collision_share", "collision_low", "collision_high")
_USES = {"uplink_usage": ("uplink", OKABE_ITO[0], "o"), "edge_usage": ("edge", OKABE_ITO[1], "s"),
         "downlink_usage": ("downlink", OKABE_ITO[2], "^")}  # fmt: skip
_PREFIXES = {"Co-design": "co_design", "MinDelay": "mindelay", "MaxRel": "maxrel"}
_LINES = {"Co-design": "#0072B2", "MinDelay": "#E69F00", "MaxRel": "#009E73"}  # darker than the bars: lines are thin
_BARS: dict[str, Any] = {"capsize": 1.6, "elinewidth": 0.7, "capthick": 0.7}
# From one policy's points to the next, of the distance between fleets but at most of the axis: intervals must not hide
# one another.
_BESIDE, _MOST = 0.2, 0.02


def draw_fleet(study: FleetStudy, folder: Path) -> list[Path]:
    """Draws QoC and loads over the number of robots, F of each fleet, the maps, and the gain of one step of each.

    Args:
        study: What was found.
        folder: Where the files go.

    Returns:
        The files, a PNG and a PDF of each figure.
    """
    figures = {"fleet": fleet_figure(study), "completion": completion_figure(study.completion, study.points)}
    if study.maps:
        figures["maps"] = maps_figure(study.maps, study.asked)
    if not study.steps.empty:
        figures["steps"] = steps_figure(study.steps)
    return [path for name, figure in figures.items() for path in save(figure, folder / name)]


def fleet_figure(study: FleetStudy, *, width: float = SINGLE_COLUMN, height: float = 4.5) -> Figure:
    """Draws QoC with 95 % intervals over N; below, how busy air and edge are, and how often robots come too close.

    The line and band across all panels are where QoC passes the target, with its interval; the fleet in bold is the
    largest one simulated that keeps what is asked.

    Args:
        study: What was found.
        width: Inches.
        height: Inches.

    Raises:
        ValueError: A table is empty, lacks a column, or holds what cannot be drawn.
    """
    points = study.points
    check_table(points, "points", _COLUMNS)
    with paper_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        score, load, close = figure.subplots(3, 1, sharex=True, height_ratios=[2.2, 1.2, 0.9])
        _draw_scores(score, points, study.asked.qoc)
        _draw_uses(load, points)
        _draw_collisions(close, points, study.asked.collision_share)
        for axes in (score, load, close):
            _mark_limit(axes, study)
        _label_robots(close, points["robots"].to_numpy(int), study.largest)
        handles, names = score.get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper center", ncols=3)
        figure.align_ylabels()
    return figure


def _draw_scores(axes: Axes, points: pd.DataFrame, target: float) -> None:
    robots = points["robots"].to_numpy(float)
    axes.axhline(target, color=GREY, ls="--", lw=0.8, zorder=1, label="target")
    _with_interval(axes, robots, points, "qoc", color="k", marker="D", ms=3, mfc="w", lw=1.0, label="gains as given")
    axis = np.log(max(robots[-1] / robots[0], 2.0))
    step = min(_MOST * axis, _BESIDE * float(np.min(np.diff(np.log(robots)), initial=axis)))
    for place, (policy, prefix) in zip((-1, 1, 2), _PREFIXES.items(), strict=True):
        if f"{prefix}_qoc" in points:
            beside = robots * np.exp(step * place)
            _with_interval(axes, beside, points, f"{prefix}_qoc", color=_LINES[policy], label=policy, lw=0.7, ls=":",
                           marker=POLICIES[policy].marker, ms=3 if policy != "Co-design" else 5)  # fmt: skip
    axes.set_ylabel("QoC")
    axes.set_ylim(-0.03, 1.03)


def _with_interval(axes: Axes, x: np.ndarray, table: pd.DataFrame, column: str, **look: Any) -> None:
    middle, low, high = (table[f"{column}{end}"].to_numpy(float) for end in ("", "_low", "_high"))
    axes.errorbar(x, middle, np.clip([middle - low, high - middle], 0.0, None), zorder=3, **_BARS, **look)


def _draw_uses(axes: Axes, points: pd.DataFrame) -> None:
    for column, (name, colour, marker) in _USES.items():
        if column in points and np.isfinite(points[column]).any():
            axes.errorbar(points["robots"], 100 * points[column], 196 * points[f"{column}_se"], color=colour,
                          marker=marker, ms=3, lw=0.9, label=name, zorder=3, **_BARS)  # fmt: skip
    axes.axhline(100.0, color=GREY, lw=0.5, ls=":", zorder=1)
    axes.set_ylim(-4, 112)
    axes.set_ylabel("In use (%)")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="best", ncols=1, labelspacing=0.2)
    else:
        axes.text(0.5, 0.5, "nothing that fills", transform=axes.transAxes, ha="center", va="center", color=GREY)


def _draw_collisions(axes: Axes, points: pd.DataFrame, most: float) -> None:
    middle, low, high = (100 * points[f"collision_{end}"].to_numpy(float) for end in ("share", "low", "high"))
    axes.errorbar(points["robots"], middle, np.clip([middle - low, high - middle], 0, None), color="k", marker="o",
                  ms=3, lw=0.8, zorder=3, **_BARS)  # fmt: skip
    axes.axhline(100 * most, color=GREY, ls="--", lw=0.8, zorder=1)
    axes.set_ylim(-4, max(30.0, 1.08 * float(np.nanmax(high, initial=0.0))))
    axes.set_ylabel("Too close (%)")


def _mark_limit(axes: Axes, study: FleetStudy) -> None:
    """Where QoC passes the target, with its interval as far as that is known."""
    limit, robots = study.limit, study.points["robots"]
    if limit.value is None:
        return
    ends = (limit.low or float(robots.min()) / 2, limit.high or 2.0 * float(robots.max()))
    axes.axvspan(*ends, color=GREY, alpha=0.18, lw=0, zorder=0)
    axes.axvline(limit.value, color=GREY, lw=0.8, zorder=1)


def _label_robots(axes: Axes, robots: np.ndarray, largest: int | None) -> None:
    """A logarithmic axis with a mark at each fleet that has room; the largest that keeps what is asked in bold."""
    axes.set_xscale("log")
    axes.set_xlim(robots[0] / 1.35, robots[-1] * 1.35)
    room = np.log(robots[-1] / robots[0]) / 14 if robots.size > 1 else 0.0
    shown: list[int] = []
    for count in sorted(robots, key=lambda n: (n != largest, n)):
        if all(abs(np.log(count / other)) >= room for other in shown):
            shown.append(int(count))
    axes.xaxis.set_major_locator(FixedLocator(sorted(shown)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_formatter(NullFormatter())
    for label, count in zip(axes.get_xticklabels(), sorted(shown), strict=True):
        label.set_fontweight("bold" if count == largest else "normal")
    axes.set_xlabel("Robots $N$" + ("" if largest is None else " (bold: the most that keep what is asked)"))
