"""What robots and edge tell each other, whatever carries it."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["Command", "Message", "Received", "State"]


class State(NamedTuple):
    """What a robot sends up at a sampling instant."""

    sequence: int
    uplink_send: int  # ns
    poses: list[float]  # x, y, heading of each robot
    ages: list[float]  # s, of each robot
    speeds: tuple[float, float] = (0.0, 0.0)  # nu, omega in force of this robot, which the surrogate law does not read


class Command(NamedTuple):
    """What comes down for it."""

    sequence: int
    nu: float
    omega: float

    @property
    def speeds(self) -> tuple[float, float]:
        """nu, omega."""
        return self.nu, self.omega


Message = State | Command


class Received(NamedTuple):
    """A message that a side has got."""

    robot: int
    message: Message
    stamp: int  # ns, when the process took it
    mark: bytes  # part of the message as it is on the wire, of no other message
