"""The cost to go on a large map: windows of it, settled best first.

The map is covered with windows of one shape that overlap by two lines or more, so that any two neighbours, with the
cells that a diagonal between them passes, lie in one. A window is due when a cell that it shares with the rim of its
neighbour has become cheaper. Its key is the least cost of a path from the start through such a cell: the octile
distance of the start, as no cell costs less than 1, and the cost to go from there. As in A*, the window with the least
key is settled next, until the least key exceeds the start's own cost to go. By then all cells of paths that cost no
more have their final values: from the goal on, the first cell of such a path without it would lie in a window that is
due, with a key of no more than the path's cost. Other cells keep an upper bound, or infinity.

Values are the least, over all paths, of their prices added up from the goal on. As rounding keeps the order of sums,
they are the same to the last bit in whatever order cells are settled.

Without a start all windows that are due are settled, and all values are final. This too takes less time than sweeps
over the whole of a large map: a window stays in cache, and stops at its own time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from qocjax.navigation.wavefront import ROOT2, Planner, price_of, settle

__all__ = ["pays", "settle_windows"]

_SIDE = 128  # of a window, the fastest of 32 to 256 on a map of 1674 x 1006 cells
_LEAST = 2 * _SIDE**2  # cells of a map from which on windows pay, for a plan
# Of the cost to go, per cell of a path: twice those up to which the planner takes moves to be equal, beside those of
# the sums themselves.
_ROUNDINGS = 64


def pays(shape: tuple[int, int]) -> bool:
    """Whether windows take less time than sweeps over the whole map."""
    return math.prod(shape) >= _LEAST


def settle_windows(cost: Array, goal: tuple[Array, ...], start: tuple[Array, ...], planner: Planner) -> Array:
    """The cost to go of one map, in cells.

    Args:
        cost: [rows, cols] in Nav2's scale.
        goal: Row, column, and whether there is one, each [].
        start: Likewise, the only cell from which paths begin; () for all.
        planner: Parameters.

    Returns:
        [rows, cols]: final on every path from the start that is the best up to rounding, elsewhere no less than what
        is. All infinite without a goal or a start.
    """
    windows = _Windows.over((cost.shape[0], cost.shape[1]))
    begin = jnp.where(goal[2] & start[2] if start else goal[2], 0.0, jnp.inf)
    value = jnp.full(cost.shape, jnp.inf, begin.dtype).at[goal[:2]].set(begin)
    margin = _ROUNDINGS * jnp.finfo(begin.dtype).eps

    def going(state: tuple[Array, Array]) -> Array:
        value, keys = state
        own = value[start[:2]] if start else jnp.inf
        least = keys[1:-1, 1:-1].min()
        return jnp.isfinite(least) & (least <= own * (1 + margin * (1 + own)))  # `own` is also its most cells

    def step(state: tuple[Array, Array]) -> tuple[Array, Array]:
        value, keys = state
        first = jnp.argmin(keys[1:-1, 1:-1])
        here = (first // len(windows.cols), first % len(windows.cols))
        corner = windows.corner(here)
        old, costs = (lax.dynamic_slice(each, corner, windows.shape) for each in (value, cost))
        new = settle(old, price_of(costs, planner))
        around = jnp.minimum(lax.dynamic_slice(keys, here, (3, 3)), windows.due(corner, old, new, start))
        keys = lax.dynamic_update_slice(keys, around.at[1, 1].set(jnp.inf), here)
        return lax.dynamic_update_slice(value, new, corner), keys

    return lax.while_loop(going, step, (value, windows.keys(goal, begin)))[0]


@dataclass(frozen=True)
class _Windows:
    """Where the windows lie."""

    shape: tuple[int, int]  # of each
    rows: np.ndarray  # the first of each row of windows
    cols: np.ndarray

    @classmethod
    def over(cls, shape: tuple[int, int]) -> _Windows:
        sides = (min(_SIDE, shape[0]), min(_SIDE, shape[1]))
        # As few as overlap by two lines.
        counts = (max(1, math.ceil((cells - 2) / max(side - 2, 1))) for cells, side in zip(shape, sides, strict=True))
        rows, cols = ((cells - side) * np.arange(count, dtype=np.int32) // max(count - 1, 1)
                      for cells, side, count in zip(shape, sides, counts, strict=True))  # fmt: skip
        return cls(sides, rows, cols)

    def corner(self, here: tuple[Array, Array]) -> tuple[Array, Array]:
        """First row and column of the window in a row and column of windows."""
        return jnp.asarray(self.rows)[here[0]], jnp.asarray(self.cols)[here[1]]

    def keys(self, goal: tuple[Array, ...], begin: Array) -> Array:
        """Keys at the beginning, in a frame that is never due: the windows that hold the goal are."""
        holds = [(firsts <= at) & (at < firsts + side)
                 for firsts, side, at in zip((self.rows, self.cols), self.shape, goal[:2], strict=True)]  # fmt: skip
        return jnp.pad(jnp.where(holds[0][:, None] & holds[1][None], begin, jnp.inf), 1, constant_values=jnp.inf)

    def due(self, corner: tuple[Array, Array], old: Array, new: Array, start: tuple[Array, ...]) -> Array:
        """Keys [3, 3] of the windows around one that was settled, by the cells on its rim.

        Args:
            corner: Its first row and column.
            old: Its cost to go before, [side, side].
            new: Its cost to go now.
            start: Row and column, or ().
        """
        away = _octile(corner, self.shape, start) if start else 0.0
        through = jnp.where(new < old, new + away, jnp.inf)
        up, down, left, right = through[0], through[-1], through[:, 0], through[:, -1]
        keys = [up[0], up.min(), up[-1], left.min(), jnp.inf, right.min(), down[0], down.min(), down[-1]]
        return jnp.stack([jnp.asarray(each, new.dtype) for each in keys]).reshape(3, 3)


def _octile(corner: tuple[Array, Array], shape: tuple[int, int], start: tuple[Array, ...]) -> Array:
    """Distance of a window's cells from the start over free floor (cells)."""
    rows, cols = (abs(first + jnp.arange(side, dtype=jnp.int32) - at)
                  for first, side, at in zip(corner, shape, start[:2], strict=True))  # fmt: skip
    rows, cols = rows[:, None], cols[None]
    return jnp.maximum(rows, cols) + (ROOT2 - 1) * jnp.minimum(rows, cols)
