"""Which known robot a recorded one is like."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Nearest", "Preset", "nearest_preset"]

_OVER = 0.1  # share by which a robot may be seen beyond the caps of a preset: noise, and what its maker left
_UNDER = 0.15  # share by which its speed may stay below
_SIZE = 0.2  # share of the radius within which
_OF_TURN = 0.1  # how much a turn rate counts beside a speed


@dataclass(frozen=True)
class Preset:
    """A known robot; m/s, rad/s, m."""

    name: str
    v_max: float
    omega_max: float
    radius: float


@dataclass(frozen=True)
class Nearest:
    """The preset that is least far from what was seen, and by how much: what was seen over the preset's, less 1."""

    name: str
    near: bool  # whether it may be that robot
    v_max: float
    omega_max: float | None  # None where it hardly turned
    radius: float | None  # None where nothing tells the size


def nearest_preset(
    v_max: float | None, omega_max: float | None, radius: float | None, presets: Sequence[Preset]
) -> Nearest | None:
    """The preset nearest to what was seen; speed counts first, as robots drive at their cap, and seldom turn at it.

    A preset is near where the speed is 85 to 110 % of its cap, the turn rate at most 110 %, and the radius within 20 %.

    Args:
        v_max: Cap seen (m/s); without one there is none.
        omega_max: Cap seen (rad/s), if any.
        radius: That holds the footprint (m), if any.
        presets: Of which to choose.
    """
    if v_max is None or not presets:
        return None
    found = []
    for each in presets:
        apart = [None if seen is None else seen / of - 1.0
                 for seen, of in ((v_max, each.v_max), (omega_max, each.omega_max), (radius, each.radius))]  # fmt: skip
        v, omega, size = apart
        assert v is not None
        near = -_UNDER <= v <= _OVER and (omega is None or omega <= _OVER) and (size is None or abs(size) <= _SIZE)
        turn, wide = (0.0 if share is None else abs(math.log1p(share)) for share in (omega, size))
        found.append((not near, abs(math.log1p(v)) + _OF_TURN * turn + wide, Nearest(each.name, near, v, omega, size)))
    return min(found, key=lambda each: each[:2])[2]
