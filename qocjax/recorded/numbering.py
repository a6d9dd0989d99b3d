"""Numbers that count on by one, or by some usual step: how many of them are not there."""

from __future__ import annotations

from collections import Counter

__all__ = ["Rows", "Sequence"]

_FAR = 10**6  # a step that no loss explains: the number itself is broken
_LEAST, _MOST, _USUAL = 10, 1000, 0.9  # steps of a sequence, kinds of them, and share of the usual one


class Rows:
    """Keys of a table whose rows are only ever added at its end, in the order in which they are read."""

    def __init__(self) -> None:
        self.missing = 0
        self._last, self._before, self._added = 0, 0, 0

    def take(self, key: int) -> None:
        """Counts the keys between the last one and this one; one that was too large is taken back by what follows."""
        if key <= self._last and self._added:
            self.missing, self._last = self.missing - self._added, self._before
        step = key - self._last
        if step < 1 or step > _FAR:
            return
        self._before, self._last, self._added = self._last, key, step - 1
        self.missing += step - 1


class Sequence:
    """Sequence numbers of a channel."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._steps: Counter[int] = Counter()

    def take(self, number: int) -> None:
        """Adds the next one."""
        if self._last is not None and len(self._steps) < _MOST:
            self._steps[number - self._last] += 1
        self._last = number

    def missing(self) -> int:
        """Numbers that are not there; 0 where they do not count on evenly, as those that are all 0."""
        count = self._steps.total()
        ((usual, often),) = self._steps.most_common(1) or [(0, 0)]
        if usual < 1 or count < _LEAST or often < _USUAL * count:
            return 0
        return sum((step // usual - 1) * times for step, times in self._steps.items() if usual < step <= _FAR)
