"""The static map of the hall as a picture under the robots."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import numpy as np

from qocjax.cost_values import LETHAL, UNKNOWN
from qocjax.navigation.maps import StaticMap

__all__ = ["HallMap", "hall_map"]

_LARGEST = 800  # pixels a side; cells of larger maps are drawn together


@dataclass(frozen=True)
class HallMap:
    """A picture and where it lies."""

    png: bytes
    extent: tuple[float, float, float, float]  # left, right, bottom, top (m)


def hall_map(room: StaticMap) -> HallMap:
    """A map in greys that suit light and dark pages: the costlier the stronger, unknown faint."""
    cost = _pooled(np.where(room.cost == UNKNOWN, 60, 230 * np.minimum(room.cost.astype(int), LETHAL) // LETHAL))
    picture = np.empty((*cost.shape, 4), np.uint8)
    picture[..., :3] = 120, 128, 138
    picture[..., 3] = cost[::-1]  # a picture begins at the top
    left, _, bottom, _ = room.grid.extent
    side = room.grid.resolution * _factor(room.cost)
    return HallMap(_png(picture), (left, left + side * cost.shape[1], bottom, bottom + side * cost.shape[0]))


def _factor(cost: np.ndarray) -> int:
    return -(-max(cost.shape) // _LARGEST)


def _pooled(cost: np.ndarray) -> np.ndarray:
    """Squares of cells as one, as costly as the costliest of them."""
    factor = _factor(cost)
    padded = np.pad(cost, [(0, -n % factor) for n in cost.shape])
    rows, columns = (n // factor for n in padded.shape)
    return padded.reshape(rows, factor, columns, factor).max(axis=(1, 3))


def _png(pixels: np.ndarray) -> bytes:
    """A PNG file of RGBA pixels [rows, columns, 4]."""

    def part(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    rows, columns = pixels.shape[:2]
    lines = b"".join(b"\0" + row.tobytes() for row in pixels)  # each line says that it is not filtered
    head = struct.pack(">IIBBBBB", columns, rows, 8, 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + part(b"IHDR", head) + part(b"IDAT", zlib.compress(lines, 6)) + part(b"IEND", b"")
