"""What robots and edge tell each other."""

# No `from __future__ import annotations`: the middleware reads the types of the fields.

from dataclasses import dataclass

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int64, sequence

__all__ = ["Command", "State"]


@dataclass
class State(IdlStruct, typename="qocjax.State"):
    """What a robot sends up at a sampling instant; stamps in ns."""

    sequence: int64
    uplink_send: int64
    poses: sequence[float64]  # x, y, heading of each robot
    ages: sequence[float64]  # s, of each robot


@dataclass
class Command(IdlStruct, typename="qocjax.Command"):
    """What comes down for it."""

    sequence: int64
    nu: float64
    omega: float64
