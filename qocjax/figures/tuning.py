"""The course of a tuning: paths on the QoC landscape of two gains, and QoC with its error over the steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import FuncFormatter, NullFormatter

from qocjax.figures.quantities import PARAMETERS, milliseconds
from qocjax.figures.style import COLOUR_MAP, DOUBLE_COLUMN, SINGLE_COLUMN, paper_style, sequence
from qocjax.figures.tables import check_table

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["tuning_map", "tuning_progress"]

_LINES = 5
_TICKS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)


def tuning_map(
    landscape: pd.DataFrame, trace: pd.DataFrame, designs: pd.DataFrame, *, width: float | None = None
) -> Figure:
    """Draws QoC over kappa and gamma with the path of every start on top, a panel for each deadline of the landscape.

    Colours span the upper half of the QoC values, where the choice is made; the lower half is all dark.

    Args:
        landscape: deadline, kappa, gamma, qoc: the same full grid at each deadline.
        trace: step, deadline, start, kappa, gamma, of tunings at these deadlines among others.
        designs: deadline, kappa, gamma: where the tunings ended.
        width: Inches; by default one column for one panel, else two.

    Raises:
        ValueError: A table is empty, lacks a column, or holds what cannot be drawn.
    """
    check_table(landscape, "landscape", ("deadline", "kappa", "gamma", "qoc"))
    check_table(trace, "trace", ("step", "deadline", "start", "kappa", "gamma"))
    check_table(designs, "designs", ("deadline", "kappa", "gamma"))
    deadlines = sorted(landscape["deadline"].unique())
    many = len(deadlines) > 1
    with paper_style():
        size = (width or (DOUBLE_COLUMN if many else SINGLE_COLUMN), 2.5)
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(1, len(deadlines), sharey=True, squeeze=False)[0]
        for axes, deadline in zip(panels, deadlines, strict=True):
            _draw_landscape(figure, axes, landscape[landscape["deadline"] == deadline])
            at = trace[np.isclose(trace["deadline"], deadline)]
            for _, path in at.groupby("start"):
                _draw_path(axes, path.sort_values("step"))
            ends = designs[np.isclose(designs["deadline"], deadline)]
            axes.plot(ends["kappa"], ends["gamma"], ls="", marker="*", ms=7.5, mfc="w", mec="k", mew=0.7, zorder=6)
            axes.set_title(rf"$\Delta$ = {milliseconds(deadline)} ms")
            axes.set_xlabel(PARAMETERS["kappa"].label)
        panels[0].set_ylabel(PARAMETERS["gamma"].label)
    return figure


def tuning_progress(trace: pd.DataFrame, *, width: float = SINGLE_COLUMN, height: float = 2.4) -> Figure:
    """Draws QoC over the steps, of the start that ends best at a deadline, with one standard error as a band.

    Of a long axis it shows the best deadline and up to five others, evenly spread. QoC is what the estimator sees: with
    perturbed designs it is their mean, which lies below that of the design itself until their width has shrunk.

    Args:
        trace: step, deadline, start, qoc, qoc_se.
        width: Inches.
        height: Inches.

    Raises:
        ValueError: The table is empty, lacks a column, or holds what cannot be drawn.
    """
    check_table(trace, "trace", ("step", "deadline", "start", "qoc", "qoc_se"))
    last = trace[trace["step"] > 0.8 * trace["step"].max()].groupby(["deadline", "start"])["qoc"].mean()
    deadlines = _shown(last.groupby("deadline").max())
    with paper_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        axes = figure.add_subplot()
        for deadline, colour in zip(deadlines, sequence(len(deadlines)), strict=True):
            start = last.loc[deadline].idxmax()
            path = trace[(trace["deadline"] == deadline) & (trace["start"] == start)].sort_values("step")
            step, score, error = (path[name].to_numpy(float) for name in ("step", "qoc", "qoc_se"))
            axes.plot(step, score, color=colour, lw=0.9, label=milliseconds(deadline))
            axes.fill_between(step, score - error, score + error, color=colour, alpha=0.25, lw=0)
        axes.set_xlabel("Step")
        axes.set_ylabel("QoC")
        axes.margins(x=0.01)
        figure.legend(title=r"$\Delta$ (ms)", loc="outside right center", handlelength=1.0)
    return figure


def _shown(best: pd.Series) -> list[float]:
    """Deadlines to show, ascending: the best one and up to five evenly spread."""
    spread = np.linspace(0, len(best) - 1, min(len(best), _LINES)).round().astype(int)
    return sorted({float(deadline) for deadline in best.index[spread]} | {float(best.idxmax())})


def _draw_landscape(figure: Figure, axes: Axes, table: pd.DataFrame) -> None:
    grid = table.pivot(index="gamma", columns="kappa", values="qoc")
    values = grid.to_numpy(float)
    low, high = float(np.median(values)), float(values.max())
    floor = low if low < high else low - 0.01
    mesh = axes.pcolormesh(
        grid.columns, grid.index, values, cmap=COLOUR_MAP, vmin=floor, vmax=high, shading="nearest", rasterized=True
    )
    bar = figure.colorbar(mesh, ax=axes, label="QoC", pad=0.02, aspect=18, extend="min")
    bar.outline.set_linewidth(0.6)
    for axis, ends in ((axes.xaxis, grid.columns), (axes.yaxis, grid.index)):
        axis.axes.set(**{f"{axis.axis_name}scale": "log"})
        axis.set_ticks([tick for tick in _TICKS if min(ends) <= tick <= max(ends)])
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.set_xlim(min(grid.columns), max(grid.columns))
    axes.set_ylim(min(grid.index), max(grid.index))


def _draw_path(axes: Axes, path: pd.DataFrame) -> None:
    """A white line with a dark rim, to be seen on light and dark, from a dot at the start."""
    rim = [Stroke(linewidth=1.9, foreground="k"), Normal()]
    (line,) = axes.plot(path["kappa"], path["gamma"], color="w", lw=0.9, zorder=4)
    line.set_path_effects(rim)
    axes.plot(path["kappa"].iloc[:1], path["gamma"].iloc[:1], ls="", marker="o", ms=3.5, mfc="w", mec="k", mew=0.7,
              zorder=5)  # fmt: skip
