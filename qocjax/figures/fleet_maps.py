"""QoC over robots and what they are given: resource blocks, or workers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import Normal, Stroke

from qocjax.figures.style import COLOUR_MAP, DOUBLE_COLUMN, SINGLE_COLUMN, paper_style
from qocjax.figures.tables import check_table
from qocjax.fleets.limits import Asked

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["maps_figure"]

_NAMES = {"prbs": "Resource blocks (PRBs)", "workers": "Workers"}
_DARK = 0.55  # of the colour map, below which numbers are white


def maps_figure(maps: Mapping[str, pd.DataFrame], asked: Asked, *, height: float = 2.6) -> Figure:
    """Draws a map for each thing given: QoC in each cell, the contour of the target between their middles.

    Hatched cells keep too few distances: by the upper 95 % end, more runs with robots closer than two radii than asked.

    Args:
        maps: A row per fleet and amount, by what is given.
        asked: The target and the collisions that are tolerated.
        height: Inches.

    Raises:
        ValueError: A table is empty, lacks a column, or holds what cannot be drawn.
    """
    for given, table in maps.items():
        check_table(table, f"map_{given}", ("robots", given, "qoc", "collision_share", "collision_high", "seeds"))
    with paper_style():
        width = SINGLE_COLUMN if len(maps) == 1 else DOUBLE_COLUMN
        figure = Figure(figsize=(width, height), layout="constrained")
        panels = figure.subplots(1, len(maps), squeeze=False)[0]
        drawn = [
            _draw_map(axes, table, given, asked) for axes, (given, table) in zip(panels, maps.items(), strict=True)
        ]
        bar = figure.colorbar(panels[0].collections[0], ax=list(panels), label="QoC", pad=0.02, aspect=18)
        bar.outline.set_linewidth(0.6)
        target = f"QoC {asked.qoc:.3g}, the target"
        passed = any(line for line, _ in drawn)
        handles: list[Line2D | Patch] = [
            Line2D([], [], color="k", lw=1.4, label=target) if passed
            else Line2D([], [], ls="", label=f"no cell passes {target}")
        ]  # fmt: skip
        if any(close for _, close in drawn):
            text = f"too close not kept within {asked.collision_share:.0%} of runs"
            handles.append(Patch(facecolor="w", edgecolor="k", hatch="/////", lw=0.5, label=text))
        figure.legend(handles=handles, loc="outside upper center", ncols=2)
    return figure


def _draw_map(axes: Axes, table: pd.DataFrame, given: str, asked: Asked) -> tuple[bool, bool]:
    """Cells of equal size, however far apart fleets and amounts lie; whether the target is passed, any is hatched."""
    score = table.pivot(index=given, columns="robots", values="qoc").sort_index().sort_index(axis=1)
    marked = table.assign(close=asked.too_close(table).astype(float))
    close = marked.pivot(index=given, columns="robots", values="close").reindex_like(score)
    values = score.to_numpy(float)
    rows, columns = values.shape
    axes.pcolormesh(np.arange(columns + 1) - 0.5, np.arange(rows + 1) - 0.5, np.ma.masked_invalid(values),
                    cmap=COLOUR_MAP, norm=Normalize(0.0, 1.0), rasterized=True)  # fmt: skip
    _write_values(axes, values)
    too_close = close.to_numpy(float) > 0
    for row, column in np.argwhere(too_close):
        axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, fill=False, hatch="/////", lw=0,
                                 ec="w" if values[row, column] < _DARK else "k"))  # fmt: skip
    passed = bool(np.nanmin(values) < asked.qoc <= np.nanmax(values))
    if passed and rows > 1 and columns > 1:  # else there is no room for a contour
        line = axes.contour(values, levels=[asked.qoc], colors="k", linewidths=1.4)
        line.set_path_effects([Stroke(linewidth=3.0, foreground="w"), Normal()])
    axes.set_xticks(np.arange(columns), labels=[f"{n:g}" for n in score.columns])
    axes.set_yticks(np.arange(rows), labels=[f"{amount:g}" for amount in score.index])
    axes.tick_params(length=0)
    axes.set_xlabel("Robots $N$")
    axes.set_ylabel(_NAMES.get(given, given))
    return passed, bool(too_close.any())


def _write_values(axes: Axes, values: np.ndarray) -> None:
    size = 7.0 if values.shape[1] <= 6 else 5.5
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            ink, rim = ("w", "k") if value < _DARK else ("k", "w")
            text = axes.text(column, row + 0.26, f"{value:.2f}", ha="center", va="center", fontsize=size, color=ink)
            text.set(zorder=5, path_effects=[Stroke(linewidth=1.2, foreground=rim, alpha=0.5), Normal()])
