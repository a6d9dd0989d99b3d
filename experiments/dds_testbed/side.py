"""What robots and edge have in common: how each gets to its place in the emulator's world, and what it receives."""

from __future__ import annotations

import select
import socket
import time
from pathlib import Path
from typing import Any

import numpy as np

from experiments.dds_testbed import link, middlewares
from experiments.dds_testbed.messages import Message, Received
from experiments.dds_testbed.namespaces import die_with_parent, enter_private, run_ahead
from experiments.dds_testbed.plan import Plan, receive, send

__all__ = ["Side"]

_PRIORITY = 1


class Side:
    """One side of a run: its plan, its ends of the links, and its channel to the emulator."""

    def __init__(self, path: str, channel: str, side: int) -> None:
        die_with_parent()
        self._hub = socket.socket(fileno=int(channel))
        enter_private()
        self.plan, self._side = Plan.read(path), side
        robots = range(self.plan.num_robots)
        send(self._hub, [link.open_tap(each) for each in robots] if self.plan.tap else None, side=side)
        receive(self._hub)  # the other ends are open now
        run_ahead(_PRIORITY)  # with the middleware's threads, or what they do late would not be seen
        self._ends = middlewares.connect(self.plan, side)
        self._received: list[Received] = []

    def match(self) -> int:
        """Waits until every writer has found the other side, and says so; returns the first sampling instant (ns)."""
        while not self._ends.matched():
            time.sleep(0.01)
        send(self._hub, matched=True)
        start = int(self.told()["start"])
        self._ends.begin(start)
        return start

    def write(self, robot: int, message: Message) -> None:
        """Sends a message."""
        self._ends.write(robot, message)

    def take(self, nanoseconds: int) -> list[Received]:
        """Takes what has arrived, at the latest after a time, and keeps an account of it."""
        found = self._ends.take(nanoseconds)
        self._received += found
        return found

    def done(self) -> None:
        """Writes the account, says so, and waits for the other side: with this process its interfaces go."""
        rows = [(each.robot, each.message.sequence, each.stamp) for each in self._received]
        marks = [each.mark for each in self._received]
        speeds = [each.message.speeds for each in self._received]
        np.savez(
            Path(self.plan.folder) / f"received_{self._side}.npz", rows=np.array(rows, np.int64).reshape(-1, 3),
            speeds=np.array(speeds, float).reshape(-1, 2), marks=np.array(marks, f"V{max(map(len, marks), default=1)}"),
        )  # fmt: skip
        send(self._hub, done=True)
        receive(self._hub)
        self._ends.close()

    def told(self) -> dict[str, Any]:
        """Waits for the next word of the emulator."""
        return receive(self._hub)[0]

    def stopped(self) -> bool:
        """Whether the emulator has said that this is the end."""
        return bool(select.select([self._hub], [], [], 0.0)[0]) and bool(self.told())
