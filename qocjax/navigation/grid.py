"""The grid of the map: where its cells lie, and what a layer of values says at a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike

from qocjax import _checks

__all__ = ["Grid"]

_ROUNDING = 1e-9  # of a cell, where a length is divided into cells


@dataclass(frozen=True)
class Grid:
    """Square cells, laid out as in a ROS occupancy grid: rows go with y, columns with x.

    Cell [row, col] covers x in origin[0] + [col, col + 1) resolution and y in origin[1] + [row, row + 1) resolution.
    Hashable, so that it can be a static argument of a compiled function.

    Attributes:
        resolution: Side of a cell (m).
        origin: Outer corner of cell [0, 0] (m, m).
        shape: (rows, cols).
    """

    resolution: float
    origin: tuple[float, float]
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        set_(self, "resolution", float(_checks.bounded("resolution", self.resolution, above=0, shape=())))
        set_(self, "origin", tuple(float(v) for v in _checks.numbers("origin", self.origin, (2,))))
        if not (isinstance(self.shape, (tuple, list)) and len(self.shape) == 2):
            raise ValueError(f"shape: got {self.shape!r}, expected (rows, cols)")
        set_(self, "shape", tuple(_checks.count("shape", n) for n in self.shape))

    @classmethod
    def covering(cls, low: tuple[float, float], high: tuple[float, float], resolution: float) -> Grid:
        """The smallest grid from corner `low` that reaches corner `high` (m, m).

        Raises:
            ValueError: `high` is not above `low` in both, or the resolution is not positive.
        """
        low_x, low_y = (float(v) for v in _checks.numbers("low", low, (2,)))
        high_x, high_y = (float(v) for v in _checks.numbers("high", high, (2,)))
        if not (high_x > low_x and high_y > low_y):
            raise ValueError(f"high: got {tuple(high)}, expected above low, {tuple(low)}, in both coordinates")
        side = float(_checks.bounded("resolution", resolution, above=0, shape=()))
        rows, cols = (int(np.ceil(length / side - _ROUNDING)) for length in (high_y - low_y, high_x - low_x))
        return cls(side, (low_x, low_y), (rows, cols))

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Outer edges: x from, x to, y from, y to (m), the order of Matplotlib's `imshow`."""
        (x, y), (rows, cols) = self.origin, self.shape
        return x, x + cols * self.resolution, y, y + rows * self.resolution

    def centres(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates x [1, cols] and y [rows, 1] of the centres of the cells (m)."""
        rows, cols = self.shape
        x, y = self.point(np.arange(rows)[:, None], np.arange(cols)[None])
        return x, y

    def point(self, row: Any, col: Any) -> tuple[Any, Any]:
        """Coordinates x and y of the centres of cells (m)."""
        return (
            self.origin[0] + (col + 0.5) * self.resolution,
            self.origin[1] + (row + 0.5) * self.resolution,
        )

    def cell(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array, Array]:
        """Row and column of the cells that hold points, and whether they lie on the map.

        Row and column of a point beside the map, or that is no number, are those of some cell on it.
        """
        rows, cols = self.shape
        row = jnp.floor((jnp.asarray(y) - self.origin[1]) / self.resolution)
        col = jnp.floor((jnp.asarray(x) - self.origin[0]) / self.resolution)
        inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
        return jnp.where(inside, row, 0).astype(jnp.int32), jnp.where(inside, col, 0).astype(jnp.int32), inside

    def nearest(self, values: Array, x: ArrayLike, y: ArrayLike, outside: ArrayLike) -> Array:
        """Values of the cells that hold the points.

        Args:
            values: [*B, rows, cols].
            x: [*B, *K] (m).
            y: [*B, *K] (m).
            outside: Value beside the map.

        Returns:
            [*B, *K].
        """
        row, col, inside = self.cell(x, y)
        # Indices are computed before any is used: a loop with look-ups in it takes no vector registers.
        index = lax.optimization_barrier(jnp.where(inside, row * self.shape[1] + col, -1))
        return jnp.where(index >= 0, self._at(values, jnp.maximum(index, 0)), outside)

    def take(self, values: Array, row: Array, col: Array) -> Array:
        """Values [*B, *K] of cells on the map: `values` is [*B, rows, cols], `row` and `col` are [*B, *K]."""
        return self._at(values, row * self.shape[1] + col)

    def _at(self, values: Array, index: Array) -> Array:
        """Values of cells by their indices, row after row."""
        batch = values.shape[:-2]
        if values.shape[-2:] != self.shape or index.shape[: len(batch)] != batch:
            raise ValueError(
                f"values: got shape {values.shape} for points of shape {index.shape}, expected [*B, rows, cols] with "
                f"(rows, cols) = {self.shape} and B the first axes of the points"
            )
        flat = values.reshape(*batch, -1)
        found = jnp.take_along_axis(flat, index.reshape(*batch, -1), axis=-1, mode="promise_in_bounds")
        return found.reshape(index.shape)
