"""`python -m qocjax.ros.deadline`: holds each command until its stamp plus the deadline (model, section 4)."""

from __future__ import annotations

import sys
from typing import Any

from qocjax.network.schedule import Rules
from qocjax.ros.gate import Change, Command, DeadlineGate
from qocjax.ros.injection import Injection, drawn_loop_times
from qocjax.ros.node import declared, from_stamp, reliable, serve, to_stamp
from qocjax.ros.parameters import DEADLINE
from qocjax.ros.reports import Diagnostics, Record

__all__ = ["DeadlineNode", "main"]

_USAGE = """usage: python -m qocjax.ros.deadline --ros-args [-p deadline:=0.2 ...] [-r cmd_vel_in:=... ...]

Takes geometry_msgs/TwistStamped on cmd_vel_in, stamped with the time of the state that each was computed from; hands on
on cmd_vel_out what is in force; tells of age and loops on /diagnostics. Parameters:"""

# A burst after a repair holds commands whose time is still to come, so the reader keeps more than the newest; those
# that come too late are dropped by their stamps. Going out, nothing but the newest is of any use.
_DEPTH_IN, _DEPTH_OUT = 10, 1


class DeadlineNode:
    """The deadline gate between two topics, on the clock of a node of rclpy.

    Raises:
        ValueError: A parameter is unknown or out of range.
    """

    def __init__(self, node: Any) -> None:
        from geometry_msgs.msg import Twist, TwistStamped

        values = declared(node, DEADLINE)
        self._node, self._values = node, values
        rules = Rules(*(values[name] for name in ("actuation", "hold", "hold_timeout", "hold_decay")))
        self.gate = DeadlineGate(rules, *(values[name] for name in ("deadline", "period", "jitter", "ahead")))
        self._injection = self._injected()
        self._told = self.gate.counts
        self._sequence = 0
        self._record = Record(values["record"], ("sequence", "uplink_send", "downlink_receive"))
        self._kind = TwistStamped if values["stamped_out"] else Twist
        self._out = node.create_publisher(self._kind, "cmd_vel_out", **reliable(_DEPTH_OUT))
        self._in = node.create_subscription(TwistStamped, "cmd_vel_in", callback=self._take, **reliable(_DEPTH_IN))
        self._timer = node.create_timer(1.0, self._update)
        self._timer.cancel()
        self._diagnostics = Diagnostics(node, "loops", values["diagnostics_period"], self._report)

    def _injected(self) -> Injection | None:
        values = self._values
        if not values["network"]:
            return None
        if values["period"] == 0:
            raise ValueError("period: got 0 with a network, expected the time between the stamps of two commands")
        times = drawn_loop_times(
            values["network"], values["period"], values["deadline"], values["network_seed"], values["network_loops"]
        )
        return Injection(times, values["period"])

    def _take(self, message: Any, info: Any) -> None:
        """A command has come."""
        now, stamp = self._now(), from_stamp(message.header.stamp)
        self._sequence = info.get("publication_sequence_number") or self._sequence + 1  # not every middleware has it
        self._record.add(self._sequence, stamp, now)
        move = message.twist
        command = (move.linear.x, move.linear.y, move.linear.z, move.angular.x, move.angular.y, move.angular.z)
        self._update(now, (stamp, command))

    def _update(self, now: int | None = None, came: tuple[int, Command] | None = None) -> None:
        """Lets everything happen that is due, publishes what is in force now, and sets the timer to what is next."""
        now = self._now() if now is None else now
        restarts = self.gate.counts.restarts
        changes = self.gate.advance(now)
        if self.gate.counts.restarts > restarts and self._injection is not None:
            self._injection.clear()
        if came is not None and self._injection is not None:
            self._injection.put(*came, now)
        elif came is not None:
            self._arrive(*came, now)
        if self._injection is not None:
            for each in self._injection.take(now):
                self._arrive(*each)
        changes += self.gate.advance(now)
        if changes:
            self._publish(changes[-1], now)
        self._wait(now)

    def _arrive(self, stamp: int, command: Command, now: int) -> None:
        if self.gate.arrive(stamp, command, now) == "ahead":
            self._node.get_logger().error(
                f"dropped a command whose stamp is {1e-9 * (stamp - now):.3f} s ahead, expected clocks in step",
                throttle_duration_sec=5.0,
            )

    def _wait(self, now: int) -> None:
        arrival = None if self._injection is None else self._injection.next_arrival()
        due = [time for time in (self.gate.next_change(), arrival) if time is not None]
        if due:
            self._timer.timer_period_ns = max(min(due) - now, 1)
            self._timer.reset()
        else:
            self._timer.cancel()

    def _publish(self, change: Change, now: int) -> None:
        message = self._kind()
        move = message
        if self._values["stamped_out"]:
            source = self._values["stamp_out"] == "source" and change.gain > 0.0  # a stop is no answer to a state
            message.header.stamp = to_stamp(change.stamp if source else now)
            move = message.twist
        for part, speeds in ((move.linear, change.command[:3]), (move.angular, change.command[3:])):
            part.x, part.y, part.z = speeds
        self._out.publish(message)

    def _report(self) -> tuple[int, str, dict[str, Any]]:
        """Level, message and values of the diagnostics."""
        self._update()
        counts, told = self.gate.counts, self._told
        self._told = counts
        done, missed = counts.completed - told.completed, counts.missed - told.missed
        level, message = (1 if missed > 0 else 0), f"{done} loops completed, {missed} missed"
        if counts.ahead > told.ahead:
            level, message = 2, "stamps lie in the future: the clocks are not in step"
        elif done == missed == 0:
            message = "no commands"
        total = counts.completed + counts.missed
        share = counts.completed / total if total else None
        values = {"age (s)": self.gate.age(self._now()), "deadline (s)": self._values["deadline"]}
        more = {} if self._injection is None else {"lost by the network put on": self._injection.lost}
        return level, message, values | vars(counts) | {"completed share": share} | more

    def _now(self) -> int:
        return self._node.get_clock().now().nanoseconds

    def close(self) -> None:
        """Stops the robot: without this node no command would ever change, and not every base has a timeout."""
        if self.gate.in_force is not None:
            now = self._now()
            self._publish(Change(now, (0.0,) * 6, now, 0.0), now)
            self._out.wait_for_all_acked(_patience())
        self._diagnostics.tell()
        self._record.close()


def _patience() -> Any:
    """For the last command's way."""
    from rclpy.duration import Duration

    return Duration(seconds=0.2)


def main() -> int:
    """Command line."""
    return serve("deadline", _USAGE, DeadlineNode, DEADLINE)


if __name__ == "__main__":
    sys.exit(main())
