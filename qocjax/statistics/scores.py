"""QoC of a design with two intervals: given its scale, and with what is not known of the scale (model, section 5).

QoC moves with ln J_med by Q (1 - Q), from J_max on too. So the error of J_med moves a mean of QoC by its mean slope,
and two designs together; where the same seeds or stretches of a trace made both, the two errors are added seed by seed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from qocjax.quality import QocScale, qoc
from qocjax.statistics.estimates import Estimate, estimate, student, unpaired
from qocjax.statistics.scales import StudyScale

__all__ = ["Scored", "Scores", "seed_scores", "unpaired_scores"]


class Scored(NamedTuple):
    """A mean over seeds."""

    given: Estimate  # the scale taken as it is
    whole: Estimate  # with the error of J_med in it

    def columns(self, name: str) -> dict[str, float]:
        """Columns of a table: the mean, and both intervals."""
        return {
            name: self.given.mean, f"{name}_se": self.given.se, f"{name}_low": self.given.low,
            f"{name}_high": self.given.high, f"{name}_whole_se": self.whole.se, f"{name}_whole_low": self.whole.low,
            f"{name}_whole_high": self.whole.high,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Scores:
    """QoC of designs by seed on one scale, and how it moves with J_med."""

    values: np.ndarray  # [..., S] mean over robots
    slopes: np.ndarray  # [..., S] dQ / d ln J_med, mean over robots
    scale: QocScale
    units: np.ndarray | None = None  # [S] labels of the seeds, see `units_of`; None for seeds that the scale has not

    @classmethod
    def of(cls, auc: np.ndarray, scale: QocScale, units: np.ndarray | None = None) -> Scores:
        """Scores of AUC [..., S, N]; a diverged run, of AUC infinite or NaN, counts as the largest."""
        costs = np.asarray(auc, np.float64)
        each = np.asarray(qoc(np.where(np.isnan(costs), np.inf, costs), scale))
        return cls(each.mean(axis=-1), (each * (1.0 - each)).mean(axis=-1), scale, units)

    def __getitem__(self, place: Any) -> Scores:
        """Some of the designs."""
        return replace(self, values=self.values[place], slopes=self.slopes[place])

    def on(self, seeds: slice | np.ndarray) -> Scores:
        """The same designs on some of the seeds."""
        units = None if self.units is None else self.units[seeds]
        return replace(self, values=self.values[..., seeds], slopes=self.slopes[..., seeds], units=units)

    def __sub__(self, other: Scores) -> Scores:
        """Differences on the same seeds.

        Raises:
            ValueError: Different numbers of seeds.
        """
        if self.values.shape[-1] != other.values.shape[-1]:
            raise ValueError(f"others: got shape {other.values.shape}, expected {self.values.shape}: paired values "
                             "share their seeds")  # fmt: skip
        return replace(self, values=self.values - other.values, slopes=self.slopes - other.slopes)

    def mean(self, confidence: float = 0.95) -> Scored:
        """The mean over the seeds of one design, [S]."""
        given = estimate(self.values, confidence, self.units)
        if not self.scale.median_se > 0.0:
            return Scored(given, given)
        slope, observations = float(self.slopes.mean()) / self.scale.median, self.values.size
        if self.units is not None and isinstance(self.scale, StudyScale):
            own = (self.values - given.mean) / self.values.size
            theirs = slope * self.scale.influence / self.scale.influence.size
            se, observations = _joint(self.units, own, self.scale.units, theirs), np.unique(self.units).size
        else:
            se = float(np.hypot(given.se, slope * self.scale.median_se))
        half = se * student(observations, confidence)
        return Scored(given, Estimate(given.mean, se, given.mean - half, given.mean + half))


def seed_scores(auc: np.ndarray, scale: QocScale) -> np.ndarray:
    """QoC by seed [..., S] of AUC [..., S, N], as of `Scores`."""
    return Scores.of(auc, scale).values


def unpaired_scores(scores: Scores, others: Scores) -> Scored:
    """Difference of the mean QoC of one design to another on other seeds (Welch)."""
    given = unpaired(scores.values, others.values, units=(scores.units, others.units))
    slope = float(scores.slopes.mean() - others.slopes.mean()) / scores.scale.median
    se = float(np.hypot(given.se, slope * scores.scale.median_se))
    wider = se / given.se if given.se > 0.0 else 1.0
    half = wider * (given.high - given.mean)
    return Scored(given, Estimate(given.mean, se, given.mean - half, given.mean + half))


def _joint(labels: np.ndarray, own: np.ndarray, others: np.ndarray, theirs: np.ndarray) -> float:
    """Standard error of the sum of two sets of contributions; what has one label varies together."""
    if not (np.isfinite(own).all() and np.isfinite(theirs).all()):
        return float("inf")
    known, place = np.unique(np.concatenate([labels, others]), return_inverse=True)
    parts = []
    for each, at in ((own, place[: own.size]), (theirs, place[own.size :])):
        count = np.unique(at).size
        parts.append(np.bincount(at, each, known.size) * np.sqrt(count / (count - 1)))
    return float(np.sqrt(((parts[0] + parts[1]) ** 2).sum()))
