"""Means over seeds with what is known of their error: standard errors, Student intervals, paired differences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special  # not scipy.stats, which takes a third of a second to import

__all__ = ["Estimate", "estimate", "paired", "standard_error", "unpaired"]


@dataclass(frozen=True)
class Estimate:
    """A mean over seeds with its standard error and confidence interval."""

    mean: float
    se: float
    low: float
    high: float


def standard_error(values: ArrayLike, axis: int = -1) -> np.ndarray:
    """Standard error of the mean over `axis`; infinite where a value is not finite.

    Raises:
        ValueError: Fewer than two values along the axis: their spread is then unknown.
    """
    array = np.asarray(values, np.float64)
    if array.shape[axis] < 2:
        raise ValueError(f"seeds: got {array.shape[axis]}, expected at least 2 for a standard error")
    finite = np.isfinite(array).all(axis=axis, keepdims=True)
    spread = np.where(finite, array, 0.0).std(axis=axis, ddof=1)
    return np.where(np.squeeze(finite, axis), spread / np.sqrt(array.shape[axis]), np.inf)


def estimate(values: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Mean of independent values [S] with its Student interval.

    Raises:
        ValueError: Fewer than two values.
    """
    array = np.asarray(values, np.float64)
    mean, se = float(array.mean()), float(standard_error(array))
    half = se * float(special.stdtrit(array.size - 1, 0.5 + confidence / 2))
    return Estimate(mean, se, mean - half, mean + half)


def paired(values: ArrayLike, others: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Mean of `values - others` over common seeds [S]: what both owe to the seed cancels.

    Raises:
        ValueError: Different lengths, or fewer than two values.
    """
    a, b = np.asarray(values, np.float64), np.asarray(others, np.float64)
    if a.shape != b.shape:
        raise ValueError(f"others: got shape {b.shape}, expected {a.shape}: paired values share their seeds")
    return estimate(a - b, confidence)


def unpaired(values: ArrayLike, others: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Difference of the means of independent values [S] and [S'], with Welch's interval.

    Raises:
        ValueError: Fewer than two values in one of them.
    """
    first, second = estimate(values, confidence), estimate(others, confidence)
    parts = np.array([first.se, second.se]) ** 2
    freedom = np.array([np.size(values), np.size(others)]) - 1
    se, mean = float(np.sqrt(parts.sum())), first.mean - second.mean
    if not 0 < se < np.inf:
        return Estimate(mean, se, mean - se, mean + se)
    half = se * float(special.stdtrit(parts.sum() ** 2 / (parts**2 / freedom).sum(), 0.5 + confidence / 2))
    return Estimate(mean, se, mean - half, mean + half)
