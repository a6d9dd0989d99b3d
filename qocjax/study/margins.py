"""How much slack a network leaves: QoC over delay and reliability apart, and the inverse questions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import stats

from qocjax import _checks
from qocjax.network import Constant, IndependentLoss, Leg, LoopNetwork
from qocjax.scenario import Design
from qocjax.study.objective import Objective
from qocjax.study.statistics import bootstrap_weights

__all__ = [
    "Bound",
    "Margin",
    "Plane",
    "deadline_margin",
    "delay_reliability_plane",
    "largest_delay",
    "reach",
    "smallest_reliability",
]

_RESAMPLES = 999
_NONE_BELOW, _NONE_ABOVE = -1.0, 2.0  # what a statistic returns where the target is not met: no delay, no probability


@dataclass(frozen=True)
class Plane:
    """QoC where every loop takes the same time, which is the deadline, and completes with the same probability."""

    delay: np.ndarray  # [D] s, ascending
    reliability: np.ndarray  # [F] ascending
    scores: np.ndarray  # [F, D, S] QoC by seed; seeds are common to all cells

    @property
    def qoc(self) -> np.ndarray:
        """Mean over seeds, [F, D]."""
        return self.scores.mean(axis=-1)

    def to_table(self) -> pd.DataFrame:
        """One row per cell: delay (s), reliability, qoc and its standard error."""
        reliability, delay = np.meshgrid(self.reliability, self.delay, indexing="ij")
        se = stats.sem(self.scores, axis=-1)
        cells = {"delay": delay, "reliability": reliability, "qoc": self.qoc, "qoc_se": se}
        return pd.DataFrame({name: values.ravel() for name, values in cells.items()})


@dataclass(frozen=True)
class Bound:
    """An answer with its bootstrap interval; None is `not on the grid`: the target is met nowhere on it."""

    value: float | None
    low: float | None
    high: float | None
    at_edge: bool  # the grid ends there: the true bound may lie beyond
    low_at_edge: bool = False
    high_at_edge: bool = False


@dataclass(frozen=True)
class Margin:
    """Deadlines around the best one, within which QoC loses no more than a share of its best."""

    share: float
    best: float  # deadline of the best QoC, s
    qoc: float  # there
    low: Bound  # s
    high: Bound  # s


def delay_reliability_plane(
    objective: Objective, design: Design, delays: Sequence[float], reliabilities: Sequence[float], seeds: Sequence[int]
) -> Plane:
    """QoC of a design's gains on a grid of constant delay and independent completion.

    Args:
        objective: The setting; its network is not read, its simulations are counted.
        design: Numbers; its deadline is not read: it is the delay.
        delays: [D] s.
        reliabilities: [F] completion probabilities.
        seeds: [S] at least two.

    Raises:
        ValueError: A delay below 0, a probability outside [0, 1], one twice, or fewer than two seeds.
    """
    delay, reliability = _axis("delays", delays, None), _axis("reliabilities", reliabilities, 1.0)
    _check_seeds(len(seeds))
    scores = np.stack([_row(objective, design, delay, float(share), seeds) for share in reliability])
    return Plane(delay, reliability, scores)


def _row(objective: Objective, design: Design, delay: np.ndarray, share: float, seeds: Sequence[int]) -> np.ndarray:
    """QoC at one reliability, [D, S]."""
    loss = Leg(loss=IndependentLoss(1.0 - share))
    # When a command takes effect depends on the deadline alone, so one network serves all delays; not so on arrival.
    apart = objective.rules.actuation == "arrival"
    parts = []
    for some in np.split(delay, delay.size) if apart else [delay]:
        compute = Constant(float(some[0])) if apart else Constant()
        setting = replace(objective, network=LoopNetwork(uplink=loss, compute=compute, name="plane"), simulations=0)
        parts.append(setting.scores(replace(design, deadline=some), seeds))
        objective.simulations += setting.simulations
    return np.concatenate(parts)


def largest_delay(plane: Plane, target: float, reliability: float) -> Bound:
    """Largest constant delay at which QoC still reaches `target`, at a given reliability within the plane's.

    Raises:
        ValueError: The reliability lies outside the plane.
    """
    return reach(plane.delay, _at(plane.reliability, plane.scores, "reliability", reliability), target)


def reach(axis: ArrayLike, scores: ArrayLike, target: float, units: np.ndarray | None = None) -> Bound:
    """The last value of an ascending axis [C] at which mean QoC [C, S] still reaches a target, linear in between.

    A target that is a share of a mean is itself estimated: take that share of its scores off, seed by seed, and ask
    for 0.

    Args:
        axis: [C].
        scores: [C, S], the seeds common to all values.
        target: To reach.
        units: [S] Labels of the seeds, see `units_of`.

    Raises:
        ValueError: Shapes that do not fit, or an axis that does not ascend from 0 or more.
    """
    values, table = np.asarray(axis, float), np.asarray(scores, float)
    if table.ndim != 2 or values.shape != table.shape[:1] or not np.all(np.diff(values, prepend=-1e-12) > 0):
        raise ValueError(f"axis: got {values.shape} for scores {table.shape}, expected ascending [C] for [C, S]")
    return _bound(table, lambda qoc: _last(values, qoc, target, _NONE_BELOW), values[-1], units)


def smallest_reliability(plane: Plane, target: float, delay: float) -> Bound:
    """Smallest reliability at which QoC reaches `target`, at a given constant delay (s) within the plane's.

    Raises:
        ValueError: The delay lies outside the plane.
    """
    column = _at(plane.delay, np.swapaxes(plane.scores, 0, 1), "delay", delay)
    axis = plane.reliability[::-1]
    return _bound(column[::-1], lambda qoc: _last(axis, qoc, target, _NONE_ABOVE), plane.reliability[0])


def deadline_margin(
    deadlines: ArrayLike, scores: ArrayLike, share: float = 0.05, units: np.ndarray | None = None
) -> Margin:
    """The stretch of deadlines around the best in which mean QoC stays within `share` of its best.

    Args:
        deadlines: [D] s, ascending.
        scores: [D, S] QoC by seed, common to all deadlines.
        share: 0.05 asks for 95 % of the best.
        units: [S] Labels of the seeds, see `units_of`.

    Raises:
        ValueError: Shapes that do not fit, deadlines that do not ascend, fewer than two seeds, or a bad share.
    """
    axis, table = np.asarray(deadlines, float), np.asarray(scores, float)
    if table.ndim != 2 or axis.shape != table.shape[:1] or not np.all(np.diff(axis) > 0):
        raise ValueError(f"deadlines: got {axis.shape} for scores {table.shape}, expected ascending [D] for [D, S]")
    _check_seeds(table.shape[1])
    _checks.bounded("share", share, above=0, most=1)
    mean = table.mean(axis=1)
    k = int(np.argmax(mean))

    def end(which: int) -> Callable[[np.ndarray], np.ndarray]:
        return lambda qoc: np.array([_stretch(axis, column, share)[which] for column in qoc.T])

    low, high = (_bound(table, end(which), axis[-which], units) for which in (0, 1))
    return Margin(share, float(axis[k]), float(mean[k]), low, high)


def _stretch(axis: np.ndarray, qoc: np.ndarray, share: float) -> tuple[float, float]:
    """Ends of the contiguous stretch about the largest QoC, linear between grid points."""
    k = int(np.argmax(qoc))
    target = (1.0 - share) * qoc[k]
    ends = [_last(x, y[:, None], target, 0.0, contiguous=True)[0]
            for x, y in ((axis[k::-1], qoc[k::-1]), (axis[k:], qoc[k:]))]  # fmt: skip
    return float(ends[0]), float(ends[1])


def _last(axis: np.ndarray, qoc: np.ndarray, target: float, none: float, contiguous: bool = False) -> np.ndarray:
    """Where QoC [C, B] last reaches the target along the axis [C], linear in between; `none` where it never does."""
    enough = qoc >= target
    if contiguous:
        enough = np.logical_and.accumulate(enough, axis=0)
    size = axis.size
    last = size - 1 - np.argmax(enough[::-1], axis=0)
    after = np.minimum(last + 1, size - 1)
    b = np.arange(qoc.shape[1])
    fall = qoc[last, b] - qoc[after, b]
    part = np.where(fall > 0, (qoc[last, b] - target) / np.where(fall > 0, fall, 1.0), 0.0)
    return np.where(enough.any(axis=0), axis[last] + part * (axis[after] - axis[last]), none)


def _bound(
    scores: np.ndarray,
    statistic: Callable[[np.ndarray], np.ndarray],
    edge: float,
    units: np.ndarray | None = None,
) -> Bound:
    """A statistic of mean QoC [C, B], and its 95 % percentile bootstrap over the common seeds."""
    weights = bootstrap_weights(scores.shape[1], units, _RESAMPLES)
    found = statistic(scores @ weights.T)
    value = float(statistic(scores.mean(axis=1, keepdims=True))[0])
    # Ranks, not interpolation: `not on the grid` is no number to average with.
    low, high = (float(q) for q in np.quantile(found, [0.025, 0.975], method="inverted_cdf"))
    plain = [None if number in (_NONE_BELOW, _NONE_ABOVE) else number for number in (value, low, high)]
    return Bound(plain[0], plain[1], plain[2], *(bool(np.isclose(each, edge)) for each in (value, low, high)))


def _at(axis: np.ndarray, scores: np.ndarray, name: str, value: float) -> np.ndarray:
    """Scores [C, ., S] at a value between two points of the axis [C], [., S]."""
    _checks.bounded(name, value, least=float(axis[0]), most=float(axis[-1]))
    k = int(np.clip(np.searchsorted(axis, value) - 1, 0, max(axis.size - 2, 0)))
    if axis.size == 1:
        return scores[0]
    part = (value - axis[k]) / (axis[k + 1] - axis[k])
    return (1.0 - part) * scores[k] + part * scores[k + 1]


def _axis(name: str, values: Sequence[float], most: float | None) -> np.ndarray:
    axis = np.sort(np.atleast_1d(np.asarray(_checks.bounded(name, values, least=0.0, most=most), float)))
    if axis.size == 0 or np.unique(axis).size != axis.size:
        raise ValueError(f"{name}: got {axis.tolist()}, expected at least one value, each once")
    return axis


def _check_seeds(count: int) -> None:
    if count < 2:
        raise ValueError(f"seeds: got {count}, expected at least 2 for an interval")
