"""What of the QoC over seeds is maximised: its mean, or the mean of its worst part (CVaR)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from qocjax import _checks
from qocjax.statistics.estimates import Estimate, resampled, standard_error
from qocjax.statistics.scores import Scored, Scores

__all__ = ["MEASURES", "Measure"]

MEASURES = ("mean", "cvar")

_RESAMPLES = 2000
_STEP = 1e-6  # of ln J_med


@dataclass(frozen=True)
class Measure:
    """A number from the QoC of S seeds.

    Attributes:
        name: `mean`, or `cvar`: the mean of the worst seeds (Rockafellar and Uryasev, 2000).
        tail: Which share of the seeds is the worst part.
    """

    name: str = "mean"
    tail: float = 0.1

    def __post_init__(self) -> None:
        _checks.choice("measure", self.name, MEASURES)
        _checks.bounded("tail", self.tail, above=0, most=1, shape=())

    def __call__(self, scores: ArrayLike, axis: int = -1) -> np.ndarray:
        """The measure over the seeds of [..., S]; the seed at the edge of the tail counts by the part inside."""
        values = np.asarray(scores, np.float64)
        if self.name == "mean":
            return values.mean(axis=axis)
        ordered = np.sort(values, axis=axis)
        count = values.shape[axis]
        weights = np.clip(self.tail * count - np.arange(count), 0.0, 1.0)
        return np.moveaxis(ordered, axis, -1) @ (weights / weights.sum())

    def error(self, scores: ArrayLike) -> np.ndarray:
        """Standard error over the seeds of [..., S]; for CVaR that of the mean of the tail, from its seeds."""
        values = np.asarray(scores, np.float64)
        if self.name == "mean":
            return standard_error(values)
        count = max(2, int(np.ceil(self.tail * values.shape[-1])))
        return standard_error(np.sort(values, axis=-1)[..., :count])

    def interval(self, scores: Scores, confidence: float = 0.95) -> Scored:
        """The measure of scores [S] with its two intervals: Student's for the mean, a bootstrap for CVaR."""
        nothing = np.zeros_like(scores.values)
        return self.difference(scores, replace(scores, values=nothing, slopes=nothing), confidence)

    def difference(self, scores: Scores, others: Scores, confidence: float = 0.95) -> Scored:
        """The measure of `scores` less that of `others` over common seeds [S]: paired Student, or paired bootstrap.

        The error of J_med widens the bootstrap's interval by the slope of the measure.

        Raises:
            ValueError: Different lengths, or fewer than two seeds.
        """
        student = (scores - others).mean(confidence)
        if self.name == "mean" or np.array_equal(scores.values, others.values):
            return student
        drawn = resampled(scores.values.size, scores.units, _RESAMPLES)
        found = self(scores.values[drawn]) - self(others.values[drawn])
        value = float(self(scores.values) - self(others.values))
        low, high = np.quantile(found, [(1.0 - confidence) / 2.0, (1.0 + confidence) / 2.0])
        se, slope = float(np.std(found, ddof=1)), self._slope(scores) - self._slope(others)
        whole = float(np.hypot(se, slope * scores.scale.median_se / scores.scale.median))
        wider = whole / se if se > 0.0 else 1.0
        given = Estimate(value, se, float(low), float(high))
        return Scored(given, Estimate(value, whole, value - wider * (value - low), value + wider * (high - value)))

    def _slope(self, scores: Scores) -> float:
        """Derivative of the measure in ln J_med: that of the seeds of the tail."""
        return float(self(scores.values + _STEP * scores.slopes) - self(scores.values)) / _STEP
