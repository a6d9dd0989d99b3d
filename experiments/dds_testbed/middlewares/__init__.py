"""The middleware of a run: one module for each, behind one small interface.

A module `middlewares/NAME.py` has a class `Ends`, one side's ends of all links, with the methods of `Middleware`; its
name goes into `_NEEDS` and into the configuration.
"""

from __future__ import annotations

import importlib.util
from importlib import import_module
from typing import Protocol

from experiments.dds_testbed.messages import Message, Received
from experiments.dds_testbed.plan import Plan

__all__ = ["MIDDLEWARES", "Middleware", "connect", "require"]

_NEEDS = {"cyclonedds": ("cyclonedds", "dds"), "fastdds": ("rclpy", "ros2"), "zenoh": ("zenoh", "zenoh")}

MIDDLEWARES = tuple(_NEEDS)


class Middleware(Protocol):
    """One side's ends of the links: for each robot it writes one topic and reads the other."""

    def matched(self) -> bool:
        """Whether every writer has found its reader on the other side."""
        ...

    def begin(self, start: int) -> None:
        """Takes the first sampling instant of the run (ns), before anything is written or taken."""
        ...

    def write(self, robot: int, message: Message) -> None:
        """Sends a message, a State from the robots, a Command from the edge."""
        ...

    def take(self, nanoseconds: int) -> list[Received]:
        """Takes what has arrived, oldest first for each robot, at the latest after a time."""
        ...

    def close(self) -> None:
        """Ends what runs in the background."""
        ...


def require(name: str) -> None:
    """Checks that a middleware is installed.

    Raises:
        OSError: It is not.
    """
    module, extra = _NEEDS[name]
    if importlib.util.find_spec(module) is None:
        raise OSError(f"middleware={name} needs {module}, found none: pip install 'qocjax[{extra}]'")


def connect(plan: Plan, side: int) -> Middleware:
    """The ends of one side, whose interfaces are there already."""
    made: Middleware = import_module(f"{__name__}.{plan.middleware}").Ends(plan, side)
    return made
