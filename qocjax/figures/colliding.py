"""Which cells of a sweep collide too often: what hatches and crosses on a map of QoC say."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from qocjax.figures.tables import grid
from qocjax.statistics.estimates import clopper_pearson

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["BREAKS", "HATCHES", "OPEN", "collision_cells", "hatch_cells", "hatch_patches"]

OPEN, BREAKS = 1, 2
"""Of a cell in which runs collide: its limit lies within the interval of their share; it is broken for sure."""

HATCHES = {BREAKS: "xxxx", OPEN: "...."}


def collision_cells(rows: pd.DataFrame, limit: float) -> NDArray[np.int64]:
    """`BREAKS`, `OPEN` or 0 for each value and deadline of a sweep, both ascending, [values, deadlines].

    By Clopper and Pearson's 95 % interval, as if each seed were one observation. A cell in which no run collides is 0,
    though few seeds without a collision do not show a small limit.

    Args:
        rows: One per cell: value, deadline, collision_share and seeds.
        limit: Largest share of runs with a collision.
    """
    close, seeds = (np.nan_to_num(grid(rows, name)[2]) for name in ("collision_share", "seeds"))
    low, high = clopper_pearson(close * seeds, seeds)
    return np.where(low > limit, BREAKS, np.where((close > 0) & (high > limit), OPEN, 0))


def hatch_cells(axes: Axes, x: NDArray[np.float64], cells: NDArray[np.int64]) -> None:
    """Hatches cells of rows about 0, 1, ... between columns that begin and end at x; a kind at once, as one is slow."""
    for kind, hatch in HATCHES.items():
        k, column = np.nonzero(cells == kind)
        if k.size:
            left, right, low, high = x[column], x[column + 1], k - 0.5, k + 0.5
            corners = np.stack([[left, low], [right, low], [right, high], [left, high]]).transpose(2, 0, 1)
            path = Path.make_compound_path_from_polys(corners)
            axes.add_patch(PathPatch(path, fill=False, lw=0, ec="0.15", hatch=hatch, zorder=2))


def hatch_patches(cells: NDArray[np.int64], limit: float) -> list[Patch]:
    """What the hatches of these cells say, for a legend."""
    texts = {BREAKS: f"collisions above {limit:.0%}", OPEN: "not shown to be below"}
    return [Patch(facecolor="none", edgecolor="k", hatch=HATCHES[kind], lw=0.4, label=text)
            for kind, text in texts.items() if (cells == kind).any()]  # fmt: skip
