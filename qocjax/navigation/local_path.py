"""The part of the global path that the local controller sees, at equal distances along it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from qocjax.cost_values import UNKNOWN
from qocjax.navigation.grid import Grid

__all__ = ["LocalPath", "MapCosts", "local_path"]

_ROUNDING = 1e-3  # of the distance between points


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class MapCosts:
    """Costs on a grid, Nav2's scale: 0 free, 253 within the inscribed radius of an obstacle, 254 lethal.

    Cell [r, c] covers x in origin[0] + [c, c + 1) resolution and y in origin[1] + [r, r + 1) resolution. Where the
    cells lie is static, so that maps of many simulations differ in their costs alone.
    """

    cost: Array  # [rows, cols] of any type: bytes will do
    resolution: float = field(metadata={"static": True})  # m
    origin: tuple[float, float] = field(metadata={"static": True})  # m, the outer corner of cell [0, 0]

    def at(self, x: Array, y: Array) -> Array:
        """Cost of the cells that hold the points, UNKNOWN outside the map."""
        rows, cols = self.cost.shape
        grid = Grid(self.resolution, self.origin, (rows, cols))
        return grid.nearest(self.cost, x, y, float(UNKNOWN)).astype(x.dtype)


class LocalPath(NamedTuple):
    """The path from where it is nearest to the robot onwards, M points at equal distances; beyond its end, the end."""

    x: Array  # [M] m
    y: Array  # [M] m
    last: Array  # [] index of the first point at the end, M - 1 where the end lies beyond
    remaining: Array  # [] length from the first point to the end of the whole path (m)


def local_path(path: Array, x: Array, y: Array, prune_distance: float, spacing: float) -> LocalPath:
    """Reads a path at equal distances from its start, from the place nearest to the robot on, up to `prune_distance`.

    Nav2's path handler prunes likewise, but keeps the planner's own points; equal distances make "the path point after
    s metres" an index s / spacing. As Nav2's, they stay where they are while the robot moves.

    Args:
        path: [P, 2] corners of the path (m), P >= 2; to fill up a shorter one, its last point is repeated.
        x: Of the robot, [] (m).
        y: Of the robot, [] (m).
        prune_distance: How far along the path the controller sees (m).
        spacing: Between the points (m).
    """
    start, leap = path[:-1], path[1:] - path[:-1]
    squared = jnp.sum(leap * leap, axis=1)
    length = jnp.sqrt(squared)
    # The nearest point of each segment, by its share of the segment.
    toward = (x - start[:, 0]) * leap[:, 0] + (y - start[:, 1]) * leap[:, 1]
    share = jnp.clip(toward / jnp.where(squared > 0, squared, 1.0), 0.0, 1.0)
    gap_x, gap_y = start[:, 0] + share * leap[:, 0] - x, start[:, 1] + share * leap[:, 1] - y
    nearest = jnp.argmin(gap_x * gap_x + gap_y * gap_y)
    reached = jnp.cumsum(length)
    travelled = reached[nearest] - (1.0 - share[nearest]) * length[nearest]
    travelled = jnp.minimum(jnp.round(travelled / spacing) * spacing, reached[-1])
    remaining = reached[-1] - travelled

    num = _num_points(prune_distance, spacing)
    wanted = jnp.minimum(travelled + spacing * jnp.arange(num, dtype=path.dtype), reached[-1])
    segment = jnp.minimum(jnp.sum(reached[None, :] < wanted[:, None], axis=1), len(start) - 1)
    back = (reached[segment] - wanted) / jnp.where(length[segment] > 0, length[segment], 1.0)
    points = path[segment + 1] - back[:, None] * leap[segment]
    last = jnp.minimum(jnp.ceil(remaining / spacing - _ROUNDING).astype(jnp.int32), num - 1)
    return LocalPath(points[:, 0], points[:, 1], last, remaining)


def _num_points(prune_distance: float, spacing: float) -> int:
    return round(prune_distance / spacing) + 1
