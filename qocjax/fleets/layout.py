"""Where the robots of a fleet of any size start and where they go, at the same density whatever their number."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from qocjax import _checks
from qocjax._room import check_room

__all__ = ["LAYOUTS", "Layout"]

Poses = tuple[np.ndarray, np.ndarray]  # start poses [N, 3] (m, m, rad), goals [N, 2] (m)


@dataclass(frozen=True)
class Layout:
    """A scenario for any number of robots, each with a goal of its own.

    Attributes:
        kind: `lanes`: side by side, every other one the other way, so that each meets two others at arm's length.
            `circle`: on a circle that grows with their number, each to another place on it; their ways cross.
            `apart`: as `lanes`, but so far from each other that robots never meet: what is left is the network.
        spacing: From one robot to the next at the start (m); not read by `apart`.
        length: That each robot has to go (m).
    """

    kind: str = "lanes"
    spacing: float = 1.2
    length: float = 4.0

    def __post_init__(self) -> None:
        _checks.choice("fleet.layout.kind", self.kind, LAYOUTS)
        for name in ("spacing", "length"):
            _checks.bounded(f"fleet.layout.{name}", getattr(self, name), above=0.0, shape=())

    def place(self, num_robots: int) -> Poses:
        """Start poses [N, 3] (m, m, rad) and goals [N, 2] (m) of N robots."""
        _checks.count("num_robots", num_robots)
        check_room("robots", f"{num_robots:.4g} of them", 200 * num_robots, "fewer")
        return LAYOUTS[self.kind](num_robots, self.spacing, self.length)


def _lanes(num_robots: int, spacing: float, length: float) -> Poses:
    robot = np.arange(num_robots)
    across = (robot - 0.5 * (num_robots - 1)) * spacing
    way = np.where(robot % 2 == 0, 1.0, -1.0)
    start = np.stack([-0.5 * length * way, across, np.where(way > 0, 0.0, np.pi)], axis=1)
    return start, np.stack([0.5 * length * way, across], axis=1)


def _circle(num_robots: int, spacing: float, length: float) -> Poses:
    radius = max(0.5 * length, num_robots * spacing / (2.0 * np.pi))
    begin = 2.0 * np.pi * np.arange(num_robots) / num_robots
    end = begin + 2.0 * np.arcsin(0.5 * length / radius)
    start, goal = (radius * np.stack([np.cos(angle), np.sin(angle)], axis=1) for angle in (begin, end))
    heading = np.arctan2(*(goal - start).T[::-1])
    return np.column_stack([start, heading]), goal


def _apart(num_robots: int, spacing: float, length: float) -> Poses:
    return _lanes(num_robots, 3.0 * length, length)


LAYOUTS: dict[str, Callable[[int, float, float], Poses]] = {"lanes": _lanes, "circle": _circle, "apart": _apart}
