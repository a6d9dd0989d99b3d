"""Where a fleet leaves what is asked of it: the largest number of robots, the fewest blocks or workers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from qocjax import _checks
from qocjax._lazy import special
from qocjax.fleets.point import Point
from qocjax.statistics.estimates import resampled
from qocjax.study.choosing import least_seeds

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Asked", "Crossing", "crossing", "keeps", "largest_fleet"]

_RESAMPLES = 2000


@dataclass(frozen=True)
class Asked:
    """What a fleet must reach.

    Attributes:
        qoc: Mean QoC, at least.
        collision_share: Share of runs in which two robots come closer than two radii, at most: the upper end of its
            95 % interval is held to it, or the share itself where so few seeds could not show it whatever they gave.
    """

    qoc: float
    collision_share: float

    def __post_init__(self) -> None:
        _checks.bounded("fleet.target", self.qoc, above=0.0, most=1.0)
        _checks.bounded("fleet.max_collision_share", self.collision_share, least=0.0, most=1.0)

    @property
    def least_seeds(self) -> float:
        """Seeds that show the limit where none of them collides; inf for a limit of 0, which none show."""
        return least_seeds(self.collision_share) if self.collision_share > 0.0 else float("inf")

    def too_close(self, fleets: pd.DataFrame | Mapping[str, Any]) -> np.ndarray:
        """Which fleets (rows, or one) break the limit on collisions."""
        share, high = (np.asarray(fleets[f"collision_{end}"], float) for end in ("share", "high"))
        few = np.asarray(fleets["seeds"]) < self.least_seeds
        return np.where(few, share, high) > self.collision_share

    def not_shown(self, fleets: pd.DataFrame | Mapping[str, Any]) -> np.ndarray:
        """Which fleets keep the limit by their share alone, on too few seeds to show it."""
        return ~self.too_close(fleets) & (np.asarray(fleets["collision_high"], float) > self.collision_share)


@dataclass(frozen=True)
class Crossing:
    """Where mean QoC crosses the target between two values of an axis, linear in its logarithm."""

    value: float | None  # None where it does not
    low: float | None  # 95 % bootstrap interval over seeds, for few of them as wide as Student's; None beyond the axis
    high: float | None
    beyond: str  # "": on the axis; "below": even the first value misses the target; "above": even the last keeps it


def crossing(
    axis: ArrayLike, scores: Sequence[np.ndarray], target: float, units: np.ndarray | None = None, random: int = 0
) -> Crossing:
    """Where a score that falls along an axis passes a target.

    Args:
        axis: [C] positive, ascending.
        scores: For each value its scores by seed, [S], all on the same seeds: what they owe to a seed stays together.
        target: The score to keep.
        units: [S] Labels of the seeds, see `units_of`.
        random: Seed of the bootstrap.

    Raises:
        ValueError: Different numbers of seeds.
    """
    if len({len(each) for each in scores}) != 1:
        raise ValueError(f"scores: got {[len(each) for each in scores]} seeds, expected the same at every value")
    table, places = np.array(scores), np.log(np.asarray(axis, float))  # [C, S], [C]
    seeds = table.shape[1]
    own = _last(places, table.mean(axis=1)[None], target)[0]
    drawn = resampled(seeds, units, _RESAMPLES, random)
    tail = _tail(seeds if units is None else np.unique(units).size)
    low, high = np.quantile(_last(places, table[:, drawn].mean(axis=2).T, target), [tail, 1 - tail],
                            method="inverted_cdf")  # fmt: skip
    beyond = "below" if own == -np.inf else "above" if own == np.inf else ""
    value, first, last = (float(np.exp(each)) if np.isfinite(each) else None for each in (own, low, high))
    return Crossing(value, first, last, beyond)


def _tail(seeds: int) -> float:
    """Share of resamples on each side of the interval: of few seeds they spread less than Student's law says."""
    if seeds < 2:
        return 0.0
    return float(special().ndtr(special().stdtrit(seeds - 1, 0.025) * np.sqrt(seeds / (seeds - 1))))


def keeps(point: Point, asked: Asked) -> bool:
    """Whether a fleet reaches what is asked."""
    return bool(point.scores.mean() >= asked.qoc and not asked.too_close(point.row))


def largest_fleet(points: Sequence[Point], asked: Asked) -> int | None:
    """The largest number of robots simulated up to which every fleet reaches what is asked; None where none does."""
    kept = None
    for point in sorted(points, key=lambda each: each.robots):
        if not keeps(point, asked):
            break
        kept = point.robots
    return kept


def _last(places: np.ndarray, means: np.ndarray, target: float) -> np.ndarray:
    """Where the means [B, C] first fall below the target; -inf where they begin there, inf where they never do."""
    falls = means < target
    first = np.argmax(falls, axis=1)
    row = np.arange(len(means))
    before, after = means[row, np.maximum(first - 1, 0)], means[row, first]
    part = (before - target) / np.where(before > after, before - after, 1.0)
    at = places[np.maximum(first - 1, 0)] + part * (places[first] - places[np.maximum(first - 1, 0)])
    return np.where(~falls.any(axis=1), np.inf, np.where(first == 0, -np.inf, at))
