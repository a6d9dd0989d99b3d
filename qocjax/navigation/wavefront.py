"""The cost to go to a goal from every cell of a costmap: what moves cost, and the sweeps that settle it.

Moves go to the eight neighbours. As in Nav2's Smac 2D-A* (node_2d.cpp), a move into a cell of cost c costs

    its length (1 or √2 cells) · (1 + cost_travel_multiplier c / 252),

here in metres; cells from 253 on are closed, and, other than there, no diagonal leads past a closed cell's corner.

A* expands one cell after the other from a sorted list, in an order that depends on the map. A compiled program would do
so with one scatter into a heap per cell, and a batch in lockstep. So the cost to go is found on the whole grid instead:
four sweeps (up, down, right, left), in each of which a line of cells takes the best over its three neighbours in the
line before, are repeated until nothing changes. A sweep has a fixed shape and works on whole lines, of one map or of
many, and it follows a path through any number of cells as long as it keeps its main direction: a handful of rounds is
enough on a map of rooms. At the end the cost to go satisfies Bellman's equation everywhere, so its descent is an
optimal path from any cell: one field serves all robots with the same map and goal, and may be followed again from
wherever they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike

from qocjax import _checks
from qocjax.cost_values import INSCRIBED, UNKNOWN
from qocjax.navigation.grid import Grid
from qocjax.scenario import _pytree

__all__ = ["ROOT2", "Planner", "nearest_usable", "open_cells", "price_of", "settle"]

_DEAREST = INSCRIBED - 1.0
ROOT2 = math.sqrt(2.0)


@_pytree
@dataclass(frozen=True)
class Planner:
    """Parameters of the planner; names and defaults of Nav2's Smac 2D planner where it has them.

    Attributes:
        cost_travel_multiplier: Weight of the costmap in the cost of a path.
        tolerance: If the goal's cell is closed, the nearest open one within this distance (m) is the goal. A robot in a
            closed cell likewise starts at the nearest one within it that has a path.
        allow_unknown: Whether unknown cells are open, at the price of 252; else they are closed.
        max_points: L, points that a path holds; rows + cols by default.
    """

    cost_travel_multiplier: ArrayLike = 2.0
    tolerance: float = field(default=0.125, metadata={"static": True})
    allow_unknown: bool = field(default=True, metadata={"static": True})
    max_points: int | None = field(default=None, metadata={"static": True})

    def __post_init__(self) -> None:
        _checks.bounded("cost_travel_multiplier", self.cost_travel_multiplier, least=0, shape=())
        object.__setattr__(self, "tolerance", float(_checks.bounded("tolerance", self.tolerance, least=0, shape=())))
        if self.max_points is not None:
            _checks.count("max_points", self.max_points, 2)


def price_of(cost: Array, planner: Planner) -> Array:
    """Cost of a move of length 1 into each cell, infinite into closed ones."""
    unknown = cost == UNKNOWN
    open_ = (cost < INSCRIBED) | (unknown if planner.allow_unknown else False)
    price = 1.0 + planner.cost_travel_multiplier * jnp.minimum(cost, _DEAREST).astype(float) / _DEAREST
    return jnp.where(open_, price, jnp.inf)


def open_cells(cost: Array, grid: Grid, planner: Planner) -> Callable[[Array, Array], Array]:
    """Tells of cells, by row and column, whether they are open."""
    return lambda row, col: jnp.isfinite(price_of(grid.take(cost, row, col), planner))


def nearest_usable(
    usable: Callable[[Array, Array], Array], row: Array, col: Array, grid: Grid, tolerance: float
) -> tuple[Array, Array, Array]:
    """The usable cell nearest to each cell, within the tolerance between centres, and whether there is one."""
    reach = int(tolerance / grid.resolution + 1e-6)
    away = np.array([(i, j) for i in range(-reach, reach + 1) for j in range(-reach, reach + 1)])
    squared = (away**2).sum(axis=1)
    away = away[np.argsort(squared, kind="stable")][: int((squared <= (tolerance / grid.resolution + 1e-6) ** 2).sum())]
    rows, cols = (each[..., None] + lax.expand_dims(jnp.asarray(d, jnp.int32), range(each.ndim))
                  for each, d in zip((row, col), away.T, strict=True))  # fmt: skip
    on_map = (rows >= 0) & (rows < grid.shape[0]) & (cols >= 0) & (cols < grid.shape[1])
    rows, cols = jnp.clip(rows, 0, grid.shape[0] - 1), jnp.clip(cols, 0, grid.shape[1] - 1)
    good = on_map & usable(rows, cols)
    first = jnp.argmax(good, axis=-1)[..., None]
    near_row, near_col = (jnp.take_along_axis(each, first, axis=-1)[..., 0] for each in (rows, cols))
    return near_row, near_col, good.any(axis=-1)


def settle(value: Array, price: Array) -> Array:
    """Sweeps until Bellman's equation holds: V(a) = min over neighbours n of length · price(n) + V(n).

    Args:
        value: [*B, rows, cols] what some path costs at most, infinite where none is known (cells).
        price: [*B, rows, cols] from `price_of`.
    """
    prices = [jnp.moveaxis(price, axis, 0) for axis in (-2, -1)]

    def sweep(state: tuple[Array, Array]) -> tuple[Array, Array]:
        value, _ = state
        new = value
        for lines, turned in zip(prices, (False, True), strict=True):
            new = jnp.swapaxes(new, 0, -1) if turned else new
            new = _along(new, lines, reverse=False)
            new = _along(new, lines, reverse=True)
            new = jnp.swapaxes(new, 0, -1) if turned else new
        return new, jnp.any(new < value)

    settled, _ = lax.while_loop(lambda state: state[1], sweep, (jnp.moveaxis(value, -2, 0), jnp.array(True)))
    return jnp.moveaxis(settled, 0, -2)


def _along(value: Array, price: Array, reverse: bool) -> Array:
    """One sweep over the lines of [lines, *B, cells]: each takes the best over its neighbours in the line before.

    Args:
        value: Costs so far.
        price: Of a metre in each cell, infinite in closed ones.
        reverse: Whether the line before is the one with the higher index.
    """
    axis = value.ndim - 2
    closed = jnp.full_like(value[0], jnp.inf)

    def line(before: tuple[Array, Array], here: tuple[Array, Array]) -> tuple[tuple[Array, Array], Array]:
        (reached, there), (best, own) = before, here
        # A move is closed where its own cell is, the one that it leads to, or one of the two that a diagonal passes.
        straight = jnp.where(jnp.isfinite(own), there, jnp.inf)
        best = jnp.minimum(best, reached + straight)
        for by in (1, -1):
            beside = jnp.isfinite(straight) & jnp.isfinite(_shifted(own, by, axis))
            diagonal = ROOT2 * jnp.where(beside, _shifted(there, by, axis), jnp.inf)
            best = jnp.minimum(best, _shifted(reached, by, axis) + diagonal)
        return (best, own), best

    return lax.scan(line, (closed, closed), (value, price), reverse=reverse)[1]


def _shifted(array: Array, by: int, axis: int) -> Array:
    """Each entry's neighbour before (by = 1) or after it (by = -1) along an axis, infinite beyond the end."""
    end = jnp.full_like(lax.slice_in_dim(array, 0, 1, axis=axis), jnp.inf)
    if by > 0:
        return jnp.concatenate([end, lax.slice_in_dim(array, 0, -1, axis=axis)], axis=axis)
    return jnp.concatenate([lax.slice_in_dim(array, 1, None, axis=axis), end], axis=axis)
