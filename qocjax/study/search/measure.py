"""What of the QoC over seeds is maximised: its mean, or the mean of its worst part (CVaR)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from qocjax import _checks
from qocjax.study.statistics import Estimate, paired, standard_error

__all__ = ["MEASURES", "Measure"]

MEASURES = ("mean", "cvar")


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

    def interval(self, scores: ArrayLike, confidence: float = 0.95) -> Estimate:
        """The measure with its interval: Student's for the mean, a bootstrap for CVaR."""
        return self.difference(scores, np.zeros_like(np.asarray(scores, np.float64)), confidence)

    def difference(self, scores: ArrayLike, others: ArrayLike, confidence: float = 0.95) -> Estimate:
        """The measure of `scores` less that of `others` over common seeds [S]: paired Student, or paired bootstrap.

        Raises:
            ValueError: Different lengths, or fewer than two seeds.
        """
        a, b = np.asarray(scores, np.float64), np.asarray(others, np.float64)
        if self.name == "mean" or np.array_equal(a, b):
            return paired(a, b, confidence)
        paired(a, b)  # checks the shapes
        found = stats.bootstrap(
            (a, b), lambda x, y, axis=-1: self(x, axis) - self(y, axis), paired=True, vectorized=True,
            n_resamples=2000, confidence_level=confidence, method="percentile", random_state=np.random.default_rng(0),
        )  # fmt: skip
        low, high = found.confidence_interval
        return Estimate(float(self(a) - self(b)), float(found.standard_error), float(low), float(high))
