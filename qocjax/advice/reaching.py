"""How far along an axis a target is still reached: linear between its points, with a bootstrap interval."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from qocjax.statistics.estimates import bootstrap_weights

__all__ = ["NONE_ABOVE", "NONE_BELOW", "Bound", "bound_of", "last_reached", "reach"]

NONE_BELOW, NONE_ABOVE = -1.0, 1e9
"""What a statistic gives where the target is reached nowhere: no delay (s) and no probability, in order of rank."""

_RESAMPLES = 999


@dataclass(frozen=True)
class Bound:
    """An answer with its bootstrap interval; None is `not on the grid`: the target is met nowhere on it."""

    value: float | None
    low: float | None
    high: float | None
    at_edge: bool  # the grid ends there: the true bound may lie beyond
    low_at_edge: bool = False
    high_at_edge: bool = False


def reach(
    axis: ArrayLike,
    scores: ArrayLike,
    target: float,
    units: np.ndarray | None = None,
    excess: np.ndarray | None = None,
    contiguous: bool = False,
) -> Bound:
    """The last value of an ascending axis [C] at which mean scores [C, S] still reach a target, linear in between.

    A target that is a share of a mean is itself estimated: take that share of its scores off, seed by seed, and ask
    for 0.

    Args:
        axis: [C].
        scores: [C, S], the larger the better; the seeds are common to all values.
        target: To reach.
        units: [S] Labels of the seeds, see `units_of`.
        excess: [C] By how much something else breaks its limit, which has to be kept too.
        contiguous: Whether the first of the axis and all in between have to reach it.

    Raises:
        ValueError: Shapes that do not fit, or an axis that does not ascend from 0 or more.
    """
    values, table = np.asarray(axis, float), np.asarray(scores, float)
    if table.ndim != 2 or values.shape != table.shape[:1] or not np.all(np.diff(values, prepend=-1e-12) > 0):
        raise ValueError(f"axis: got {values.shape} for scores {table.shape}, expected ascending [C] for [C, S]")
    return bound_of(
        table,
        lambda means: last_reached(values, means, target, NONE_BELOW, excess=excess, contiguous=contiguous),
        values[-1],
        units,
    )


def last_reached(
    axis: np.ndarray,
    means: np.ndarray,
    target: float,
    none: float,
    *,
    excess: np.ndarray | None = None,
    contiguous: bool = False,
) -> np.ndarray:
    """Where means last reach a target along an axis, [B], linear in between.

    Args:
        axis: [C].
        means: [C, B].
        target: To reach.
        none: What to give where they never do.
        excess: [C] By how much something else breaks its limit, which has to be kept too.
        contiguous: Whether the first of the axis and all in between have to reach it.
    """
    over = np.zeros(axis.size) if excess is None else excess
    enough = (means >= target) & (over <= 0.0)[:, None]
    if contiguous:
        enough = np.logical_and.accumulate(enough, axis=0)
    size = axis.size
    last = size - 1 - np.argmax(enough[::-1], axis=0)
    after = np.minimum(last + 1, size - 1)
    b = np.arange(means.shape[1])
    part = np.minimum(
        _crossing(means[last, b] - target, means[after, b] - target), _crossing(-over[last], -over[after])
    )
    return np.where(enough.any(axis=0), axis[last] + part * (axis[after] - axis[last]), none)


def _crossing(here: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Which part of the way a line goes down to 0; all of it where it does not get there."""
    falls = (there < 0.0) & (here >= 0.0)
    return np.where(falls, here / np.where(falls, here - there, 1.0), 1.0)


def bound_of(
    scores: np.ndarray, statistic: Callable[[np.ndarray], np.ndarray], edge: float, units: np.ndarray | None = None
) -> Bound:
    """A statistic of means [C, B] over the seeds of scores [C, S], and its 95 % percentile bootstrap.

    Args:
        scores: [C, S].
        statistic: Gives [B], or `NONE_BELOW`, `NONE_ABOVE` where there is nothing.
        edge: Where the axis ends.
        units: [S] Labels of the seeds, see `units_of`.
    """
    weights = bootstrap_weights(scores.shape[1], units, _RESAMPLES)
    found = statistic(scores @ weights.T)
    value = float(statistic(scores.mean(axis=1, keepdims=True))[0])
    # Ranks, not interpolation: `not on the grid` is no number to average with.
    low, high = (float(q) for q in np.quantile(found, [0.025, 0.975], method="inverted_cdf"))
    plain = [None if number in (NONE_BELOW, NONE_ABOVE) else number for number in (value, low, high)]
    return Bound(plain[0], plain[1], plain[2], *(bool(np.isclose(each, edge)) for each in (value, low, high)))
