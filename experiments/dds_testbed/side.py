"""What robots and edge have in common: how each gets to its place in the emulator's world."""

from __future__ import annotations

import select
import socket
import time
from typing import Any

from experiments.dds_testbed import link
from experiments.dds_testbed.middleware import Endpoint
from experiments.dds_testbed.namespaces import die_with_parent, enter_private
from experiments.dds_testbed.plan import Plan, receive, send

__all__ = ["Side"]


class Side:
    """One side of a run: its plan, its endpoint for each robot, and its channel to the emulator."""

    def __init__(self, path: str, channel: str, side: int) -> None:
        die_with_parent()
        self._hub = socket.socket(fileno=int(channel))
        enter_private()
        self.plan = Plan.read(path)
        robots = range(self.plan.num_robots)
        send(self._hub, [link.open_tap(each) for each in robots] if self.plan.tap else None, side=side)
        receive(self._hub)  # the other ends are open now
        link.configure(len(robots), side)
        self.endpoints = [Endpoint(each, side, self.plan.reliable, self.plan.depth) for each in robots]

    def match(self) -> None:
        """Waits until every endpoint has found the other side, and says so."""
        while not all(endpoint.matched() for endpoint in self.endpoints):
            time.sleep(0.01)
        send(self._hub, matched=True)

    def done(self) -> None:
        """Says that the records are written, and waits for the other side: with this process its interfaces go."""
        send(self._hub, done=True)
        receive(self._hub)

    def told(self) -> dict[str, Any]:
        """Waits for the next word of the emulator."""
        return receive(self._hub)[0]

    def stopped(self) -> bool:
        """Whether the emulator has said that this is the end."""
        return bool(select.select([self._hub], [], [], 0.0)[0]) and bool(self.told())
