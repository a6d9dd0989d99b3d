"""QoC over delay and reliability set apart, where robots collide, and the network's own curve (model, section 4)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from qocjax.figures.style import COLOUR_MAP, POLICIES, SINGLE_COLUMN, paper_style
from qocjax.figures.tables import check_table

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["delay_reliability_map"]

_LEVELS = 7  # contours, about
_NEAR = 13.0  # points between a mark and a level that is written
_WIDE = 30  # ratio of delays above which their axis is logarithmic
_BREAKS, _OPEN = "xxxx", "...."  # hatches: collisions break the limit; are not shown to keep it


def delay_reliability_map(
    plane: pd.DataFrame,
    curve: pd.DataFrame,
    points: Mapping[str, tuple[float, float]] | None = None,
    *,
    limit: float | None = None,
    width: float = SINGLE_COLUMN,
    height: float = 2.7,
) -> Figure:
    """Draws contours of equal QoC over constant delay and independent completion, and the curve (Δ, F(Δ)) on them.

    Reliability is drawn on a logarithmic axis: whether one loop in fifty or one in ten completes matters as much.
    Crosses cover where the share of runs with a collision breaks its limit even by the lower end of its interval, dots
    where it does by the upper end: there it is not shown to be kept.

    Args:
        plane: One row per cell: delay (s), reliability, qoc, collision_low and collision_high.
        curve: The network's own deadline (s) and reliability.
        points: (deadline, reliability) of policies, by name.
        limit: Largest share of runs with a collision; None hatches nothing.
        width: Inches.
        height: Inches.

    Returns:
        The figure.

    Raises:
        ValueError: A table is empty, lacks a column or a cell, or holds what cannot be drawn.
    """
    ends = ("collision_low", "collision_high")
    check_table(plane, "plane", ("delay", "reliability", "qoc", *(ends if limit is not None else ())))
    check_table(curve, "curve", ("deadline", "reliability"))
    grid = plane[plane["reliability"] > 0].pivot(index="reliability", columns="delay", values="qoc")
    if min(grid.shape) < 2 or grid.isna().any(axis=None):
        raise ValueError(
            f"plane: got {grid.shape} reliabilities above 0 and delays, expected a full grid, 2 x 2 at least"
        )
    with paper_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        axes = figure.add_subplot()
        contours = _draw_contours(figure, axes, grid)
        hatches = [] if limit is None else _draw_collisions(axes, plane, limit)
        line = _draw_curve(axes, curve, float(grid.index[0]))
        marks = [line, *(_draw_point(axes, name, *at, float(grid.index[0])) for name, at in (points or {}).items())]
        axes.set_xlabel(r"Delay $D$, or deadline $\Delta$ (ms)")
        axes.set_ylabel("Share of loops that complete")
        if grid.columns[0] > 0 and grid.columns[-1] / grid.columns[0] > _WIDE:
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(
                LogLocator(subs=(1, 2, 5) if grid.columns[-1] < 200 * grid.columns[0] else (1,))
            )
            axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlim(1e3 * grid.columns[0], 1e3 * grid.columns[-1])
        axes.set_ylim(grid.index[0], 1.0)
        figure.legend(handles=[*marks, *hatches], loc="outside upper center", ncols=2, handlelength=1.4)
        _label_contours(figure, axes, contours, marks)
    return figure


def _label_contours(figure: Figure, axes: Axes, contours: QuadContourSet, marks: list[Line2D]) -> None:
    """Writes levels on the lines once the axes are what they will be; where nothing is covered, cut or crowded."""
    figure.draw_without_rendering()
    taken = np.concatenate([_dense(axes.transData.transform(np.column_stack(mark.get_data()))) for mark in marks])
    room, inside = _NEAR * figure.dpi / 72, axes.get_window_extent()
    write = partial(contours.clabel, fontsize=6.5, fmt="%.3g", colors="w")
    # Tried without a gap in the line, which would stay where a level is not written.
    tried = write(inline=False)
    kept = []
    for text in tried:
        place = axes.transData.transform(text.get_position())
        cut = min(*(place - inside.min), *(inside.max - place)) < 0.7 * room
        if not cut and float(np.hypot(*(taken - place).T).min()) >= room:
            kept.append(text.get_position())
            taken = np.vstack([taken, place])
    for text in list(tried):
        text.remove()
    if kept:
        for text in write(manual=kept):
            text.set_path_effects([Stroke(linewidth=1.6, foreground="0.25"), Normal()])


def _dense(points: np.ndarray) -> np.ndarray:
    """Points along a line, close to each other."""
    place = np.linspace(0.0, len(points) - 1.0, 20 * len(points))
    return np.column_stack([np.interp(place, np.arange(len(points)), column) for column in points.T])


def _draw_contours(figure: Figure, axes: Axes, grid: pd.DataFrame) -> QuadContourSet:
    axes.set_yscale("log")
    delay, reliability = 1e3 * grid.columns.to_numpy(float), grid.index.to_numpy(float)
    filled = axes.contourf(delay, reliability, grid.to_numpy(), 24, cmap=COLOUR_MAP)
    lines = axes.contour(delay, reliability, grid.to_numpy(), _LEVELS, colors="w", linewidths=0.6)
    bar = figure.colorbar(filled, ax=axes, label="QoC", pad=0.04, aspect=18)
    bar.outline.set_linewidth(0.6)
    share = [level for level in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0) if level >= reliability[0]]
    axes.set_yticks(share, labels=[f"{level:.0%}" for level in share])
    axes.tick_params(axis="y", which="minor", length=0, labelleft=False)
    return lines


def _draw_collisions(axes: Axes, plane: pd.DataFrame, limit: float) -> list[Patch]:
    """Hatches over where collisions break their limit; what they say, for the legend."""
    shown = plane[plane["reliability"] > 0]
    low, high = (
        shown.pivot(index="reliability", columns="delay", values=f"collision_{end}").to_numpy(float)
        for end in ("low", "high")
    )
    # Where in its interval the limit lies: below 0 it is kept, above 1 it is broken.
    place = (high - limit) / np.maximum(high - low, 1e-9)
    delay, reliability = 1e3 * np.unique(shown["delay"]), np.unique(shown["reliability"])
    found = []
    for ends, hatch, text in (
        ((1.0, np.inf), _BREAKS, f"collisions above {limit:.1%}"),
        ((0.0, 1.0), _OPEN, "not shown to be below"),
    ):
        if ((place > ends[0]) & (place <= ends[1])).any():
            axes.contourf(delay, reliability, place, [ends[0], min(ends[1], 1e9)], colors="none", hatches=[hatch])
            found.append(Patch(facecolor="none", edgecolor="k", hatch=hatch, lw=0.4, label=text))
    return found


def _draw_curve(axes: Axes, curve: pd.DataFrame, floor: float) -> Line2D:
    ordered = curve.sort_values("deadline")
    share = np.maximum(ordered["reliability"].to_numpy(float), 0.5 * floor)
    (line,) = axes.plot(1e3 * ordered["deadline"], share, color="k", lw=1.4, label=r"$F(\Delta)$ of the network")
    line.set_path_effects([Stroke(linewidth=2.6, foreground="w"), Normal()])
    return line


def _draw_point(axes: Axes, name: str, deadline: float, reliability: float, floor: float) -> Line2D:
    look = POLICIES[name]
    (point,) = axes.plot([1e3 * deadline], [max(reliability, floor)], ls="", marker=look.marker, ms=look.size,
                         mfc=look.colour, mec="k", mew=0.7, clip_on=False, zorder=5, label=name)  # fmt: skip
    point.set_path_effects([Stroke(linewidth=2.0, foreground="w"), Normal()])
    return point
