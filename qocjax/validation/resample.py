"""Bootstrap of two curves: over common seeds in pairs, or over the repetitions of each delay by themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qocjax import _checks
from qocjax.statistics.estimates import bootstrap_weights
from qocjax.validation.curves import Curve

__all__ = ["Interval", "Resampled", "hull", "percentiles", "resample"]

Array = NDArray[np.float64]

_TAILS = (0.025, 0.975)


@dataclass(frozen=True)
class Interval:
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Resampled:
    """Mean curves of B bootstrap samples; both curves have the same delays.

    Attributes:
        simulated: [B, D] s.
        measured: [B, D] s.
        paired: Whether a sample took the same seeds of both.
    """

    simulated: Array
    measured: Array
    paired: bool


def resample(simulated: Curve, measured: Curve, count: int = 2000, random: int = 0) -> Resampled:
    """Draws seeds with replacement, jointly where both curves have the same seeds.

    A seed is one run at every delay: it is drawn for the whole curve, so that what the delays owe to the seed in
    common stays in common. Repetitions without seeds (measured runs) are drawn at each delay by themselves; one alone
    cannot vary, and its error is not in the intervals.

    Args:
        simulated: S.
        measured: E.
        count: Bootstrap samples.
        random: Seed of the draws.
    """
    _checks.count("resamples", count, least=100)
    rng = np.random.default_rng(random)
    if simulated.seeds is not None and measured.seeds is not None:
        shared = [seed for seed in simulated.seeds if seed in set(measured.seeds)]
        if len(shared) == len(simulated.seeds) == len(measured.seeds):
            labels = [curve.of_seeds(shared).units for curve in (simulated, measured)]
            weights = bootstrap_weights(len(shared), labels[0] or labels[1], count, rng)
            both = (np.stack(simulated.of_seeds(shared).values), np.stack(measured.of_seeds(shared).values))
            return Resampled(weights @ both[0].T, weights @ both[1].T, True)
    return Resampled(_means(simulated, count, rng), _means(measured, count, rng), False)


def _means(curve: Curve, count: int, rng: np.random.Generator) -> Array:
    """[B, D]."""
    if curve.seeds is not None:
        return bootstrap_weights(len(curve.seeds), curve.units, count, rng) @ np.stack(curve.values).T
    return np.stack([bootstrap_weights(each.size, None, count, rng) @ each for each in curve.values], axis=1)


def percentiles(value: float, found: Array) -> Interval:
    """The percentile interval of a statistic; samples in which it is not defined are left out."""
    defined = found[np.isfinite(found)]
    if not defined.size:
        return Interval(value, float("nan"), float("nan"))
    low, high = np.quantile(defined, _TAILS)
    return Interval(value, float(low), float(high))


def hull(value: float, found: Array, least: float, most: float) -> Interval:
    """The smallest interval that holds the percentile and the basic one, within the statistic's range.

    For statistics that noise moves one way only, as it takes off a rank correlation and adds to an error: samples
    repeat that bias, so the percentile interval misses the truth on one side and the basic one, which takes the bias
    off twice, now and then on the other.
    """
    inner = percentiles(value, found)
    low, high = min(inner.low, 2.0 * value - inner.high), max(inner.high, 2.0 * value - inner.low)
    return Interval(value, float(np.clip(low, least, most)), float(np.clip(high, least, most)))
