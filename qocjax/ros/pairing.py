"""Which pose a command answers, where its stamp does not say so."""

from __future__ import annotations

from collections import deque
from dataclasses import asdict, dataclass
from typing import NamedTuple

from qocjax.ros.gate import nanoseconds

__all__ = ["Pair", "PairCounts", "Pairing"]

_KEPT = 10_000_000_000  # ns that poses are remembered, for commands that bear the stamp of one


class Pair(NamedTuple):
    """The newest pose that a command can have been computed from."""

    stamp: int  # ns, of the pose; the robot's clock
    received: int  # ns, when it came; this clock
    spread: int  # ns from the oldest to the newest stamp of those that it can be
    poses: int  # how many it can be; 1 is certain
    proven: bool  # whether the command bears the pose's own stamp


@dataclass
class PairCounts:
    """How sure the pairs are."""

    pairs: int = 0
    proven: int = 0  # of those, by the command's own stamp
    ambiguous: int = 0  # of those, with more than one pose that it can be
    unpaired: int = 0  # commands before any pose
    spread_sum: int = 0  # ns
    spread_max: int = 0  # ns

    @property
    def ambiguous_share(self) -> float:
        """Share of the pairs; NaN without any."""
        return self.ambiguous / self.pairs if self.pairs else float("nan")

    @property
    def spread_mean(self) -> float:
        """Seconds, over all pairs; NaN without any."""
        return 1e-9 * self.spread_sum / self.pairs if self.pairs else float("nan")


class Pairing:
    """Pairs commands with poses by when both come; times in ns of one clock, stamps of poses of any.

    A command that comes at t was computed from the newest pose known at some time between t - `slowest` and
    t - `fastest`. The newest of these is taken; that there are others is said.

    Args:
        fastest: Least time that a command takes from reading the pose until it comes here (s).
        slowest: Most time that it takes, such as a cycle of the controller (s).

    Raises:
        TypeError: A time is no number.
        ValueError: A time is negative, or the least is more than the most.
    """

    def __init__(self, fastest: float, slowest: float) -> None:
        self._fastest, self._slowest = nanoseconds("fastest", fastest), nanoseconds("slowest", slowest)
        if self._fastest > self._slowest:
            raise ValueError(f"fastest: got {fastest:g}, expected at most slowest, {slowest:g}")
        self._counts = PairCounts()
        self._poses: deque[tuple[int, int]] = deque()  # arrival and stamp of each that was the newest when it came
        self._stamps: dict[int, int] = {}  # arrival of each stamp

    @property
    def counts(self) -> PairCounts:
        """How sure the pairs so far are."""
        return PairCounts(**asdict(self._counts))

    def pose(self, stamp: int, now: int) -> None:
        """Takes a pose that comes now."""
        if self._poses and now < self._poses[-1][0]:  # the clock was set back
            self._poses.clear()
            self._stamps.clear()
        self._stamps.setdefault(stamp, now)
        if not self._poses or stamp > self._poses[-1][1]:
            self._poses.append((now, stamp))
        while len(self._poses) > 1 and self._poses[1][0] < now - max(_KEPT, self._slowest):
            self._poses.popleft()
        while len(self._stamps) > 1 and next(iter(self._stamps.values())) < now - _KEPT:
            del self._stamps[next(iter(self._stamps))]

    def command(self, now: int, stamp: int | None = None) -> Pair | None:
        """The pose that a command which comes now answers; None before any pose.

        Args:
            now: When it comes.
            stamp: Its own, if it bears one: where it is that of a pose, this is proven.
        """
        if stamp is not None and stamp in self._stamps:
            return self._paired(Pair(stamp, self._stamps[stamp], 0, 1, True))
        known = [each for each in self._poses if each[0] <= now - self._fastest]
        if not known:
            self._counts.unpaired += 1
            return None
        since = [k for k, each in enumerate(known) if each[0] > now - self._slowest]
        oldest = max(since[0] - 1, 0) if since else len(known) - 1
        (received, newest), spread = known[-1], known[-1][1] - known[oldest][1]
        return self._paired(Pair(newest, received, spread, len(known) - oldest, False))

    def _paired(self, pair: Pair) -> Pair:
        counts = self._counts
        counts.pairs += 1
        counts.proven += pair.proven
        counts.ambiguous += pair.poses > 1
        counts.spread_sum += pair.spread
        counts.spread_max = max(counts.spread_max, pair.spread)
        return pair
