"""QoC over the values of one parameter and the deadline, with the policies' choices (model, section 6)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from qocjax.figures.colliding import collision_cells, hatch_cells, hatch_patches
from qocjax.figures.quantities import DEADLINE_LABEL, RELIABILITY_LABEL, milliseconds, parameter
from qocjax.figures.style import COLOUR_MAP, POLICIES, SINGLE_COLUMN, paper_style
from qocjax.figures.tables import baseline_index, check_table, grid, policy_rows, sweep_rows

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["qoc_map"]

_RESULTS = ("sweep", "value", "deadline", "reliability", "qoc")
_POLICIES = ("sweep", "policy", "value", "deadline")
_LEVELS = (0.01, 0.5, 0.99)  # of F(Δ), marked at the top


def qoc_map(
    results: pd.DataFrame,
    policies: pd.DataFrame,
    sweep: str,
    *,
    baseline: Mapping[str, float] | None = None,
    limit: float | None = None,
    width: float = SINGLE_COLUMN,
    height: float = 2.3,
) -> Figure:
    """Draws QoC as a heat map over (Δ, Θ), with each policy's choice marked.

    Deadlines are to scale, each cell reaching half-way to the next; values are evenly spaced whatever their grid. The
    baseline's label is bold. The top axis shows where F(Δ) passes 1, 50 and 99 %. Where `policies` says what the seeds
    cannot tell from Co-design's choice, a line spans its deadlines, and triangles on the left point at its values.
    Hatches cover cells whose runs collide too often, see `collision_cells`.

    Args:
        results: One row per sweep, value and deadline.
        policies: One row per sweep and policy, chosen from the cells of `results`.
        sweep: The parameter.
        baseline: Baseline values by parameter. One that is not given is read from the other sweeps.
        limit: Largest share of runs with a collision; None hatches nothing.
        width: Inches.
        height: Inches.

    Returns:
        The figure.

    Raises:
        ValueError: A table is empty, lacks a column or the sweep, or holds what cannot be drawn; or a policy's choice
            is not a cell of the map.
    """
    check_table(results, "results", _RESULTS)
    check_table(policies, "policies", _POLICIES)
    table = sweep_rows(results, "results", sweep)
    values, deadlines, qoc = grid(table, "qoc")
    points = {name: _cell(name, row, values, deadlines) for name, row in policy_rows(policies, sweep)}
    chosen = baseline_index(results, sweep, values, baseline)
    with paper_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        axes = figure.add_subplot()
        _draw_cells(figure, axes, 1e3 * deadlines, qoc)
        _label_values(axes, sweep, values, chosen)
        _mark_reliability(axes, table)
        ties = _draw_ties(axes, policies, sweep, values)
        handles = [_draw_point(axes, name, 1e3 * deadline, index) for name, (deadline, index) in points.items()]
        handles += ties
        hatches: list[Patch] = []
        if limit is not None:
            cells = collision_cells(table, limit)
            hatch_cells(axes, _edges(1e3 * deadlines), cells)
            hatches = hatch_patches(cells, limit)
        figure.legend(handles=[*handles, *hatches], loc="outside upper center", ncols=3 if hatches else len(handles),
                      handlelength=1.0, columnspacing=1.2)  # fmt: skip
    return figure


def _cell(name: str, row: pd.Series, values: NDArray[np.float64], deadlines: NDArray[np.float64]) -> tuple[float, int]:
    """Returns a policy's deadline and the index of its value."""
    index = np.flatnonzero(np.isclose(values, row["value"], rtol=1e-6, atol=1e-9))
    if not index.size or not np.isclose(deadlines, row["deadline"], rtol=1e-6, atol=1e-9).any():
        raise ValueError(
            f"policies: {name} in sweep '{row['sweep']}' has value {row['value']} at deadline {row['deadline']} s, "
            "which results does not have"
        )
    return float(row["deadline"]), int(index[0])


def _edges(centres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the borders of cells that reach half-way to their neighbours."""
    if centres.size == 1:
        return centres[0] + 0.5 * np.array([-1.0, 1.0]) * (abs(centres[0]) or 1.0)
    middle = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[1.5 * centres[0] - 0.5 * centres[1]], middle, [1.5 * centres[-1] - 0.5 * centres[-2]]])


def _draw_cells(figure: Figure, axes: Axes, deadlines_ms: NDArray[np.float64], qoc: NDArray[np.float64]) -> None:
    rows = np.arange(qoc.shape[0] + 1) - 0.5
    mesh = axes.pcolormesh(_edges(deadlines_ms), rows, np.ma.masked_invalid(qoc), cmap=COLOUR_MAP, rasterized=True)
    low, high = float(np.nanmin(qoc)), float(np.nanmax(qoc))
    if low == high:
        mesh.set_clim(low - 0.01, high + 0.01)
    bar = figure.colorbar(mesh, ax=axes, label="QoC", pad=0.02, aspect=18)
    bar.outline.set_linewidth(0.6)
    axes.set_xlabel(DEADLINE_LABEL)
    if deadlines_ms.size == 1:
        axes.set_xticks(deadlines_ms, labels=[milliseconds(1e-3 * deadlines_ms[0])])


def _label_values(axes: Axes, sweep: str, values: NDArray[np.float64], chosen: int | None) -> None:
    axes.set_yticks(np.arange(values.size), labels=[parameter(sweep).format(value) for value in values])
    axes.tick_params(axis="y", length=0)
    axes.set_ylabel(parameter(sweep).label)
    if chosen is not None:
        axes.get_yticklabels()[chosen].set_fontweight("bold")


def _mark_reliability(axes: Axes, table: pd.DataFrame) -> None:
    """Marks at the top where F(Δ) passes some levels, unless it depends on the value or passes none."""
    grouped = table.groupby("deadline")["reliability"]
    if not np.allclose(grouped.min(), grouped.max()):
        return
    deadlines, share = 1e3 * np.array(sorted(grouped.groups), dtype=float), grouped.mean().to_numpy()
    reached = [level for level in _LEVELS if share[0] < level <= share[-1]]
    # F is a distribution function, so it never falls; accumulate guards against rounding.
    at = [float(np.interp(level, np.maximum.accumulate(share), deadlines)) for level in reached]
    if not at:
        return
    top = axes.secondary_xaxis("top")
    top.set_xticks(at, labels=[f"{level:.0%}" for level in reached])
    top.set_xlabel(RELIABILITY_LABEL, labelpad=2)


def _draw_ties(axes: Axes, policies: pd.DataFrame, sweep: str, values: NDArray[np.float64]) -> list[Line2D]:
    """Marks values and deadlines that tie with Co-design's; nothing where it stands alone."""
    rows = policies[(policies["sweep"] == sweep) & (policies["policy"] == "Co-design")]
    if "tied_values" not in policies or rows.empty:
        return []
    row = rows.iloc[0]
    tied = [int(np.argmin(np.abs(values - float(text)))) for text in str(row["tied_values"]).split()]
    low, high = 1e3 * row["tied_deadline_low"], 1e3 * row["tied_deadline_high"]
    rim = [Stroke(linewidth=1.8, foreground="w"), Normal()]
    handles = []
    if high > low:
        at = int(np.argmin(np.abs(values - row["value"])))
        (span,) = axes.plot([low, high], [at, at], color="k", lw=0.9, marker="|", ms=5, zorder=4)
        span.set_path_effects(rim)
        handles = [span]
    if len(tied) > 1:
        (marks,) = axes.plot(np.full(len(tied), 0.02), tied, ls="", marker=">", ms=3, color="k", zorder=6,
                             transform=axes.get_yaxis_transform())  # fmt: skip
        marks.set_path_effects(rim)
        handles = handles or [marks]
    for handle in handles:
        handle.set_label("ties")
    return handles


def _draw_point(axes: Axes, name: str, x: float, y: float) -> Line2D:
    """Draws a hollow marker with a white rim, to be seen on dark cells, light cells and around other markers."""
    look = POLICIES[name]
    (point,) = axes.plot([x], [y], ls="", marker=look.marker, ms=look.size, mfc="w" if look.marker == "*" else "none",
                         mec="k", mew=0.9, clip_on=False, zorder=5, label=name)  # fmt: skip
    point.set_path_effects([Stroke(linewidth=2.4, foreground="w"), Normal()])
    return point
