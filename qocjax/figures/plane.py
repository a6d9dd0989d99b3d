"""What figures of the plane share: the map underneath, robots with their heading, goals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import matplotlib.colors
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from numpy.typing import ArrayLike, NDArray

from qocjax.cost_values import FREE, LETHAL, UNKNOWN
from qocjax.figures.cells import Cells
from qocjax.figures.style import OKABE_ITO, sequence

__all__ = [
    "GOAL",
    "NAMED",
    "Colour",
    "GridLike",
    "MapLike",
    "colours_of",
    "draw_body",
    "draw_goals",
    "draw_map",
    "levels",
]

NAMED = len(OKABE_ITO)  # robots up to which each has a colour of its own and a line in the legend
GOAL: dict[str, Any] = {"ls": "", "marker": "*", "ms": 7, "mfc": "w", "mec": "k", "mew": 0.7}

_WALL, _UNKNOWN = "0.3", "0.88"

Colour = str | tuple[float, float, float, float]


class GridLike(Protocol):
    """Where the cells of a map lie."""

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Outer edges: x from, x to, y from, y to (m)."""


class MapLike(Protocol):
    """What a map must offer to be drawn, such as `qocjax.navigation.StaticMap`."""

    @property
    def grid(self) -> GridLike:
        """Where the cells lie."""

    @property
    def cost(self) -> ArrayLike:
        """[rows, cols] in Nav2's scale, the first row at the smallest y."""


def colours_of(robots: int) -> list[Colour]:
    """A colour for each robot; shades by number where there are more than colours that can be told apart."""
    return list(OKABE_ITO[:robots]) if robots <= NAMED else list(sequence(robots))


def draw_map(axes: Axes, static_map: MapLike) -> None:
    """Draws obstacles dark and unknown cells light grey, and fits the axes to the map."""
    table = np.zeros((UNKNOWN + 1, 4))  # free cells stay clear
    table[FREE + 1 : LETHAL + 1] = matplotlib.colors.to_rgba(_WALL)
    table[:, 3] = np.minimum(np.arange(UNKNOWN + 1) / LETHAL, 1.0)
    table[UNKNOWN] = matplotlib.colors.to_rgba(_UNKNOWN)
    Cells(axes, static_map.grid.extent, np.asarray(static_map.cost), levels(table))
    x_from, x_to, y_from, y_to = static_map.grid.extent
    axes.set_xlim(x_from, x_to)
    axes.set_ylim(y_from, y_to)


def levels(colours: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Colours as levels of eight bits, which for a map take an eighth of the memory of floating point numbers."""
    return np.rint(255 * colours).astype(np.uint8)


def draw_body(axes: Axes, pose: ArrayLike, radius: float, colour: Colour, reach: float) -> None:
    """Draws a robot as its body with an arrow of length `reach` (m) for the heading."""
    x, y, heading = np.asarray(pose, float)
    axes.add_patch(Circle((x, y), radius, fc=(1.0, 1.0, 1.0, 0.7), ec=colour, lw=0.9, zorder=4.5))
    axes.quiver(x, y, reach * np.cos(heading), reach * np.sin(heading), angles="xy", scale_units="xy", scale=1,
                units="inches", width=0.013, headwidth=4, headlength=4.5, color=colour, zorder=5)  # fmt: skip


def draw_goals(axes: Axes, goal: NDArray[np.float64], colours: Sequence[Colour]) -> None:
    """Draws goals [1 or N, 2] as stars, each in its robot's colour where there is one for each."""
    if len(goal) == 1 or len(goal) != len(colours):
        axes.plot(*goal.T, **GOAL, zorder=6)
        return
    for place, colour in zip(goal, colours, strict=True):
        axes.plot(*place, **GOAL | {"mfc": colour}, zorder=6)
