"""Parameters of the nodes: names, defaults (which say the type), meaning and range, in ROS's way."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["DEADLINE", "STAMPS", "Parameter"]


@dataclass(frozen=True)
class Parameter:
    """One parameter of a node."""

    name: str
    default: float | int | bool | str
    meaning: str
    least: float = 0.0  # of numbers
    most: float = 0.0
    choices: tuple[str, ...] = ()  # of strings; empty for any

    @property
    def type(self) -> str:
        """What ROS calls it."""
        return {float: "double", int: "integer", bool: "bool", str: "string"}[type(self.default)]

    @property
    def range(self) -> str:
        """What may be given, in words."""
        if self.choices:
            return ", ".join(self.choices)
        return f"{self.least:.12g} to {self.most:.12g}" if self.type in ("double", "integer") else ""


_DIAGNOSTICS = Parameter("diagnostics_period", 1.0, "s between two messages on /diagnostics", 0.01, 3600.0)
_RECORD = "CSV file for {}; with a number where it is there already; empty for none"

DEADLINE = (
    Parameter("deadline", 0.2, "s from a command's stamp until it takes effect; one that comes later is dropped",
              0.0, 60.0),
    Parameter("actuation", "deadline", "whether a command takes effect at stamp + deadline, or when it comes",
              choices=("deadline", "arrival")),
    Parameter("hold", "timeout", "what a missed loop does: the command stays, the robot stops, stops at hold_timeout, "
              "or the command fades", choices=("hold", "zero", "timeout", "decay")),
    Parameter("hold_timeout", 1.0, "s of age, of hold timeout", 0.001, 60.0),
    Parameter("hold_decay", 0.5, "s, time constant of hold decay", 0.001, 60.0),
    Parameter("period", 0.0, "s between the stamps of two commands; 0 where it is not known, which zero and decay "
              "cannot do with", 0.0, 60.0),
    Parameter("jitter", 0.0, "s by which stamps may be off the period; so much later a loop is missed", 0.0, 30.0),
    Parameter("ahead", 0.02, "s by which a stamp may lie in the future, as where a simulated clock goes in steps", 0.0,
              1.0),
    Parameter("stamped_out", True, "whether TwistStamped goes out, else Twist"),
    Parameter("stamp_out", "source", "stamp of what goes out: of the state it was computed from, or now",
              choices=("source", "now")),
    Parameter("network", "", "options of a network of qocjax whose delays and losses are put on the commands, such as "
              "'network=kth_5g network.uplink_loss=0.1'; needs the period; empty for none"),
    Parameter("network_seed", 0, "of the drawn loop times", 0, 2**31 - 1),
    Parameter("network_loops", 16384, "loop times that are drawn; after the last the first comes again", 1, 2**20),
    Parameter("record", "", _RECORD.format("the loops: sequence, uplink_send, downlink_receive (ns)")),
    _DIAGNOSTICS,
)  # fmt: skip

STAMPS = (
    Parameter("pose_type", "Odometry", "type of the poses that the controller reads",
              choices=("Odometry", "PoseWithCovarianceStamped", "PoseStamped")),
    Parameter("stamped_in", True, "whether TwistStamped comes in, else Twist"),
    Parameter("fastest", 0.0, "s that a command takes at least from reading the pose until it comes here", 0.0, 60.0),
    Parameter("slowest", 0.05, "s that it takes at most, such as a cycle of the controller", 0.0, 60.0),
    Parameter("record", "", _RECORD.format("the loops: sequence, edge_receive, edge_send, source_stamp, spread (ns)")),
    _DIAGNOSTICS,
)  # fmt: skip
