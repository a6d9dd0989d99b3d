"""`python -m qocjax.ros.stamps`: gives commands the stamp of the pose that they answer, where a controller does not."""

from __future__ import annotations

import sys
from typing import Any

from qocjax.ros.node import declared, from_stamp, reliable, serve, to_stamp
from qocjax.ros.pairing import Pairing
from qocjax.ros.parameters import STAMPS
from qocjax.ros.reports import Diagnostics, Record

__all__ = ["StampNode", "main"]

_USAGE = """usage: python -m qocjax.ros.stamps --ros-args [-p pose_type:=Odometry ...] [-r pose:=odom ...]

Runs beside the controller. Takes poses on pose and commands on cmd_vel_in (TwistStamped or Twist); hands on on
cmd_vel_out each as TwistStamped with the stamp of the newest pose that it can have been computed from; tells on
/diagnostics how sure that is. Parameters:"""


class StampNode:
    """Pairs of poses and commands between two topics.

    Raises:
        ValueError: A parameter is unknown or out of range.
    """

    def __init__(self, node: Any) -> None:
        from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist, TwistStamped
        from nav_msgs.msg import Odometry

        values = declared(node, STAMPS)
        self._node, self._stamped = node, values["stamped_in"]
        self.pairing = Pairing(values["fastest"], values["slowest"])
        self._record = Record(values["record"], ("sequence", "edge_receive", "edge_send", "source_stamp", "spread"))
        self._sequence = 0  # of this writer, as its readers see it too
        self._out_type = TwistStamped
        kinds = {each.__name__: each for each in (Odometry, PoseWithCovarianceStamped, PoseStamped)}
        self._out = node.create_publisher(TwistStamped, "cmd_vel_out", **reliable(10))
        kind = kinds[values["pose_type"]]
        self._poses = node.create_subscription(kind, "pose", callback=self._pose, **reliable(10))
        self._commands = node.create_subscription(
            TwistStamped if self._stamped else Twist, "cmd_vel_in", callback=self._command, **reliable(10)
        )
        self._diagnostics = Diagnostics(node, "pairs", values["diagnostics_period"], self._report)

    def _pose(self, message: Any) -> None:
        self.pairing.pose(from_stamp(message.header.stamp), self._now())

    def _command(self, message: Any) -> None:
        pair = self.pairing.command(self._now(), from_stamp(message.header.stamp) if self._stamped else None)
        if pair is None:
            self._node.get_logger().warning(
                "dropped a command, as no pose has come that it can answer", throttle_duration_sec=5.0
            )
            return
        answer = self._out_type()
        answer.twist = message.twist if self._stamped else message
        answer.header.frame_id = message.header.frame_id if self._stamped else ""
        answer.header.stamp = to_stamp(pair.stamp)
        self._sequence += 1
        sent = self._now()
        self._out.publish(answer)
        self._record.add(self._sequence, pair.received, sent, pair.stamp, pair.spread)

    def _report(self) -> tuple[int, str, dict[str, Any]]:
        """Level, message and values of the diagnostics."""
        counts = self.pairing.counts
        values = {
            "pairs": counts.pairs, "proven": counts.proven, "ambiguous": counts.ambiguous,
            "ambiguous share": counts.ambiguous_share, "unpaired": counts.unpaired,
            "spread mean (s)": counts.spread_mean, "spread max (s)": 1e-9 * counts.spread_max,
        }  # fmt: skip
        if counts.pairs == 0:
            return (1, "commands, but no pose", values) if counts.unpaired else (0, "no commands", values)
        sure = counts.ambiguous_share <= 0.5
        return (0 if sure else 1), f"{counts.ambiguous_share:.1%} of the pairs are ambiguous", values

    def _now(self) -> int:
        return self._node.get_clock().now().nanoseconds

    def close(self) -> None:
        """Tells for the last time, and ends the record."""
        self._diagnostics.tell()
        self._record.close()


def main() -> int:
    """Command line."""
    return serve("stamps", _USAGE, StampNode, STAMPS)


if __name__ == "__main__":
    sys.exit(main())
