"""Draws the maps of the scenarios: a hall, a warehouse aisle, a doorway and a junction of aisles.

    python experiments/maps/make_maps.py conf/maps

Writes a PGM image and its ROS map file for each. Robots of the size of a TurtleBot 3 (radius 0.105 m) fit through all
of them with room to spare; widths are said beside each room.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np

from qocjax.navigation import Grid, Rectangle, map_of_shapes

RESOLUTION = 0.05  # m
WALL = 0.1  # m
FREE, OCCUPIED = 254, 0  # grey of a pixel, as map_saver writes it


@dataclass(frozen=True)
class Room:
    """A rectangular room within four walls.

    Attributes:
        words: What it is, for the map file.
        low: Inner corner (m, m).
        high: The corner across (m, m).
        boxes: What stands in it: from x, to x, from y, to y (m).
    """

    words: str
    low: tuple[float, float]
    high: tuple[float, float]
    boxes: tuple[tuple[float, float, float, float], ...] = ()

    @property
    def grid(self) -> Grid:
        """The cells of the room and its walls."""
        return Grid.covering(tuple(v - WALL for v in self.low), tuple(v + WALL for v in self.high), RESOLUTION)

    def occupied(self) -> np.ndarray:
        """Whether a cell is an obstacle, [rows, cols]."""
        x_from, x_to, y_from, y_to = self.grid.extent
        walls = (
            (x_from, x_to, y_from, y_from + WALL), (x_from, x_to, y_to - WALL, y_to),
            (x_from, x_from + WALL, y_from, y_to), (x_to - WALL, x_to, y_from, y_to),
        )  # fmt: skip
        return map_of_shapes(self.grid, map(rectangle, (*walls, *self.boxes))).cost > 0


def rectangle(box: tuple[float, float, float, float]) -> Rectangle:
    """The shape of a box."""
    x_from, x_to, y_from, y_to = box
    return Rectangle(((x_from + x_to) / 2, (y_from + y_to) / 2), (x_to - x_from, y_to - y_from))


ROOMS = {
    # The paper names the hall (KTH R1) but not its size: a part of it that leaves 1 m and more around the robots.
    "hall": Room(
        "A hall of 7.0 m x 5.6 m with two pillars and two cabinets at its walls",
        (-3.4, -2.8), (3.6, 2.8),
        ((-0.2, 0.2, 2.0, 2.4), (-0.2, 0.2, -2.4, -2.0), (1.6, 2.8, 2.4, 2.8), (-3.4, -3.0, -0.6, 0.6)),
    ),
    # Racks 0.8 m deep and 4 m long; two aisles 1.4 m wide, joined at both ends.
    "aisle": Room(
        "A warehouse of 8.0 m x 5.2 m with three racks and two aisles, 1.4 m wide",
        (-4.0, -2.6), (4.0, 2.6),
        ((-2.0, 2.0, 1.8, 2.6), (-2.0, 2.0, -0.4, 0.4), (-2.0, 2.0, -2.6, -1.8)),
    ),
    # A wall 0.1 m thick with a door of 0.9 m in its middle.
    "doorway": Room(
        "Two rooms of 3.2 m x 4.4 m with a door, 0.9 m wide",
        (-3.25, -2.2), (3.25, 2.2),
        ((-0.05, 0.05, -2.2, -0.45), (-0.05, 0.05, 0.45, 2.2)),
    ),
    # Four blocks of racks; aisles 1.6 m wide that cross in the middle.
    "junction": Room(
        "Two aisles that cross, 1.6 m wide",
        (-3.4, -3.4), (3.4, 3.4),
        tuple((*x, *y) for x in ((-2.2, -0.8), (0.8, 2.2)) for y in ((-2.2, -0.8), (0.8, 2.2))),
    ),
}  # fmt: skip


def write(name: str, room: Room, folder: Path) -> None:
    """Writes the image, its first row on top, and the map file beside it."""
    pixels = np.where(room.occupied(), OCCUPIED, FREE).astype(np.uint8)[::-1]
    header = f"P5\n{pixels.shape[1]} {pixels.shape[0]}\n255\n".encode()
    (folder / f"{name}.pgm").write_bytes(header + pixels.tobytes())
    x, y = room.grid.origin
    lines = [
        f"# {room.words}. Drawn by experiments/maps/make_maps.py.",
        f"image: {name}.pgm",
        f"resolution: {RESOLUTION}  # m",
        f"origin: [{x:g}, {y:g}, 0.0]  # m, m, rad: the lower left corner",
        "negate: 0",
        "occupied_thresh: 0.65",
        "free_thresh: 0.25",
    ]  # fmt: skip
    (folder / f"{name}.yaml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Writes all maps."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="where the maps go")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    for name, room in ROOMS.items():
        write(name, room, folder)


if __name__ == "__main__":
    main()
