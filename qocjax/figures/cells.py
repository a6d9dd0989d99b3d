"""Cells of a map as an image of what its panel shows: cropped, and no finer than its pixels, with every wall kept.

A real map has a million cells and more, a panel a few hundred pixels a side. Nearest sampling would take one cell for
each pixel: slow, and walls of one cell fall between. Here a pixel shows the cell of its block that matters most.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from qocjax.cost_values import FREE, INSCRIBED, LETHAL, UNKNOWN

__all__ = ["SEEN", "Cells", "coarser", "pixel_edges", "seen_part"]

Extent = tuple[float, float, float, float]  # outer edges: x from, x to, y from, y to (m)

SEEN = UNKNOWN + 1
"""In place of a cost: an obstacle that was seen, not one of the static map."""

# What matters to a robot, from the least to the most: open cells by their cost, unknown ones, closed ones, obstacles.
_COSTS = np.array([*range(FREE, INSCRIBED), UNKNOWN, INSCRIBED, SEEN, LETHAL], np.uint16)
_RANKS = np.argsort(_COSTS).astype(np.uint16)

_EXACT = 1 - 1e-9  # of a pixel for each cell
_FINER = 2  # cells for each pixel of a PDF, which readers enlarge


class Cells(AxesImage):
    """The cells of a map where they lie. What is drawn of them follows from limits and pixels of the axes, each time.

    A map of fewer cells than the axes have pixels is drawn as it is.
    """

    def __init__(self, axes: Axes, extent: Extent, cost: NDArray[Any], table: NDArray[np.uint8]) -> None:
        """Puts them under what else there is in the axes, which grow to hold the map.

        Args:
            axes: Of linear scales.
            extent: Where they lie.
            cost: [rows, cols] in Nav2's scale, or `SEEN`; whole numbers, the first row at the smallest y.
            table: [256 or 257, 4] red, green, blue and opacity of each cost.
        """
        super().__init__(axes, origin="lower", extent=extent, interpolation="none", zorder=1)
        self.cost, self.table = cost, table
        axes.set_aspect("equal")
        axes.add_image(self)
        self.set_clip_path(axes.patch)
        self.set_extent(extent)  # now that it belongs to the axes, which grow

    def get_array(self) -> NDArray[Any]:
        """The costs of all cells, [rows, cols]."""
        return self.cost

    def make_image(self, renderer: Any, magnification: float = 1.0, unsampled: bool = False) -> Any:
        """What Matplotlib asks for when it draws: the image, where it lies, and how it is turned.

        Args:
            renderer: Of the file that is written.
            magnification: Pixels for each of the figure's.
            unsampled: Whether the file holds the cells rather than pixels, as a PDF does.
        """
        if not unsampled and self._crowded(magnification):
            return self._pixels(magnification)
        cost, extent = self.shown(renderer.get_image_magnification(), _FINER if unsampled else 1.0)
        image = AxesImage(self.axes, origin="lower", extent=extent, interpolation="none")
        image.set_data(self.table[cost])
        image.set_transform(self.get_transform())
        image.set_clip_box(self.get_clip_box())
        return image.make_image(renderer, magnification, unsampled)

    def _edges(self, magnification: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower left and upper right corner of the map, in pixels."""
        x_from, x_to, y_from, y_to = self.get_extent()
        low, high = magnification * self.get_transform().transform([(x_from, y_from), (x_to, y_to)])
        return low, high

    def _crowded(self, magnification: float) -> bool:
        """Whether cells are smaller than pixels, along axes that are not turned round."""
        low, high = self._edges(magnification)
        return bool((high > low).all() and (high - low < _EXACT * np.array(self.cost.shape[::-1])).any())

    def _pixels(self, magnification: float) -> tuple[NDArray[np.uint8] | None, float, float, None]:
        """The image of a crowded map, and where its lower left corner lies: in each pixel the cell that matters most.

        What Matplotlib makes of as many cells as pixels is the same, with some ten copies of them.
        """
        low, high = self._edges(magnification)
        seen = magnification * np.asarray(self.axes.bbox.extents)
        begin, end = np.rint(np.maximum(low, seen[:2])), np.rint(np.minimum(high, seen[2:]))
        if not (begin < end).all():
            return None, 0.0, 0.0, None
        cols, rows = (pixel_edges(*each) for each in zip(self.cost.shape[::-1], low, high, begin, end, strict=True))
        ranks = _RANKS[self.cost[rows[0] : rows[-1], cols[0] : cols[-1]]]
        shown = _COSTS[_largest(ranks, rows[:-1] - rows[0], cols[:-1] - cols[0])]
        x, y = begin / magnification
        return self.table[shown], float(x), float(y), None

    def shown(self, magnification: float, finer: float = 1.0) -> tuple[NDArray[Any], Extent]:
        """What is drawn: costs, and their outer edges.

        Args:
            magnification: Pixels for each of the figure's.
            finer: Cells for each pixel, at most.
        """
        x_from, x_to, y_from, y_to = self.get_extent()
        rows, cols = self.cost.shape
        view, pixels = self.axes.viewLim, magnification * np.asarray(self.axes.bbox.size)
        side = (x_to - x_from) / cols, (y_to - y_from) / rows
        high, wide = slice(0, rows), slice(0, cols)
        if rows * cols > pixels.prod():
            wide = seen_part(cols, (view.x0 - x_from) / side[0], (view.x1 - x_from) / side[0])
            high = seen_part(rows, (view.y0 - y_from) / side[1], (view.y1 - y_from) / side[1])
        cost = self.cost[high, wide]
        room = finer * pixels * (cost.shape[1] * side[0], cost.shape[0] * side[1]) / np.abs(view.size)
        extent = (x_from + wide.start * side[0], x_from + wide.stop * side[0],
                  y_from + high.start * side[1], y_from + high.stop * side[1])  # fmt: skip
        return coarser(cost, *(int(each / _EXACT) for each in room[::-1])), extent


def pixel_edges(count: int, low: float, high: float, begin: float, end: float) -> NDArray[np.int_]:
    """The first cell of each pixel, and the one after the last pixel's last: a cell belongs where it begins.

    Args:
        count: Of the cells.
        low: Where they begin, in pixels.
        high: Where they end.
        begin: The first pixel.
        end: The one after the last; pixels are whole, so both are up to half a pixel from where cells begin and end.
    """
    edges = (np.arange(begin, end + 1) - low) / (high - low) * count
    cells = np.clip(np.floor(edges), 0, count - 1).astype(int)
    if begin < low + 1:
        cells[0] = 0
    cells[-1] = count if end > high - 1 else np.ceil(edges[-1])
    return cells


def seen_part(count: int, first: float, last: float) -> slice:
    """Those of `count` cells that lie between two places, in cells from the first one's edge; at least one."""
    low, high = sorted((first, last))
    begin = int(np.clip(np.floor(low), 0, count - 1))
    return slice(begin, int(np.clip(np.ceil(high), begin + 1, count)))


def coarser(cost: NDArray[Any], rows: int, cols: int) -> NDArray[Any]:
    """Costs of at most so many rows and columns: of each block of cells the one that matters most to a robot.

    Blocks differ by one cell where they do not divide the map evenly, so that they fill it exactly.

    Args:
        cost: [rows, cols] in Nav2's scale, or `SEEN`.
        rows: At most; at least one is left.
        cols: At most; at least one is left.
    """
    most = [min(n, max(1, limit)) for n, limit in zip(cost.shape, (rows, cols), strict=True)]
    if most == list(cost.shape):
        return cost
    starts = (np.arange(count) * n // count for n, count in zip(cost.shape, most, strict=True))
    return _COSTS[_largest(_RANKS[cost], *starts)]


def _largest(ranks: NDArray[np.uint16], rows: NDArray[np.int_], cols: NDArray[np.int_]) -> NDArray[np.uint16]:
    """Of each block the largest; blocks begin at these rows and columns, and one with the next is of one cell."""
    for axis, starts in enumerate((rows, cols)):
        if len(starts) != ranks.shape[axis]:
            ranks = np.maximum.reduceat(ranks, starts, axis=axis)
    return ranks
