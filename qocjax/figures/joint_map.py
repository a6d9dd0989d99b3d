"""QoC over two parameters at once, a panel for each of some deadlines, with the policies' choices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from qocjax.figures.quantities import milliseconds, parameter
from qocjax.figures.style import COLOUR_MAP, DOUBLE_COLUMN, POLICIES, paper_style
from qocjax.figures.tables import check_table, policy_rows, sweep_rows
from qocjax.study.axes import axes_of

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["joint_map", "plane_at"]

_PANELS = 6


def joint_map(
    results: pd.DataFrame, policies: pd.DataFrame, sweep: str, *, width: float = DOUBLE_COLUMN, height: float = 3.6
) -> Figure:
    """Draws QoC as heat maps over the first two parameters of a sweep of several, at some deadlines.

    Deadlines are those of the policies' choices, and others between them evenly; a policy's mark is in the panel of
    its deadline. Of further parameters each cell takes the values that are best there.

    Args:
        results: One row per combination and deadline, with a column for each parameter.
        policies: One row per policy.
        sweep: Names of the parameters, separated by commas.
        width: Inches.
        height: Inches.

    Raises:
        ValueError: A table is empty, lacks a column or the sweep, or holds what cannot be drawn.
    """
    axes = axes_of(sweep)
    check_table(results, "results", ("sweep", "deadline", "qoc", *axes))
    check_table(policies, "policies", ("sweep", "policy", "deadline", *axes))
    table, points = sweep_rows(results, "results", sweep), dict(policy_rows(policies, sweep))
    deadlines = _shown(np.unique(table["deadline"]), [float(row["deadline"]) for row in points.values()])
    low, high = float(table["qoc"].min()), float(table["qoc"].max())
    limits = (low - 0.01, high + 0.01) if low == high else (low, high)
    columns = min(3, len(deadlines))
    rows = -(-len(deadlines) // columns)
    with paper_style():
        figure = Figure(figsize=(width * columns / 3, height * rows / 2), layout="constrained")
        panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for panel, deadline in zip(panels.flat, deadlines, strict=False):
            mesh = _draw_plane(panel, table, (axes[0], axes[1]), deadline, limits)
            for name, row in points.items():
                if np.isclose(row["deadline"], deadline):
                    _draw_point(panel, name, row, table, (axes[0], axes[1]))
        for panel in list(panels.flat)[len(deadlines) :]:
            panel.set_visible(False)
        for panel in panels[:, 0]:
            panel.set_ylabel(parameter(axes[0]).label)
        for panel in panels[-1]:
            panel.set_xlabel(parameter(axes[1]).label)
        bar = figure.colorbar(mesh, ax=panels, label="QoC", pad=0.01, aspect=30)
        bar.outline.set_linewidth(0.6)
        handles = [Line2D([], [], label=name, **_look(name)) for name in points]
        figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), handlelength=1.0)
    return figure


def plane_at(table: pd.DataFrame, axes: tuple[str, str], deadline: float) -> pd.DataFrame:
    """QoC over two parameters at one deadline, the first down the rows; of further parameters the best."""
    here = table[np.isclose(table["deadline"], deadline)]
    return here.pivot_table(index=axes[0], columns=axes[1], values="qoc", aggfunc="max").sort_index().sort_index(axis=1)


def _shown(deadlines: NDArray[np.float64], chosen: list[float]) -> list[float]:
    """Deadlines of panels: those chosen, and others evenly among the rest."""
    places = {int(np.argmin(np.abs(deadlines - each))) for each in chosen}
    for share in np.linspace(0.0, 1.0, _PANELS):
        if len(places) < min(_PANELS, deadlines.size):
            places.add(int(round(share * (deadlines.size - 1))))
    return deadlines[sorted(places)].tolist()


def _draw_plane(
    panel: Axes, table: pd.DataFrame, axes: tuple[str, str], deadline: float, limits: tuple[float, float]
) -> QuadMesh:
    plane = plane_at(table, axes, deadline)
    edges = [np.arange(size + 1) - 0.5 for size in reversed(plane.shape)]
    mesh = panel.pcolormesh(*edges, np.ma.masked_invalid(plane.to_numpy()), cmap=COLOUR_MAP, vmin=limits[0],
                            vmax=limits[1], rasterized=True)  # fmt: skip
    across, up = (plane.columns.to_numpy(), plane.index.to_numpy())
    panel.set_xticks(range(across.size), [parameter(axes[1]).format(value) for value in across])
    panel.set_yticks(range(up.size), [parameter(axes[0]).format(value) for value in up])
    panel.tick_params(length=0)
    panel.set_title(rf"$\Delta$ = {milliseconds(deadline)} ms", fontsize=8)
    return mesh


def _draw_point(
    panel: Axes, name: str, row: Mapping[str, float] | pd.Series, table: pd.DataFrame, axes: tuple[str, str]
) -> None:
    """A hollow marker with a white rim, in the cell of the choice."""
    y, x = (int(np.argmin(np.abs(np.unique(table[axis]) - row[axis]))) for axis in axes)
    (point,) = panel.plot([x], [y], clip_on=False, zorder=5, **_look(name))
    point.set_path_effects([Stroke(linewidth=2.4, foreground="w"), Normal()])


def _look(name: str) -> dict[str, Any]:
    """How a policy's mark is drawn."""
    look = POLICIES[name]
    return {"ls": "", "marker": look.marker, "ms": look.size, "mfc": "w" if look.marker == "*" else "none", "mec": "k",
            "mew": 0.9}  # fmt: skip
