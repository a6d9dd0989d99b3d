"""Static maps: what is known to stand in the room, here from simple shapes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from qocjax import _checks
from qocjax.cost_values import FREE, LETHAL, UNKNOWN
from qocjax.navigation.grid import Grid

__all__ = ["Disc", "Rectangle", "StaticMap", "map_of_shapes"]

_HALF = 0.5 - 1e-9  # of a cell; a shape that only touches an edge does not reach beyond it


@dataclass(frozen=True, eq=False)
class StaticMap:
    """A map: a cost for each cell, 0 to 252 open, 254 an obstacle, 255 unknown.

    Attributes:
        grid: Where the cells lie.
        cost: [rows, cols] uint8.
        source: What it came from, for messages and titles.
    """

    grid: Grid
    cost: np.ndarray
    source: str = "shapes"

    def __post_init__(self) -> None:
        cost = np.asarray(self.cost)
        if cost.shape != self.grid.shape:
            raise ValueError(f"cost: got shape {cost.shape}, expected {self.grid.shape}")
        if cost.dtype.kind not in "iu" or cost.min() < FREE or cost.max() > UNKNOWN:
            found = f"{cost.dtype} from {cost.min()} to {cost.max()}"
            raise ValueError(f"cost: got {found}, expected whole numbers 0 to 255")
        object.__setattr__(self, "cost", cost.astype(np.uint8))


@dataclass(frozen=True)
class Rectangle:
    """A rectangle, such as a wall or a shelf.

    Attributes:
        centre: (x, y) m.
        size: Length along its own x and y axes (m).
        yaw: Of its x axis (rad).
    """

    centre: tuple[float, float]
    size: tuple[float, float]
    yaw: float = 0.0

    def __post_init__(self) -> None:
        _checks.numbers("centre of the rectangle", self.centre, (2,))
        _checks.bounded("size of the rectangle", self.size, above=0, shape=(2,))
        _checks.numbers("yaw of the rectangle", self.yaw, ())

    def distance(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Distance of points from the rectangle (m), 0 within."""
        dx, dy = x - self.centre[0], y - self.centre[1]
        along = np.abs(dx * np.cos(self.yaw) + dy * np.sin(self.yaw)) - self.size[0] / 2
        across = np.abs(dy * np.cos(self.yaw) - dx * np.sin(self.yaw)) - self.size[1] / 2
        return np.hypot(np.maximum(along, 0), np.maximum(across, 0))


@dataclass(frozen=True)
class Disc:
    """A disc, such as a pillar.

    Attributes:
        centre: (x, y) m.
        radius: m.
    """

    centre: tuple[float, float]
    radius: float

    def __post_init__(self) -> None:
        _checks.numbers("centre of the disc", self.centre, (2,))
        _checks.bounded("radius of the disc", self.radius, above=0, shape=())

    def distance(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Distance of points from the disc (m), 0 within."""
        return np.maximum(np.hypot(x - self.centre[0], y - self.centre[1]) - self.radius, 0)


def map_of_shapes(grid: Grid, shapes: Iterable[Rectangle | Disc] = ()) -> StaticMap:
    """A map that is free but for shapes.

    A cell is an obstacle if a shape comes nearer than half a cell to its centre: so what is thinner than a cell still
    stands in the way, and a rectangle whose edges are edges of cells fills just those cells.

    Args:
        grid: Where the cells lie.
        shapes: Each with its distance from points; what lies beside the grid is cut off.
    """
    x, y = grid.centres()
    occupied = np.zeros(grid.shape, bool)
    for shape in shapes:
        occupied |= shape.distance(x, y) < _HALF * grid.resolution
    return StaticMap(grid, np.where(occupied, LETHAL, FREE))
