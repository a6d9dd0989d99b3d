"""Which cells of a sweep collide too often: what hatches and crosses on a map of QoC say."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray
from scipy import special

from qocjax.figures.tables import grid

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
    hits = close * seeds
    low = np.where(hits > 0, special.betaincinv(np.maximum(hits, 1e-9), seeds - hits + 1.0, 0.025), 0.0)
    high = np.where(hits < seeds, special.betaincinv(hits + 1.0, np.maximum(seeds - hits, 1e-9), 0.975), 1.0)
    return np.where(low > limit, BREAKS, np.where((hits > 0) & (high > limit), OPEN, 0))


def hatch_cells(axes: Axes, x: NDArray[np.float64], cells: NDArray[np.int64]) -> None:
    """Hatches cells of rows about 0, 1, ... between columns that begin and end at x; those side by side as one."""
    for k, row in enumerate(cells):
        edges = np.flatnonzero(np.diff(row, prepend=-1, append=-1))
        for first, end in zip(edges[:-1], edges[1:], strict=True):
            if row[first]:
                axes.add_patch(Rectangle((x[first], k - 0.5), x[end] - x[first], 1.0, fill=False, lw=0, ec="0.15",
                                         hatch=HATCHES[int(row[first])], zorder=2))  # fmt: skip


def hatch_patches(cells: NDArray[np.int64], limit: float) -> list[Patch]:
    """What the hatches of these cells say, for a legend."""
    texts = {BREAKS: f"collisions above {limit:.0%}", OPEN: "not shown to be below"}
    return [Patch(facecolor="none", edgecolor="k", hatch=HATCHES[kind], lw=0.4, label=text)
            for kind, text in texts.items() if (cells == kind).any()]  # fmt: skip
