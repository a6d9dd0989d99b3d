"""Which values and deadlines the seeds of the choice cannot tell from the chosen ones (model, section 6)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from qocjax.quality import QocScale
from qocjax.statistics.estimates import standard_error, student
from qocjax.study.axes import axes_of, value_words
from qocjax.study.choosing import Pick
from qocjax.study.grid import Grid
from qocjax.study.table import qoc_by_seed

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

__all__ = ["tie_columns", "tie_lines"]

_SHOWN = 12  # values in a line


def tie_columns(
    runs: xr.Dataset,
    grid: Grid,
    results: pd.DataFrame,
    chosen: Sequence[Pick],
    scale: QocScale,
    units: np.ndarray | None = None,
    limit: float | None = None,
) -> list[dict[str, Any]]:
    """For each choice the values that tie with it, and the stretch of deadlines.

    A value ties where the interval of its paired difference to the choice, on the seeds of the choice, holds zero, all
    intervals of a set together with 95 % (Bonferroni; the choice is the largest of these means, so that its equals lie
    below it by chance): with Co-design each value at its own best deadline, with the other policies at theirs. Of
    equals the policies take the one with the largest mean.

    Args:
        runs: Of the selection seeds.
        grid: Rows of the results.
        results: The table.
        chosen: From the policies.
        scale: Of the QoC.
        units: [S] Labels of the seeds, see `units_of`.
        limit: Largest share of runs with a collision: what breaks it is no tie of a choice that keeps it.

    Returns:
        For each choice `tied_values` (text, values separated by blanks), and at the chosen value `tied_deadline_low`
        and `tied_deadline_high` (s).
    """

    def equal(rows: np.ndarray, place: int) -> np.ndarray:
        return _equal(qoc_by_seed(runs.isel(design=grid.design[rows]), scale), place, units)

    qoc = results["qoc"].where(results["diverged_share"] == 0, -np.inf).fillna(-np.inf).to_numpy()
    safe = qoc if limit is None else np.where(results["collision_share"] <= limit, qoc, -np.inf)
    return [_ties(equal, grid, safe if pick.kept else qoc, pick) for pick in chosen]


def tie_lines(policies: pd.DataFrame) -> list[str]:
    """What Co-design could as well have chosen, a line for each sweep where there is such."""
    lines = []
    for row in policies[(policies["policy"] == "Co-design") & policies["qoc"].notna()].to_dict("records"):
        ends = [1e3 * row["tied_deadline_low"], 1e3 * row["tied_deadline_high"]]
        stretch = f"{ends[0]:g} ms" if ends[0] == ends[1] else f"{ends[0]:g} to {ends[1]:g} ms"
        values = str(row["tied_values"]).split()
        if len(values) > 1 or ends[0] != ends[1]:
            text = f"{row['sweep']}: {_listed(values)}"
            own = value_words(row).replace(", ", "/")
            lines.append(f"{text}; at {own} any deadline from {stretch}" if ends[0] != ends[1] else text)
    return lines


def _listed(values: Sequence[str]) -> str:
    """Values in a line; of many combinations the first."""
    return ", ".join(values[:_SHOWN]) + (f" and {len(values) - _SHOWN} more" if len(values) > _SHOWN else "")


def _ties(equal: Callable[[np.ndarray, int], np.ndarray], grid: Grid, qoc: np.ndarray, pick: Pick) -> dict[str, Any]:
    if pick.row is None:
        return {"tied_values": "", "tied_deadline_low": np.nan, "tied_deadline_high": np.nan}
    rows = grid.rows(pick.sweep)
    value, deadline = (int(place[0]) for place in np.nonzero(rows == pick.row))
    free = pick.policy == "Co-design"  # the deadline too
    own = qoc[rows].argmax(axis=1) if free else np.full(len(rows), deadline)
    best = rows[np.arange(len(rows)), own]
    values = equal(best, value) & np.isfinite(qoc[best])
    along = np.arange(rows.shape[1]) == deadline
    if free:
        along = equal(rows[value], deadline) & np.isfinite(qoc[rows[value]])
    low, high = _about(along, deadline)
    axis = grid.deadline[rows[0]][low : high + 1]
    return {
        "tied_values": " ".join(_words(grid, row) for row in rows[values, 0]),
        "tied_deadline_low": float(axis.min()), "tied_deadline_high": float(axis.max()),
    }  # fmt: skip


def _words(grid: Grid, row: int) -> str:
    """The value of a row of a grid, those of several parameters with strokes between them."""
    axes = axes_of(str(grid.sweep[row]))
    if len(axes) == 1:
        return f"{grid.value[row]:g}"
    own = grid.designs.values()
    return "/".join(f"{own[name][grid.design[row]]:g}" for name in axes)


def _about(along: np.ndarray, place: int) -> tuple[int, int]:
    """First and last of the stretch without a hole about a place."""
    apart = np.flatnonzero(~along)
    low, high = apart[apart < place], apart[apart > place]
    return int(low.max() + 1) if low.size else 0, int(high.min() - 1) if high.size else along.size - 1


def _equal(scores: np.ndarray, chosen: int, units: np.ndarray | None) -> np.ndarray:
    """Which of the scores [K, S] cannot be told from the chosen ones: all intervals hold at once (Bonferroni)."""
    gap = scores - scores[chosen]
    observations = gap.shape[1] if units is None else np.unique(units).size
    half = student(observations, 1.0 - 0.05 / max(len(gap) - 1, 1)) * standard_error(gap, units=units)
    return (gap.mean(axis=1) + half >= 0.0) | (np.arange(len(gap)) == chosen)
