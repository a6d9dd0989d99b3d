"""Global planner: optimal paths on the costmap, as A* finds them (model, section 9).

`plan` finds the cost to go and follows it from each start. `qocjax.navigation.wavefront` says what a path costs and how
the cost to go of a whole map is found, `qocjax.navigation.best_first` how that of the part of a large one that matters.
Paths are as good as those of A* or Dijkstra's algorithm: optimal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from qocjax.navigation.field import field_to, open_near
from qocjax.navigation.grid import Grid
from qocjax.navigation.wavefront import ROOT2, Planner, nearest_usable, open_cells, price_of

__all__ = ["Path", "follow", "plan"]

# Neighbours as (rows, columns) away: straight ones, then each diagonal with the two straight ones that it passes.
_MOVES = np.array([(0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)])
_PASSED = np.array([(0, 1), (1, 2), (2, 3), (3, 0)])


_ROUNDINGS = 32  # of a cost to go, up to which two are equal


class Path(NamedTuple):
    """Paths of a batch."""

    points: Array  # [*S, L, 2] centres of cells (m); the last one is repeated to the end
    num_points: Array  # [*S] how many of them are the path's
    length: Array  # [*S] of the line through them (m)
    cost: Array  # [*S] of the whole path (m), infinite if there is none
    reached: Array  # [*S] whether there is a path; else the points are all the start
    complete: Array  # [*S] whether the L points come to the goal


def plan(cost: Array, start: Array, goal: Array, grid: Grid, planner: Planner | None = None) -> Path:
    """Optimal paths.

    Args:
        cost: [*B, rows, cols] in Nav2's scale.
        start: [*S, 2] positions (m), where *S is *B, or *B and more axes: several starts on each map.
        goal: [*B, 2] (m).
        grid: Where the cells lie.
        planner: Parameters.

    Returns:
        One path per start.
    """
    planner = planner or Planner()
    batch = jnp.broadcast_shapes(cost.shape[:-2], goal.shape[:-1])
    cost = jnp.broadcast_to(cost, (*batch, *grid.shape))
    end = open_near(goal, cost, grid, planner)
    begin = None
    if start.ndim - 1 <= len(batch):  # one on each map: what no path from it needs can be left out
        start = jnp.broadcast_to(start, (*batch, 2))
        begin = open_near(start, cost, grid, planner)
    field = field_to(end, cost, grid, planner, begin)
    return _follow(field, cost, end.row * grid.shape[1] + end.col, start, grid, planner)


def follow(field: Array, cost: Array, start: Array, grid: Grid, planner: Planner) -> Path:
    """Paths down a cost to go.

    Args:
        field: [*B, rows, cols] from `cost_to_go`.
        cost: [*B, rows, cols] that it was made from.
        start: [*S, 2] positions (m), *S begins with *B.
        grid: Where the cells lie.
        planner: Parameters.
    """
    goal = jnp.argmin(field.reshape(*field.shape[:-2], -1), axis=-1)
    start = jnp.broadcast_to(start, (*field.shape[:-2], 2)) if start.ndim < field.ndim - 1 else start
    return _follow(field, cost, goal, start, grid, planner)


def _follow(field: Array, cost: Array, goal: Array, start: Array, grid: Grid, planner: Planner) -> Path:
    """`follow` to a known goal, [*B] index of its cell."""
    usable = lambda row, col: jnp.isfinite(grid.take(field, row, col))  # noqa: E731
    row, col, inside = grid.cell(start[..., 0], start[..., 1])
    # A robot on an open cell without a path is not put beyond the wall that shuts it in.
    own_open = open_cells(cost, grid, planner)(row, col)
    near_row, near_col, found = nearest_usable(usable, row, col, grid, planner.tolerance)
    reached = inside & jnp.where(own_open, usable(row, col), found)
    row, col = jnp.where(own_open, row, near_row), jnp.where(own_open, col, near_col)
    total = jnp.where(reached, grid.take(field, row, col), jnp.inf)

    down = _Downhill(field, cost, goal, grid, planner)
    rows, cols = _descend(down, row, col, reached, planner.max_points or sum(grid.shape))
    return _as_path(grid, rows, cols, total, reached, field)


@dataclass(frozen=True)
class _Downhill:
    """The way down a cost to go, in terms of indices of cells."""

    field: Array  # [*B, rows, cols] cost to go (m)
    cost: Array  # [*B, rows, cols] that it was made from
    goal: Array  # [*B]
    grid: Grid
    planner: Planner

    def to_go(self, at: Array) -> Array:
        """Cost to go of cells [*B, *K] (cells)."""
        return self.grid.take(self.field, *self.split(at)) / self.grid.resolution

    def split(self, at: Array) -> tuple[Array, Array]:
        """Rows and columns."""
        return at // self.grid.shape[1], at % self.grid.shape[1]

    def next(self, at: Array) -> Array:
        """The best neighbour of each cell [*S].

        Of those that are equally good, up to rounding, the one nearest to the goal: open floor has many optimal paths,
        and which of them is taken should not hang on the last digit.
        """
        lead, (rows, cols) = range(at.ndim), self.grid.shape
        around = [each[..., None] + lax.expand_dims(jnp.asarray(by, jnp.int32), lead)
                  for each, by in zip(self.split(at), _MOVES.T, strict=True)]  # fmt: skip
        on_map = (around[0] >= 0) & (around[0] < rows) & (around[1] >= 0) & (around[1] < cols)
        cells = jnp.where(on_map, around[0] * cols + around[1], at[..., None])
        to_go = jnp.where(on_map, self.to_go(cells), jnp.inf)
        price = price_of(self.grid.take(self.cost, *self.split(cells)), self.planner)
        passed = jnp.isfinite(to_go[..., _PASSED]).all(axis=-1)
        lengths = lax.expand_dims(jnp.asarray([1.0] * 4 + [ROOT2] * 4, self.field.dtype), lead)
        through = to_go + lengths * price
        through = jnp.where(jnp.concatenate([jnp.ones_like(passed), passed], axis=-1), through, jnp.inf)
        good = through <= through.min(axis=-1, keepdims=True) * (1 + _ROUNDINGS * jnp.finfo(through.dtype).eps)
        goal_row, goal_col = self.split(lax.expand_dims(self.goal, range(self.goal.ndim, cells.ndim)))
        away = (around[0] - goal_row) ** 2 + (around[1] - goal_col) ** 2
        nearest = jnp.argmin(jnp.where(good, away, jnp.iinfo(away.dtype).max), axis=-1)
        return jnp.take_along_axis(cells, nearest[..., None], axis=-1)[..., 0]


def _descend(down: _Downhill, row: Array, col: Array, reached: Array, max_points: int) -> tuple[Array, Array]:
    """Rows and columns [L, *S] from the start on; the goal is repeated.

    Args:
        down: The way.
        row: [*S] of the start.
        col: [*S] of the start.
        reached: [*S] whether to go at all.
        max_points: L.
    """
    first = (row * down.grid.shape[1] + col).astype(jnp.int32)

    def step(state: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        k, at, going, trail = state
        at = jnp.where(going, down.next(at), at)
        return k + 1, at, going & (down.to_go(at) > 0), trail.at[k].set(at)

    going = reached & (down.to_go(first) > 0)
    trail = jnp.broadcast_to(first[None], (max_points, *first.shape))
    begin = (jnp.array(1, jnp.int32), first, going, trail)
    count, last, _, trail = lax.while_loop(lambda s: (s[0] < max_points) & jnp.any(s[2]), step, begin)
    beyond = lax.broadcasted_iota(jnp.int32, trail.shape, 0) >= count
    trail = jnp.where(beyond, last[None], trail)
    return down.split(trail)


def _as_path(grid: Grid, rows: Array, cols: Array, total: Array, reached: Array, field: Array) -> Path:
    x, y = grid.point(rows.astype(field.dtype), cols.astype(field.dtype))
    points = jnp.moveaxis(jnp.stack([x, y], axis=-1), 0, -2)
    moves = ((rows[1:] != rows[:-1]).astype(int) + (cols[1:] != cols[:-1]).astype(int)).astype(field.dtype)
    length = jnp.sqrt(moves).sum(axis=0) * grid.resolution
    complete = reached & (grid.take(field, rows[-1], cols[-1]) == 0)
    return Path(points, 1 + (moves > 0).sum(axis=0), length, total, reached, complete)
