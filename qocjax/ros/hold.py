"""What a hold rule leaves of the command in force (model, section 4); times in ns."""

from __future__ import annotations

import math

from qocjax.network.completion import latest
from qocjax.network.schedule import Rules
from qocjax.ros.loops import Loops

__all__ = ["Hold"]


class Hold:
    """A hold rule as a factor on the command in force, and when that may change by itself.

    Args:
        rules: Actuation and hold.
        deadline: Delta.
        verdict: How long after its stamp a loop is judged.
        period: tau; 0 where it is not known, and then a timeout acts at once and not at a sampling instant.
    """

    def __init__(self, rules: Rules, deadline: int, verdict: int, period: int) -> None:
        self._rules, self._deadline, self._verdict, self._period = rules, deadline, verdict, period
        self._timeout = math.floor(latest(1e9 * rules.hold_timeout))

    def gain(self, loops: Loops, loop: int, stamp: int, time: int, before: float | None) -> float:
        """What is left at a time.

        Args:
            loops: What is known of them.
            loop: Whose command is in force.
            stamp: Of that command.
            time: At which it takes effect, or is looked at again.
            before: What was left of it; None where it takes effect now.
        """
        if self._rules.hold == "hold":
            return 1.0
        if self._rules.hold == "zero":
            return float(loop >= loops.missed)
        if self._period and loops.next_instant(time - 1) != time:  # between sampling instants
            return 1.0 if before is None else before
        if self._rules.hold == "timeout":
            return float(time - stamp <= self._timeout)
        return math.exp(-1e-9 * max(time - stamp - self._deadline, 0) / self._rules.hold_decay)

    def next_change(self, loops: Loops, stamp: int, gain: float, now: int) -> int | None:
        """When what is left of a command may next change; None for never."""
        if self._rules.hold == "zero" and gain:
            verdict = loops.next_verdict(self._verdict)
            at_instants = verdict is not None and self._rules.actuation == "arrival"
            return loops.next_instant(verdict - 1) if at_instants and verdict is not None else verdict
        if self._rules.hold == "timeout" and gain:
            over = stamp + self._timeout + 1
            return loops.next_instant(max(over - 1, now)) if self._period else max(over, now)
        if self._rules.hold == "decay":
            return loops.next_instant(max(stamp + self._deadline, now))
        return None
