"""The three regimes of AUC over delay: low-reliability, intermediate, delay-dominant (model, section 7.1).

On the normalised curve, so neither the unit nor the zero of AUC matters:

- low-reliability: from the first delay until the curve has last done a given share (by default half) of its fall from
  its worst before the minimum to the minimum. Few loops complete; the robots hardly move.
- intermediate: from there to the minimum. Each further loop that completes is worth more than the delay that it costs.
- delay-dominant: from the minimum on. Loops complete anyway, and more delay only makes the commands older.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from qocjax import _checks
from qocjax.statistics.estimates import paired, unpaired
from qocjax.validation.curves import Curve, normalised
from qocjax.validation.resample import Interval, percentiles

__all__ = ["REGIMES", "Regimes", "boundaries", "regimes"]

Array = NDArray[np.float64]

REGIMES = ("low-reliability", "intermediate", "delay-dominant")


@dataclass(frozen=True)
class Regimes:
    """Where the regimes of a curve meet.

    Attributes:
        first: First delay of the curve (s).
        begins: Where the intermediate regime begins (s); `first` where the curve has no low-reliability regime.
        best: Where the delay-dominant regime begins: the delay of the smallest AUC (s).
        last: Last delay of the curve (s).
        fall: From the worst before the best to the best, on the normalised scale.
        rise: From the best to the last delay, on the normalised scale.
        open: Whether the curve falls by a tenth of its fall or more between its first two delays: the low-reliability
            regime then begins before the first delay.
        told: Whether fall and rise are more than noise (`_told`).
    """

    first: float
    begins: Interval
    best: Interval
    last: float
    fall: Interval
    rise: Interval
    open: bool
    told: tuple[bool, bool]

    @property
    def spans(self) -> dict[str, tuple[float, float] | None]:
        """Begin and end of each regime (s); None for one that the curve does not show.

        A regime is shown where it has a length, and the fall into the best (the rise from it) is told from 0.
        """
        falls, rises = self.told
        ends = ((self.first, self.begins.value), (self.begins.value, self.best.value), (self.best.value, self.last))
        shown = (falls, falls, rises)
        return {name: pair if yes and pair[1] > pair[0] else None
                for name, pair, yes in zip(REGIMES, ends, shown, strict=True)}  # fmt: skip


def regimes(curve: Curve, drawn: ArrayLike, share: float = 0.5) -> Regimes:
    """Where the regimes of a curve begin and end, with percentile bootstrap intervals.

    Args:
        curve: S or E.
        drawn: [B, D] its mean curves in the bootstrap samples.
        share: Of the fall, at which the intermediate regime begins.

    Raises:
        ValueError: The share is not between 0 and 1, or the curve does not vary.
    """
    _checks.bounded("regime_share", share, above=0)
    _checks.bounded("regime_share", 1.0 - share, above=0)
    samples = np.asarray(drawn, np.float64)
    samples = samples[np.ptp(samples, axis=1) > 0]
    found = boundaries(curve.delays, samples, share)
    own = [float(each[0]) for each in boundaries(curve.delays, curve.mean[None], share)]
    begins, best, fall, rise = (percentiles(value, each) for value, each in zip(own, found, strict=True))
    scaled = normalised(curve.mean)
    started = bool(scaled[0] - scaled[1] >= 0.1 * fall.value > 0.0)
    return Regimes(float(curve.delays[0]), begins, best, float(curve.delays[-1]), fall, rise, started,
                   _told(curve, (fall.low > 0.0, rise.low > 0.0)))  # fmt: skip


def _told(curve: Curve, otherwise: tuple[bool, bool]) -> tuple[bool, bool]:
    """Whether the fall into the best and the rise from it are told from 0, in s.

    A largest value less a smallest one is above 0 in pure noise too. So every other repetition says which delays are
    the highest before the best, and the best; the others are asked for the difference. With fewer than four
    repetitions at some delay the intervals of the bootstrap have to do.
    """
    if curve.repetitions.min() < 4:
        return otherwise
    chooses = np.array([each[::2].mean() for each in curve.values])
    best = int(chooses.argmin())
    high = int(chooses[: best + 1].argmax())
    return _above(curve, high, best), _above(curve, len(curve.values) - 1, best)


def _above(curve: Curve, one: int, other: int) -> bool:
    """Whether the mean at one delay is above that at another, on every other repetition."""
    if one == other:
        return False
    a, b = (curve.values[k][1::2] for k in (one, other))
    if curve.seeds is None:
        return unpaired(a, b).low > 0.0
    units = None if curve.units is None else np.array(curve.units)[1::2]
    return paired(a, b, units=units if units is not None and np.unique(units).size > 1 else None).low > 0.0


def boundaries(delays: ArrayLike, curves: ArrayLike, share: float = 0.5) -> tuple[Array, Array, Array, Array]:
    """Begin of the intermediate and of the delay-dominant regime (s), fall and rise (of 100), of curves [B, D]."""
    axis, table = np.asarray(delays, np.float64), normalised(np.asarray(curves, np.float64))
    size = axis.size
    k = table.argmin(axis=1)
    before = np.arange(size)[None, :] <= k[:, None]
    fall = np.where(before, table, 0.0).max(axis=1)  # the best is 0
    target = (1.0 - share) * fall
    above = before & (table >= target[:, None]) & (fall > 0.0)[:, None]
    last = size - 1 - above[:, ::-1].argmax(axis=1)
    after = np.minimum(last + 1, size - 1)
    rows = np.arange(len(table))
    drop = table[rows, last] - table[rows, after]
    part = np.where(drop > 0, (table[rows, last] - target) / np.where(drop > 0, drop, 1.0), 0.0)
    begins = np.where(above.any(axis=1), axis[last] + part * (axis[after] - axis[last]), axis[0])
    return begins, axis[k], fall, table[:, -1]
