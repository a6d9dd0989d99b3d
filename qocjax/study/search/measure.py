"""What of the QoC over seeds is maximised: its mean, or the mean of its worst part (CVaR)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from qocjax import _checks
from qocjax.study.scores import Scored, Scores
from qocjax.study.statistics import Estimate, resampled, standard_error

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
        if self.name == "mean":
            return scores.mean(confidence)
        return self._bootstrapped(scores, None, confidence)

    def difference(self, scores: Scores, others: Scores, confidence: float = 0.95) -> Scored:
        """The measure of `scores` less that of `others` over common seeds [S]: paired Student, or paired bootstrap.

        Raises:
            ValueError: Different lengths, or fewer than two seeds.
        """
        if self.name == "mean" or np.array_equal(scores.values, others.values):
            return (scores - others).mean(confidence)
        return self._bootstrapped(scores, others, confidence)

    def _bootstrapped(self, scores: Scores, others: Scores | None, confidence: float) -> Scored:
        """Percentiles over resampled observations; the error of J_med widens them by the slope of the measure."""
        (scores if others is None else scores - others).mean()  # checks the shapes
        sets = [scores] if others is None else [scores, others]
        drawn = resampled(scores.values.size, scores.units, _RESAMPLES)
        signs = (1.0, -1.0)
        found = sum(sign * self(each.values[drawn]) for sign, each in zip(signs, sets, strict=False))
        value = float(sum(sign * self(each.values) for sign, each in zip(signs, sets, strict=False)))
        low, high = np.quantile(np.asarray(found), [(1.0 - confidence) / 2.0, (1.0 + confidence) / 2.0])
        se = float(np.std(found, ddof=1))
        slope = float(sum(sign * self._slope(each) for sign, each in zip(signs, sets, strict=False)))
        whole = float(np.hypot(se, slope * scores.scale.median_se / scores.scale.median))
        wider = whole / se if se > 0.0 else 1.0
        given = Estimate(value, se, float(low), float(high))
        return Scored(given, Estimate(value, whole, value - wider * (value - low), value + wider * (high - value)))

    def _slope(self, scores: Scores) -> float:
        """Derivative of the measure in ln J_med: that of the seeds of the tail."""
        return float(self(scores.values + _STEP * scores.slopes) - self(scores.values)) / _STEP
