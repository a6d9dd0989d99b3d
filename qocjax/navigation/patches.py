"""The sum of a costmap's layers, worked out anew only where other robots change it."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array, lax

from qocjax.navigation.costmap import Inflation, Obstacles, StaticLayer, layers_at
from qocjax.navigation.grid import Grid

__all__ = ["patched"]


def patched(
    alone: Array, grid: Grid, static: StaticLayer, obstacles: Obstacles, inflation: Inflation, reach: int
) -> Array:
    """The sum of the layers, [rows, cols], as `costmap_layers(...).total()` has it.

    Args:
        alone: [rows, cols] that sum without obstacles; its type is that of the result.
        grid: Where the cells lie.
        static: The static map.
        obstacles: M discs, each field [M].
        inflation: Parameters, for one map.
        reach: Cells from a disc beyond which it costs nothing, from `influence`.
    """
    dtype = static.distance.dtype
    x, y = (jnp.asarray(each, dtype) for each in grid.centres())
    shape = tuple(min(2 * reach + 1, cells) for cells in grid.shape)

    def patch(total: Array, disc: tuple[Array, Array]) -> tuple[Array, None]:
        # A disc beside the map has its patch at the edge: there is nothing of it, or all of it that is on the map.
        places = ((disc[1] - grid.origin[1]) / grid.resolution, (disc[0] - grid.origin[0]) / grid.resolution)
        lower = tuple(jnp.clip(jnp.floor(at), -reach, cells).astype(jnp.int32) - reach
                      for at, cells in zip(places, grid.shape, strict=True))  # fmt: skip
        row, col = (jnp.clip(low, 0, cells - side)
                    for low, cells, side in zip(lower, grid.shape, shape, strict=True))  # fmt: skip
        part = StaticLayer(*(lax.dynamic_slice(each, (row, col), shape) for each in static))
        here = (lax.dynamic_slice_in_dim(x, col, shape[1], 1), lax.dynamic_slice_in_dim(y, row, shape[0], 0))
        part, here = lax.optimization_barrier((part._replace(cost=part.cost.astype(dtype)), here))
        cost = lax.optimization_barrier(layers_at(here, grid.resolution, part, obstacles, inflation).total())
        return lax.dynamic_update_slice(total, cost.astype(total.dtype), (row, col)), None

    return lax.scan(patch, alone, (obstacles.x, obstacles.y))[0]
