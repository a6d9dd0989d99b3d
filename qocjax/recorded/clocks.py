"""The offset of one clock against another, from delays alone: lower envelopes that drift.

A delay measured between two clocks is the true delay plus an offset that drifts. The smallest delays of a stretch of
time lie close to the smallest delay there is, so their envelope moves as the offset does. With delays of both
directions the offset is half the difference of the two envelopes, if the smallest delays of both directions are equal;
since neither can be negative, it is off by at most half their sum, whatever they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Clock", "lower_envelope", "steps", "two_way_clock"]

Array = NDArray[np.float64]

_LEAST = 8  # delays of a stretch, below which its smallest says little
_MOST_STRETCHES = 2000
_DIP = 10.0  # times the usual distance from the median of five stretches


@dataclass(frozen=True)
class Clock:
    """A clock's offset, linear between knots and constant beyond them."""

    knots: Array  # [K] s
    offsets: Array  # [K] s
    uncertainty: float  # s, half the smallest sum of both directions' delays
    drift: float  # s/s, of the straight line through the offsets

    def offset(self, time: Array) -> Array:
        """The offset (s) at times (s)."""
        return np.interp(time, self.knots, self.offsets)


def lower_envelope(time: Array, delay: Array, window: float) -> tuple[Array, Array, float]:
    """The drifting lower envelope of delays.

    The straight line through the smallest delay of each stretch of `window` seconds is taken out (Theil and Sen's line,
    which single wrong delays do not turn), then the smallest of what is left is found again, so that drift within a
    stretch does not count. A single stretch that lies far below its neighbours does not count either.

    Args:
        time: [n] s, in any order.
        delay: [n] s, with an unknown offset.
        window: Length of a stretch (s); longer where there are few delays.

    Returns:
        Knots [K] s, from the first delay to the last, the envelope at them [K] s, and its drift (s/s).

    Raises:
        ValueError: There is no delay, one is not finite, or the window is not positive.
    """
    if not window > 0.0:
        raise ValueError(f"window: got {window}, expected a time > 0 s")
    if time.size == 0 or time.shape != delay.shape or not (np.isfinite(time).all() and np.isfinite(delay).all()):
        raise ValueError(f"delay: got {delay.size} delays at {time.size} times, expected finite ones, one a time")
    from scipy.stats import theilslopes  # a third of a second, which only logs with clocks need take

    order = np.argsort(time, kind="stable")
    time, delay = time[order], delay[order]
    starts = _starts(time, window)
    middle = 0.5 * (time[starts] + time[np.append(starts[1:], time.size) - 1])
    slope = 0.0
    for _ in range(3):
        least = np.minimum.reduceat(delay - slope * time, starts)
        if least.size > 2:
            slope += float(theilslopes(least, middle)[0])
    least = np.minimum.reduceat(delay - slope * time, starts)
    knots = np.concatenate(([time[0]], middle, [time[-1]]))
    dips = _without_dips(least)
    return knots, np.concatenate((dips[:1], dips, dips[-1:])) + slope * knots, slope


def _without_dips(least: Array) -> Array:
    """The envelope without single stretches far below their neighbours: a wrong stamp, no clock, makes those."""
    if least.size < 5:
        return least
    from scipy.ndimage import median_filter  # with scipy.stats

    usual = median_filter(least, 5, mode="mirror")
    below = usual - least
    return np.where(below > _DIP * np.median(np.abs(below)), usual, least)


def _starts(time: Array, window: float) -> NDArray[np.intp]:
    """First delay of each stretch: of `window` seconds, or longer until it holds enough."""
    span = float(np.ptp(time))
    count = int(np.clip(min(span / window, time.size / _LEAST), 1, _MOST_STRETCHES))
    edges = time[0] + span / count * np.arange(count)
    starts = [0]
    for place in np.searchsorted(time, edges[1:]):
        if place - starts[-1] >= _LEAST and time.size - place >= _LEAST:
            starts.append(int(place))
    return np.array(starts)


def two_way_clock(time: Array, up: Array, down: Array, window: float) -> Clock:
    """Offset of the far clock, from delays there (`far - near`) and back (`near - far`).

    Args:
        time: [n] s, on the near clock.
        up: [n] s, apparent delay there: the true one plus the offset.
        down: [n] s, apparent delay back: the true one minus the offset.
        window: Length of a stretch (s), see `lower_envelope`.

    Raises:
        ValueError: As `lower_envelope`.
    """
    knots, above, rise = lower_envelope(time, up, window)
    others, below, fall = lower_envelope(time, down, window)
    both = np.union1d(knots, others)
    there, back = np.interp(both, knots, above), np.interp(both, others, below)
    return Clock(both, 0.5 * (there - back), float(0.5 * np.min(there + back)), 0.5 * (rise - fall))


def steps(up: Array, down: Array, least: float, width: int = 25) -> NDArray[np.intp]:
    """Where one clock steps against the other: indices of the first loop after each step.

    A step moves half the difference of both directions and leaves their sum as it was; a direction that becomes slower
    moves both. Medians of `width` loops before and after a place are compared, so a step nearer to an end is not seen.

    Args:
        up: [n] s, apparent delays there, in the order in which they were measured.
        down: [n] s, apparent delays back.
        least: Smallest step that counts (s).
        width: Loops on either side.
    """
    if up.size < 2 * width:
        return np.empty(0, np.intp)
    windows = np.lib.stride_tricks.sliding_window_view(np.stack([0.5 * (up - down), up + down]), width, axis=1)
    median = np.median(windows, axis=2)  # [2, n - width + 1], of the loops from each place on
    moved = np.abs(median[:, width:] - median[:, :-width])
    suspect = np.flatnonzero((moved[0] > least) & (moved[1] < moved[0]))
    groups = np.split(suspect, np.flatnonzero(np.diff(suspect) > width) + 1) if suspect.size else []
    offset = 0.5 * (up - down)
    return np.array([_sharpest(offset, group + width, width) for group in groups], np.intp)


def _sharpest(offset: Array, places: NDArray[np.intp], width: int) -> int:
    """The place among some where the offset before and after is explained best by two constants."""
    first, last = max(places[0] - width, 0), min(places[-1] + width, offset.size)
    before, after = np.median(offset[first : places[0]]), np.median(offset[places[-1] : last])
    nearer_after = np.abs(offset[first:last] - after) < np.abs(offset[first:last] - before)
    wrong = np.cumsum(np.append(0, nearer_after)) + np.append(np.cumsum(~nearer_after[::-1])[::-1], 0)
    return int(first + np.argmin(wrong))
