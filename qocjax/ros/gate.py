"""The deadline gate: which command is in force when, from stamps and arrivals (model, section 4).

All times are whole nanoseconds of one clock, that of the stamps. Nothing here waits or reads a clock: a node, a testbed
or a test says what time it is.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import asdict, dataclass
from typing import NamedTuple

from qocjax import _checks
from qocjax.network.completion import latest
from qocjax.network.schedule import Rules
from qocjax.ros.hold import Hold
from qocjax.ros.loops import Loops

__all__ = ["Change", "Command", "Counts", "DeadlineGate", "nanoseconds"]

Command = tuple[float, ...]
"""Speeds; what a hold rule leaves of a command is a factor on all of them."""

_STEP_BACK = 1_000_000_000  # ns; a clock that goes back further was set anew, as by a simulator that begins again


_STALE = 60_000_000_000  # ns


class Change(NamedTuple):
    """From a time on another command is in force."""

    time: int  # ns
    command: Command  # after the hold rule
    stamp: int  # ns, of the state that it was computed from
    gain: float  # what the hold rule leaves of it


@dataclass
class Counts:
    """What has become of the loops so far."""

    completed: int = 0  # loops whose command came in time
    missed: int = 0  # loops without; with a period also those whose command never came
    late: int = 0  # commands that came after their deadline and were dropped
    reordered: int = 0  # commands that came after a newer one
    repeated: int = 0  # commands of a loop that had one already
    ahead: int = 0  # commands dropped because their stamp lies in the future
    restarts: int = 0  # times that the clock was set back


class _InForce(NamedTuple):
    command: Command
    stamp: int
    loop: int


class DeadlineGate:
    """Holds each command until its stamp plus the deadline, and drops those that come later.

    Args:
        rules: Actuation, `deadline` or `arrival`, and hold. With `arrival` a command takes effect when it comes, at the
            first sampling instant from then on where a period is given.
        deadline: Delta (s).
        period: tau, between two stamps (s); 0 where it is not known. Then loops whose command never comes are not
            counted, a timeout acts at once rather than at a sampling instant, and `zero` and `decay` cannot be had.
        jitter: By how much stamps may be off the period (s): so much later a loop without a command is missed.
        ahead: By how much a stamp may lie in the future (s), as where a simulated clock goes in steps.
        origin: Stamp of the first loop (ns), where it is known before its command comes.

    Raises:
        TypeError: A time is no number.
        ValueError: A time is negative, or the rules ask for what the gate cannot do.
    """

    def __init__(
        self, rules: Rules, deadline: float, period: float = 0.0, jitter: float = 0.0, ahead: float = 0.0,
        origin: int | None = None,
    ) -> None:  # fmt: skip
        _checks.choice("actuation", rules.actuation, ("deadline", "arrival"))
        rules.check_single()
        names = {"deadline": deadline, "period": period, "jitter": jitter, "ahead": ahead}
        times = {name: nanoseconds(name, value) for name, value in names.items()}
        if times["period"] == 0 and rules.hold in ("zero", "decay"):
            raise ValueError(f"period: got {period:g} with hold {rules.hold!r}, expected the time between two stamps")
        if times["period"] and not 2 * times["jitter"] < times["period"]:
            raise ValueError(f"jitter: got {jitter:g}, expected less than half of the period, {period:g}")
        self._rules, self._origin = rules, origin
        self._deadline, self._period, self._ahead = times["deadline"], times["period"], times["ahead"]
        self._verdict = self._deadline + times["jitter"]
        self._hold = Hold(rules, self._deadline, self._verdict, self._period)
        self._restarts = 0
        self._begin()

    def _begin(self) -> None:
        self._loops = Loops(self._period, self._origin)
        self._counts = Counts(restarts=self._restarts)
        self._due: list[tuple[int, int, int, _InForce]] = []  # when, stamp, order of arrival
        self._force: _InForce | None = None
        self._gain = 1.0
        self._newest: int | None = None  # stamp
        self._now: int | None = None  # until when everything has happened
        self._arrivals = 0

    @property
    def counts(self) -> Counts:
        """What has become of the loops so far."""
        self._counts.completed = self._loops.num_completed
        self._counts.missed = self._loops.num_missed if self._period else self._counts.late
        return Counts(**asdict(self._counts))

    @property
    def in_force(self) -> Command | None:
        """The command in force after the hold rule; None before the first."""
        return None if self._force is None else _scaled(self._force.command, self._gain)

    def age(self, now: int) -> float | None:
        """Age of the command in force (s), before the first that of the first loop; None where that is not known."""
        stamp = self._origin if self._force is None else self._force.stamp
        return None if stamp is None else 1e-9 * (now - stamp)

    def arrive(self, stamp: int, command: Command, now: int) -> str:
        """Takes a command.

        Args:
            stamp: Of the state that it was computed from (ns).
            command: Speeds.
            now: When it came (ns).

        Returns:
            What becomes of it: `completed`, `late` or `ahead`.
        """
        if self._set_back(now):
            self._begin()
        if stamp > now + self._ahead:
            self._counts.ahead += 1
            return "ahead"
        self._counts.reordered += self._newest is not None and stamp < self._newest
        self._newest = stamp if self._newest is None else max(self._newest, stamp)
        allowed = math.floor(latest(self._deadline))
        if now - stamp > allowed + _STALE:  # of another clock, or no stamp at all: not one of these loops
            self._counts.late += 1
            return "late"
        loop = self._loops.number(stamp)
        if now - stamp > allowed:
            self._counts.late += 1
            return "late"
        if not self._loops.complete(loop, stamp, oldest=now - allowed):
            self._counts.repeated += 1
        self._arrivals += 1
        heapq.heappush(self._due, (self._effect(stamp, now), stamp, self._arrivals, _InForce(command, stamp, loop)))
        return "completed"

    def _effect(self, stamp: int, now: int) -> int:
        """When a command that came in time takes effect."""
        if self._rules.actuation == "deadline":
            return stamp + self._deadline
        now = max(now, stamp)
        return self._loops.next_instant(now - 1) if self._period else now

    def _set_back(self, now: int) -> bool:
        """Whether the clock was set back; a smaller step is waited out."""
        if self._now is None or now > self._now - _STEP_BACK:
            return False
        self._restarts += 1
        return True

    def next_change(self) -> int | None:
        """The next time (ns) at which the command in force may change by itself; None where nothing is to come."""
        times = [self._due[0][0]] if self._due else []
        if self._force is not None and any(self._force.command):
            assert self._now is not None
            held = self._hold.next_change(self._loops, self._force.stamp, self._gain, self._now)
            times += [] if held is None else [held]
        return min(times, default=None)

    def advance(self, now: int) -> list[Change]:
        """Lets everything happen that is due until now (ns), and now.

        Returns:
            The changes of the command in force, in order, each with its own time. Where the clock was set back nothing
            is in force any more, and one change to a standstill says so.
        """
        if self._set_back(now):
            still = () if self._force is None else tuple(0.0 for _ in self._force.command)
            self._begin()
            self._now = now
            return [Change(now, still, now, 0.0)] if still else []
        changes = []
        while (time := self.next_change()) is not None and time <= now:
            changes += self._step(time if self._now is None else max(time, self._now))
        self._now = now if self._now is None else max(now, self._now)
        self._loops.judge(self._last_verdict(), self._verdict)
        return changes

    def _last_verdict(self) -> int:
        """Until when loops are judged: now, or the last sampling instant where verdicts act at those."""
        assert self._now is not None
        at_instants = self._rules.hold == "zero" and self._rules.actuation == "arrival" and self._force is not None
        return self._loops.next_instant(self._now - self._period) if at_instants else self._now

    def _step(self, time: int) -> list[Change]:
        """What happens at one time: commands take effect, then the hold rule has its say."""
        before = (self._force, self._gain)
        while self._due and self._due[0][0] <= time:
            due = heapq.heappop(self._due)[-1]
            if self._force is None or due.stamp >= self._force.stamp:
                self._force = due
        self._loops.judge(time, self._verdict)
        self._now, force = time, self._force
        if force is None:
            return []
        earlier = self._gain if force is before[0] else None
        self._gain = self._hold.gain(self._loops, force.loop, force.stamp, time, earlier)
        if (force, self._gain) == before:
            return []
        return [Change(time, _scaled(force.command, self._gain), force.stamp, self._gain)]


def nanoseconds(name: str, seconds: float) -> int:
    """A time in whole nanoseconds.

    Raises:
        TypeError: It is no number.
        ValueError: It is negative or not finite.
    """
    return round(1e9 * float(_checks.bounded(name, seconds, least=0.0, shape=())))


def _scaled(command: Command, gain: float) -> Command:
    return command if gain == 1.0 else tuple(gain * each for each in command)
