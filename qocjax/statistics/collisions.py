"""The share of runs in which robots come closer than two radii to each other, as far as runs tell (model, section 5).

Pairs of robots count and nothing else: how close a robot comes to a wall of its map is no collision here. So a robot by
itself has nobody to collide with, however few runs there are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from qocjax.statistics.estimates import Estimate, share

__all__ = ["ALONE", "collision_share", "is_alone"]

ALONE = "one robot: nobody to collide with"


def collision_share(
    collided: ArrayLike, robots: int, units: np.ndarray | None = None, like: ArrayLike | None = None
) -> Estimate:
    """Share of runs with a collision and its 95 % interval; of one robot 0, which no run has to show.

    Args:
        collided: [S] Which runs collided.
        robots: How many there are.
        units: [S] Labels of the seeds, see `standard_error`.
        like: [S] What else these runs gave, see `share`.

    Raises:
        ValueError: Fewer than two seeds or units.
    """
    found = share(collided, units, like=like)
    return found if robots > 1 else Estimate(found.mean, 0.0, found.mean, found.mean)


def is_alone(upper: float) -> bool:
    """Whether the upper end of a share says that nobody is there to collide with: any other one is above 0."""
    return upper == 0.0
