"""The cost to go of a batch of costmaps, each by the means that suits its size and the machine."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from qocjax.navigation._batches import over_maps
from qocjax.navigation.best_first import pays, settle_windows
from qocjax.navigation.grid import Grid
from qocjax.navigation.wavefront import Planner, nearest_usable, open_cells, price_of, settle

__all__ = ["Cells", "cost_to_go", "field_to", "open_near"]


class Cells(NamedTuple):
    """A cell of each map, each field [*B]."""

    row: Array
    col: Array
    found: Array  # whether there is one


def cost_to_go(cost: Array, goal: Array, grid: Grid, planner: Planner) -> Array:
    """Cost of the best path from each cell to the goal (m), infinite where there is none and in closed cells.

    Args:
        cost: [*B, rows, cols] in Nav2's scale.
        goal: [*B, 2] (m).
        grid: Where the cells lie.
        planner: Parameters.

    Returns:
        [*B, rows, cols].
    """
    return field_to(open_near(goal, cost, grid, planner), cost, grid, planner)


def open_near(place: Array, cost: Array, grid: Grid, planner: Planner) -> Cells:
    """The open cell nearest to each place [*B, 2], if there is one within the tolerance."""
    row, col, inside = grid.cell(place[..., 0], place[..., 1])
    row, col, found = nearest_usable(open_cells(cost, grid, planner), row, col, grid, planner.tolerance)
    return Cells(row, col, found & inside)


def field_to(goal: Cells, cost: Array, grid: Grid, planner: Planner, start: Cells | None = None) -> Array:
    """`cost_to_go` to cells.

    Args:
        goal: From `open_near`.
        cost: [*B, rows, cols] in Nav2's scale.
        grid: Where the cells lie.
        planner: Parameters.
        start: If given, the only cells from which paths begin: what lies on none of the best ones may be anything no
            less than what is right, and all of a map where one of the two was not found.

    Returns:
        [*B, rows, cols] (m).
    """

    def whole(cost: Array, *goal: Array) -> Array:
        row, col, found = (each[..., None, None] for each in goal[:3])
        rows, cols = (lax.broadcasted_iota(jnp.int32, cost.shape, cost.ndim + axis) for axis in (-2, -1))
        price = price_of(cost, planner)
        begin = jnp.where((rows == row) & (cols == col) & found, 0.0, jnp.inf).astype(price.dtype)
        return over_maps(settle, begin, price) * grid.resolution

    def windows(cost: Array, *ends: Array) -> Array:
        batch = cost.shape[:-2]
        one = lambda cost, *ends: settle_windows(cost, ends[:3], ends[3:], planner)  # noqa: E731
        if not batch:
            return one(cost, *ends) * grid.resolution
        flat = (cost.reshape(-1, *grid.shape), *(each.reshape(-1) for each in ends))
        return lax.map(lambda each: one(*each), flat).reshape(cost.shape) * grid.resolution

    if not pays(grid.shape):
        return whole(cost, *goal)
    # An accelerator takes whole lines of all maps at once.
    return lax.platform_dependent(cost, *goal, *(start or ()), cpu=windows, default=whole)
