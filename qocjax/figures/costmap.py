"""The costmap with path and rollouts (paper, "Illustration of the costmap utilized by two different robots").

The colours are the paper's: the static layer black, obstacles light blue, inflation pink.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import matplotlib.cm
import matplotlib.colors
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure, FigureBase, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Rectangle
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import ArrayLike, NDArray

from qocjax.cost_values import FREE, INSCRIBED, LETHAL, UNKNOWN
from qocjax.figures.cells import SEEN, Cells
from qocjax.figures.plane import GOAL, Colour, GridLike, colours_of, draw_body, levels
from qocjax.figures.style import COLOUR_MAP, DOUBLE_COLUMN, GREY, paper_style

__all__ = ["CostmapView", "costmap_layers_figure", "costmaps"]

_STATIC, _OBSTACLE, _UNKNOWN = "k", "#56B4E9", "0.85"
_PINK = LinearSegmentedColormap.from_list("inflation", ["#FDF1F6", "#F3A6C8", "#CC79A7"])
_CLOSED = "#9C3D74"  # inflation that closes a cell (253)
_DASHES, _DOTS = (0, (3, 1.5)), (0, (1, 1))
_HALO = [Stroke(linewidth=2.4, foreground="w"), Normal()]
_LEGEND: dict[str, Any] = {"columnspacing": 0.9, "handlelength": 1.3, "handletextpad": 0.5}
_LEAST = 1e-4  # weight, relative to the largest, below which rollouts look alike
_MOST_ROLLOUTS = 400  # drawn, evenly spread over the ranks of their weights


@dataclass(frozen=True)
class CostmapView:
    """What a robot's controller looked at, at one instant. N robots, K rollouts of H steps, L points of a path."""

    grid: GridLike
    static: ArrayLike  # [rows, cols] c_stat, Nav2's scale
    obstacles: ArrayLike  # [rows, cols] c_obs
    inflation: ArrayLike  # [rows, cols] c_infl
    total: ArrayLike  # [rows, cols] their sum
    path: ArrayLike  # [L, 2] m, the global path
    rollout_x: ArrayLike  # [K, H] m
    rollout_y: ArrayLike  # [K, H] m
    weight: ArrayLike  # [K] of the rollouts
    poses: ArrayLike  # [N, 3] m, m, rad, where the robots are
    robot: int  # whose controller it is
    begin: ArrayLike  # [3] m, m, rad, where the rollouts begin
    goal: ArrayLike  # [2] m, the robot's own
    robot_radius: float  # m
    time: float  # s

    def __post_init__(self) -> None:
        rows, cols = np.shape(self.total) if np.ndim(self.total) == 2 else (None, None)
        samples = np.shape(self.weight)[0] if np.ndim(self.weight) == 1 else None
        layers = ("static", "obstacles", "inflation", "total")
        shapes: dict[str, tuple[int | None, ...]] = {name: (rows, cols) for name in layers}
        shapes |= {"path": (None, 2), "rollout_x": (samples, None), "rollout_y": (samples, None), "weight": (samples,)}
        shapes |= {"poses": (None, 3), "begin": (3,), "goal": (2,)}
        for name, shape in shapes.items():
            got = np.shape(getattr(self, name))
            if len(got) != len(shape) or any(n is not None and n != m for n, m in zip(shape, got, strict=True)):
                raise ValueError(f"{name}: got shape {got}, expected {tuple('any' if n is None else n for n in shape)}")
        if not 0 <= self.robot < len(np.asarray(self.poses)):
            raise ValueError(f"robot: got {self.robot}, expected 0 to {len(np.asarray(self.poses)) - 1}")


def costmaps(views: Sequence[CostmapView], *, width: float = DOUBLE_COLUMN) -> Figure:
    """Draws the costmaps of robots beside each other, with path and rollouts.

    Rollouts are coloured by their weight relative to the largest, the heaviest on top: in MPPI the logarithm of that
    ratio is the difference in cost, J_map with all other terms, over the temperature.

    Args:
        views: One for each robot.
        width: Inches.

    Returns:
        The figure, with up to three costmaps in a row.

    Raises:
        ValueError: There is no view.
    """
    if not views:
        raise ValueError("views: got none, expected at least one")
    columns = min(len(views), 3)
    rows = -(-len(views) // columns)
    height = rows * (_ratio(views[0].grid) * (width - 0.5) / columns + 0.35) + 1.1
    with paper_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        for panel in panels.flat[len(views) :]:
            panel.remove()
        used = list(panels.flat[: len(views)])
        for place, (panel, view) in enumerate(zip(used, views, strict=True)):
            _draw_view(panel, view)
            panel.set_title(_title(view))
            panel.tick_params(labelbottom=place + columns >= len(views))
            panel.set_xlabel("$x$ (m)" if place + columns >= len(views) else "")
            panel.set_ylabel("$y$ (m)" if place % columns == 0 else "")
        _add_bar(figure, used, _rollouts_of(used[0]), "weight of a rollout, relative to the largest", extend="min")
        figure.legend(handles=_handles(views[0]), loc="outside upper center", ncols=8, **_LEGEND)
    return figure


def costmap_layers_figure(view: CostmapView, *, reach: float = 2.0, width: float = DOUBLE_COLUMN) -> Figure:
    """Draws one robot's surroundings with path and rollouts, and beside them the layers and their sum on the whole map.

    Args:
        view: What the controller looked at.
        reach: How far the surroundings reach from the robot (m).
        width: Inches.

    Raises:
        ValueError: `reach` is not positive.
    """
    if not 0.0 < reach < np.inf:
        raise ValueError(f"reach: got {reach}, expected a positive distance in metres")
    with paper_style():
        figure = Figure(figsize=(width, 0.42 * width + 1.1), layout="constrained")
        left, right = cast(Sequence[SubFigure], figure.subfigures(1, 2, width_ratios=[1.0, 1.25]))
        close = left.subplots()
        _draw_view(close, view)
        close.set(xlabel="$x$ (m)", ylabel="$y$ (m)", title=_title(view))
        low_x, low_y = _window(view, reach)
        close.set_xlim(low_x, low_x + 2 * reach)
        close.set_ylim(low_y, low_y + 2 * reach)
        _add_bar(left, [close], _rollouts_of(close), "weight of a rollout, relative to the largest", extend="min")
        panels = list(right.subplots(2, 2, sharex=True, sharey=True).flat)
        _draw_layers(panels, view)
        frame = Rectangle((low_x, low_y), 2 * reach, 2 * reach, fc="none", ec=GREY, lw=0.7, zorder=7)
        panels[-1].add_patch(frame)
        open_cells = matplotlib.cm.ScalarMappable(matplotlib.colors.Normalize(FREE, INSCRIBED - 1), _PINK)
        _add_bar(right, panels, open_cells, "cost of an open cell", ticks=[0, 50, 100, 150, 200, 252])
        figure.legend(handles=_handles(view), loc="outside upper center", ncols=8, **_LEGEND)
    return figure


def _window(view: CostmapView, reach: float) -> tuple[float, float]:
    """Lower left corner of the surroundings, within the map where that is large enough."""
    x, y = np.asarray(view.poses, float)[view.robot, :2]
    x_from, x_to, y_from, y_to = view.grid.extent

    def lower(at: float, low: float, high: float) -> float:
        return max(low, min(at - reach, high - 2 * reach)) if high - low >= 2 * reach else (low + high) / 2 - reach

    return lower(float(x), x_from, x_to), lower(float(y), y_from, y_to)


def _draw_layers(panels: Sequence[Axes], view: CostmapView) -> None:
    """Draws each layer and, with the path, their sum."""
    layers = (
        (r"static map $c_\mathrm{stat}$", view.static), (r"obstacles $c_\mathrm{obs}$", view.obstacles),
        (r"inflation $c_\mathrm{infl}$", view.inflation), ("sum $c$", view.total),
    )  # fmt: skip
    for panel, (title, cost) in zip(panels, layers, strict=True):
        _draw_cells(panel, view, cost)
        panel.set_title(title)
        panel.set_autoscale_on(False)
    panels[-1].plot(*np.asarray(view.path).T, color="k", lw=0.8, ls=_DASHES, zorder=4)
    panels[-1].plot(*np.asarray(view.goal), **GOAL | {"mfc": _colours(view)[view.robot], "ms": 5}, zorder=6)


def _title(view: CostmapView) -> str:
    return f"robot {view.robot + 1} at {view.time:.3g} s"


def _ratio(grid: GridLike) -> float:
    x_from, x_to, y_from, y_to = grid.extent
    return (y_to - y_from) / (x_to - x_from)


@functools.cache
def _table() -> NDArray[np.uint8]:
    """The colour of each cost and of what was seen, [257, 4]."""
    table = np.ones((SEEN + 1, 4))
    open_ = np.arange(FREE + 1, INSCRIBED)
    table[open_] = _PINK(open_ / (INSCRIBED - 1))
    for level, colour in ((INSCRIBED, _CLOSED), (LETHAL, _STATIC), (UNKNOWN, _UNKNOWN), (SEEN, _OBSTACLE)):
        table[level] = matplotlib.colors.to_rgba(colour)
    return levels(table)


def _draw_cells(panel: Axes, view: CostmapView, cost: ArrayLike) -> None:
    """Draws costs in the colours of the layers: where an obstacle was seen blue, on the static map black."""
    shown = np.asarray(cost).astype(np.uint16)
    shown[(shown == LETHAL) & (np.asarray(view.obstacles) == LETHAL) & (np.asarray(view.static) != LETHAL)] = SEEN
    Cells(panel, view.grid.extent, shown, _table())


def _draw_view(panel: Axes, view: CostmapView) -> None:
    """Draws the sum of the layers, rollouts, their mean, the global path, and the robots where they are."""
    _draw_cells(panel, view, view.total)
    weight = np.asarray(view.weight, float)
    rollouts = np.stack([np.asarray(view.rollout_x, float), np.asarray(view.rollout_y, float)], axis=-1)
    ranks = np.argsort(weight)
    chosen = ranks[np.unique(np.linspace(0, ranks.size - 1, _MOST_ROLLOUTS).round().astype(int))]
    panel.add_collection(
        LineCollection(
            list(rollouts[chosen]), array=weight[chosen] / weight.max(), cmap=COLOUR_MAP,
            norm=LogNorm(_LEAST, 1.0), linewidths=0.4, zorder=3,
        ),
        autolim=False,
    )  # fmt: skip
    panel.plot(*np.asarray(view.path).T, color="k", lw=1.0, ls=_DASHES, zorder=4, path_effects=_HALO)
    panel.plot(*np.tensordot(weight, rollouts, 1).T, color="k", lw=1.2, zorder=4.2, path_effects=_HALO)
    colours = _colours(view)
    panel.plot(*np.asarray(view.goal), **GOAL | {"mfc": colours[view.robot]}, zorder=6)
    for pose, colour in zip(np.asarray(view.poses, float), colours, strict=True):
        draw_body(panel, pose, view.robot_radius, colour, 2.2 * view.robot_radius)
    if _predicted(view):
        begin = tuple(np.asarray(view.begin, float)[:2])
        panel.add_patch(
            Circle(begin, view.robot_radius, fc="none", ec=colours[view.robot], ls=_DOTS, lw=0.9, zorder=4.4)
        )
    x_from, x_to, y_from, y_to = view.grid.extent
    panel.set_xlim(x_from, x_to)
    panel.set_ylim(y_from, y_to)


def _predicted(view: CostmapView) -> bool:
    """Whether the rollouts begin elsewhere than where the robot is."""
    begin, pose = np.asarray(view.begin, float), np.asarray(view.poses, float)[view.robot]
    return bool(np.hypot(*(begin[:2] - pose[:2])) > 1e-3)


def _rollouts_of(panel: Axes) -> LineCollection:
    return next(item for item in panel.collections if isinstance(item, LineCollection))


def _add_bar(
    figure: FigureBase, panels: Sequence[Axes], scale: matplotlib.cm.ScalarMappable, label: str, **options: Any
) -> None:
    bar = figure.colorbar(scale, ax=list(panels), location="bottom", pad=0.02, aspect=40, shrink=0.8, **options)
    bar.set_label(label)
    bar.outline.set_linewidth(0.5)


def _colours(view: CostmapView) -> list[Colour]:
    return colours_of(len(np.asarray(view.poses)))


def _handles(view: CostmapView) -> list[Line2D | Patch]:
    colour = _colours(view)[view.robot]
    dotted = Line2D([], [], ls="", marker="o", ms=6, mfc="none", mec=colour, mew=0.7, label="predicted place")
    return [
        Patch(fc=_STATIC, label="static map"),
        Patch(fc=_OBSTACLE, label="robot as last seen"),
        Patch(fc=_CLOSED, label="closed by inflation"),
        Patch(fc=_PINK(0.6), label="inflation"),
        Line2D([], [], color="k", lw=1.0, ls=_DASHES, label="global path"),
        Line2D([], [], color="k", lw=1.2, label="mean of rollouts"),
        Line2D([], [], **GOAL | {"mfc": colour}, label="goal"),
        *([dotted] if _predicted(view) else []),
    ]
