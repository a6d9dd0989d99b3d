"""Numbers of loops, told from the stamps of their commands: which have completed, which are missed."""

from __future__ import annotations

__all__ = ["Loops"]

_KEPT = 64  # judged loops of which is known that they have completed, for commands that come twice


class Loops:
    """The loops that a robot starts every period; times in ns.

    A command says by its stamp which loop it is of: the newest stamp so far is the anchor from which periods are
    counted, so stamps may wander, and jump by less than half a period. Without a period there are no numbers, and a
    loop whose command never comes is not known of.
    """

    def __init__(self, period: int, origin: int | None) -> None:
        self._period = period
        self._anchor = None if origin is None else (0, origin)  # number and stamp of the newest loop known
        self._judged = -1  # newest loop of which is known whether it has completed
        self._completed: set[int] = set()  # loops, those that were judged long ago left out
        self._without: dict[int, None] = {}  # without a period: stamps of completed loops, oldest first
        self.missed = -1  # newest loop that is missed
        self.num_completed = self.num_missed = 0

    def number(self, stamp: int) -> int:
        """Number of the loop that a stamp is of; the first stamp ever is that of loop 0."""
        if self._anchor is None:
            self._anchor = (0, stamp)
        number, newest = self._anchor
        if self._period == 0:
            return 0
        loop = number + _nearest(stamp - newest, self._period)
        if loop > number:
            self._anchor = (loop, stamp)
        return loop

    def complete(self, loop: int, stamp: int, oldest: int) -> bool:
        """Takes it that the command of a loop has come in time; False where it had before.

        Args:
            loop: Its number.
            stamp: Of the command.
            oldest: Stamp of which commands still come in time.
        """
        if self._period == 0:
            return self._complete_unnumbered(stamp, oldest)
        if loop in self._completed:
            return False
        self._completed.add(loop)
        self.num_completed += 1
        self.num_missed -= loop <= self._judged  # its stamp has wandered by more than is allowed for
        return True

    def _complete_unnumbered(self, stamp: int, oldest: int) -> bool:
        while self._without and next(iter(self._without)) < oldest:
            del self._without[next(iter(self._without))]
        new = stamp not in self._without
        self._without[stamp] = None
        self.num_completed += new
        return new

    def next_verdict(self, wait: int) -> int | None:
        """When the next loop is known to have completed or not, `wait` after its stamp."""
        if self._period == 0 or self._anchor is None:
            return None
        number, stamp = self._anchor
        return stamp + (self._judged + 1 - number) * self._period + wait

    def judge(self, now: int, wait: int) -> None:
        """Counts the loops whose time is over."""
        due = self.next_verdict(wait)
        if due is None or due > now:
            return
        before, self._judged = self._judged, self._judged + 1 + (now - due) // self._period
        over = {loop for loop in self._completed if before < loop <= self._judged}
        self.num_missed += self._judged - before - len(over)
        newest = self._judged
        while newest in over:
            newest -= 1
        self.missed = max(self.missed, newest if newest > before else self.missed)
        self._completed = {loop for loop in self._completed if loop > self._judged - _KEPT}

    def next_instant(self, after: int) -> int:
        """The first sampling instant later than a time; with a period only."""
        assert self._anchor is not None and self._period > 0
        stamp = self._anchor[1]
        return stamp + ((after - stamp) // self._period + 1) * self._period


def _nearest(length: int, period: int) -> int:
    """Whole periods nearest to a length."""
    return (2 * length + period) // (2 * period)
