"""The margin of a deadline: how far it may move until a target is missed (model, section 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from qocjax.advice.reaching import NONE_ABOVE, NONE_BELOW, Bound, bound_of, last_reached
from qocjax.advice.target import Target
from qocjax.statistics.estimates import Estimate, estimate

__all__ = ["Margin", "deadline_margin"]


@dataclass(frozen=True)
class Margin:
    """Deadlines around the best one, between which a target is kept."""

    target: Target
    best: float  # deadline of the best mean merit, s
    merit: Estimate  # its mean there
    low: Bound  # s
    high: Bound  # s
    safety: str = (
        "kept"  # whether collisions keep their limit between them: kept, not shown, or broken at every deadline
    )

    @property
    def reached(self) -> bool:
        """Whether the best reaches the target."""
        return self.merit.mean >= self.target.level(self.merit.mean)

    @property
    def best_text(self) -> str:
        """The best in words."""
        return f"{self.target.reading(self.merit)}, at {1e3 * self.best:.4g} ms"

    def holds(self, deadline: float) -> bool:
        """Whether a deadline (s) lies within."""
        low, high = self.ends
        return self.reached and low * (1 - 1e-9) <= deadline <= high * (1 + 1e-9)

    @property
    def ends(self) -> tuple[float, float]:
        """Where it begins and ends (s): at the best deadline, if not even that one reaches the target."""
        low, high = (bound.value if bound.value is not None else self.best for bound in (self.low, self.high))
        return low, high


def deadline_margin(
    deadlines: ArrayLike,
    merits: ArrayLike,
    target: Target | None = None,
    units: np.ndarray | None = None,
    excess: ArrayLike = 0.0,
) -> Margin:
    """The stretch of deadlines around the best in which mean merits reach a target, and nothing else its limit.

    Args:
        deadlines: [D] s, ascending.
        merits: [D, S] by seed, common to all deadlines; of `Target.merits`.
        target: What is to be kept.
        units: [S] Labels of the seeds, see `units_of`.
        excess: [D] By how much something else breaks its limit, at most 0 within the margin; of `collision_excess`.

    Raises:
        ValueError: Shapes that do not fit, deadlines that do not ascend, an excess everywhere, or fewer than two seeds.
    """
    axis, table, target = np.asarray(deadlines, float), np.asarray(merits, float), target or Target()
    over = np.broadcast_to(np.asarray(excess, float), axis.shape)
    if table.ndim != 2 or axis.shape != table.shape[:1] or not np.all(np.diff(axis) > 0):
        raise ValueError(f"deadlines: got {axis.shape} for merits {table.shape}, expected ascending [D] for [D, S]")
    if over.min() > 0.0:
        raise ValueError(f"excess: got {over.min():g} and more, expected a deadline at least with 0 or less")
    if table.shape[1] < 2:
        raise ValueError(f"seeds: got {table.shape[1]}, expected at least 2 for an interval")
    mean = table.mean(axis=1)
    k = int(np.argmax(np.where(over <= 0.0, mean, -np.inf)))

    def end(which: int, means: np.ndarray) -> np.ndarray:
        return np.array([_stretch(axis, column, over, target)[which] for column in means.T])

    low, high = (bound_of(table, lambda means, i=i: end(i, means), axis[-i], units) for i in (0, 1))  # type: ignore[misc]
    return Margin(target, float(axis[k]), estimate(table[k], units=units), low, high)


def _stretch(axis: np.ndarray, means: np.ndarray, excess: np.ndarray, target: Target) -> tuple[float, float]:
    """Ends of the contiguous stretch about the best, linear between points of the axis."""
    k = int(np.argmax(np.where(excess <= 0.0, means, -np.inf)))
    level = target.level(means[k])
    low, high = (
        last_reached(axis[part], means[part, None], level, none, excess=excess[part], contiguous=True)[0]
        for part, none in ((slice(k, None, -1), NONE_ABOVE), (slice(k, None), NONE_BELOW))
    )
    return float(low), float(high)
