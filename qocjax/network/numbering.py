"""Numbers of loops as a file has them, put in order: late rows, counters that wrap, numbering that begins anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Numbering", "number_loops"]

_WIDTHS = (2**8, 2**16, 2**32)  # of the counters of ping, RTP, IP
_AHEAD = 32  # rows within which late ones are over
_LATE = 64  # numbers that a late row may lie behind
_COPIES = 4  # so many known numbers in a row are no copies: the numbering began anew
_SKIPPED = 4  # numbers that late rows leave open at a wrap
_SLACK = 3.0  # times the usual time that numbers around a wrap may take
_SHUFFLED = 0.25  # share of the rows that go back from which on a file has no order of its own

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Numbering:
    """Rows in the order of loops, which is that of the file but for late rows."""

    order: NDArray[np.intp]  # [n] rows of the file
    number: Array  # [n] of each row of the file, counting on where a counter wraps; from 0 in each session
    session: NDArray[np.int64]  # [n] of each row of the file: how often the numbering has begun anew before
    wraps: int
    restarts: int
    late: int  # places from where on rows come after one with a higher number


def number_loops(numbers: Sequence[float], stamps: Array | None = None, answers: Array | None = None) -> Numbering:
    """Finds out what numbers of loops mean where they do not just increase.

    Numbers that go back are late rows if they were missing and the numbering soon goes on above them, copies if they
    were there, a counter that wraps if they go on modulo 2^8, 2^16 or 2^32, and else the numbering begins anew.
    Rows are neither dropped nor moved for a wrap or a new beginning. A file without any order is sorted by its numbers.

    Args:
        numbers: [n] in the order of the file, finite, integers of any length or floats.
        stamps: [n] send times (s): rows with one number and two send times are two loops.
        answers: [n] receive times (s), NaN for none: rows that say the same throughout are copies.
    """
    low = min(numbers)
    value = np.array([float(each - low) for each in numbers])
    back = np.flatnonzero(np.diff(value) <= 0.0) + 1
    rows = np.arange(value.size)
    if not back.size:
        return Numbering(rows, value, np.zeros(value.size, np.int64), 0, 0, 0)
    ordered = stamps is not None and bool(np.all(np.diff(stamps) >= 0.0))
    behind = int(np.sum(np.diff(value) < 0.0))
    if not ordered and behind > _SHUFFLED * value.size:
        return Numbering(np.argsort(value, kind="stable"), value, np.zeros(value.size, np.int64), 0, 0, behind)
    return _Reader(value, float(low), stamps, answers, back).read()


class _Reader:
    """Goes through a file by its runs of increasing numbers."""

    def __init__(
        self, value: Array, low: float, stamps: Array | None, answers: Array | None, back: NDArray[np.intp]
    ) -> None:
        ahead = np.diff(value)
        ahead = ahead[ahead > 0.0]
        self.step = float(np.median(ahead)) if ahead.size else 1.0
        self.widest = float(np.max(ahead[ahead < _WIDTHS[0] // 2], initial=1.0))
        self.value, self.stamps, self.answers = value, stamps, answers
        if stamps is not None:  # s a number
            each = np.diff(stamps)[np.diff(value) > 0.0]
            self.pace = float(np.median(np.abs(each) / np.diff(value)[np.diff(value) > 0.0])) if each.size else np.inf
        self.top = float(value.max()) + low
        self.whole = bool(np.all(value == np.floor(value))) and low == np.floor(low) and low >= 0.0
        jumps = np.flatnonzero(np.diff(value) >= _WIDTHS[0] // 2) + 1  # late rows from before a wrap
        self.bounds = np.unique(np.concatenate(([0], back, jumps, [value.size])))
        self.number, self.session = np.empty(value.size), np.zeros(value.size, np.int64)
        self.offset, self.lowest, self.highest, self.now = 0.0, np.inf, -np.inf, 0
        self.seen: dict[float, int] = {}  # numbers of this session, and their first rows
        self.wraps = self.restarts = self.late = 0

    def read(self) -> Numbering:
        for first, end in zip(self.bounds[:-1].tolist(), self.bounds[1:].tolist(), strict=True):
            self._run(first, end)
        rows = np.arange(self.value.size)
        order = np.lexsort((rows, self.number, self.session))
        return Numbering(order, self.number, self.session, self.wraps, self.restarts, self.late)

    def _run(self, first: int, end: int) -> None:
        known = self.value[first:end] + self.offset
        if known[0] <= self.highest:
            width = self._wrapped(first)
            if width is not None:
                self.offset += width
                self.wraps += 1
            elif self._begins_anew(first, known):
                self.offset, self.lowest, self.highest = 0.0, np.inf, -np.inf
                self.now, self.seen = self.now + 1, {}
                self.restarts += 1
            known = self.value[first:end] + self.offset
        elif self.wraps and (width := self._from_before(known)) is not None:
            known = known - width
        self.late += known[0] < self.highest and float(known[0]) not in self.seen
        self.number[first:end], self.session[first:end] = known, self.now
        for row, each in enumerate(known.tolist(), start=first):
            self.seen.setdefault(each, row)
        self.lowest, self.highest = min(self.lowest, float(known[0])), max(self.highest, float(known[-1]))

    def _wrapped(self, first: int) -> float | None:
        """The width of a counter that would go on here as it does elsewhere."""
        if not self.whole:
            return None
        for width in _WIDTHS:
            ahead = self.value[first] + self.offset + width - self.highest
            if self.top < width and 0.0 < ahead <= min(max(self.widest, _SKIPPED), width / 4):
                return float(width) if self._steady(first, ahead) else None
        return None

    def _steady(self, first: int, ahead: float) -> bool:
        """Whether so many numbers fit in between by the send times, where these are known."""
        if self.stamps is None:
            return True
        passed = float(self.stamps[first] - self.stamps[self.seen[self.highest]])
        return 0.0 < passed <= _SLACK * ahead * self.pace

    def _from_before(self, known: Array) -> float | None:
        """The width of the counter, where numbers far ahead are late ones from before it wrapped."""
        for width in _WIDTHS:
            if self.top < width and known[0] - self.highest >= width / 2 and self.highest - known[-1] + width <= _LATE:
                return float(width)
        return None

    def _begins_anew(self, first: int, known: Array) -> bool:
        behind = known[known <= self.highest]
        met = [(self.seen[each], first + k) for k, each in enumerate(behind.tolist()) if each in self.seen]
        if met and self.stamps is not None:
            one, other = np.array(met).T
            same = self.answers is not None and np.array_equal(self.answers[one], self.answers[other], equal_nan=True)
            return not (np.array_equal(self.stamps[one], self.stamps[other]) and (same or len(met) <= _AHEAD))
        until = first + _AHEAD + behind.size
        over = until >= self.value.size or bool(np.any(self.value[first:until] + self.offset > self.highest))
        if met:
            return behind.size >= _COPIES or not over
        if self.stamps is not None and self.stamps[first] >= self.stamps[self.seen[self.highest]]:
            return True
        inside = behind[0] > self.lowest  # where nothing is known of it, it fills a hole
        return not inside and not (over and self.highest - behind[0] <= _LATE * self.step)
