"""A queue between the threads of a middleware and the loop of a side."""

from __future__ import annotations

import time
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

__all__ = ["Arrival", "Arrivals"]


class Arrival(NamedTuple):
    """What came, before it is decoded."""

    robot: int
    content: Any
    stamp: int  # ns


class Arrivals:
    """Takes from any thread, gives to one."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[Arrival] = SimpleQueue()

    def put(self, robot: int, content: Any) -> None:
        """Takes what comes now."""
        self._queue.put(Arrival(robot, content, time.monotonic_ns()))

    def take(self, nanoseconds: int) -> list[Arrival]:
        """Gives all that has come, as soon as something has, at the latest after a time."""
        found = []
        try:
            found.append(self._queue.get(timeout=max(nanoseconds, 0) * 1e-9))
            while True:
                found.append(self._queue.get_nowait())
        except Empty:
            return found
