"""The link emulator: every frame waits for the delay that the radio gives it, or is dropped."""

from __future__ import annotations

import contextlib
import gc
import heapq
import os
import select
import time
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Protocol

from experiments.dds_testbed.crossing import Crossed
from experiments.dds_testbed.link import SIDES, Port
from experiments.dds_testbed.namespaces import run_ahead
from experiments.dds_testbed.rtps import submessages

__all__ = ["Queue", "Relay", "raise_priority"]

_AHEAD_OF_SIDES = 2
_FRAME, _ETHERNET = 65536, 14  # bytes: room for a frame, its header, which is no part of the IP packet


class Fate(Protocol):
    """What the radio does to a frame."""

    def fate(self, link: int, side: int, now: int) -> float:
        """Delay (s), infinite if dropped, of a frame that `side` of a link sends at `now` (ns)."""
        ...


class Queue:
    """Frames on their way, by the time they are due; within a flow none overtakes another if `in_order`."""

    def __init__(self, in_order: bool) -> None:
        self._in_order = in_order
        self._heap: list[tuple[int, int, Port, bytes]] = []
        self._last: dict[int, int] = {}  # by file descriptor of the port
        self._count = 0

    def push(self, port: Port, frame: bytes, due: int) -> None:
        """Takes in a frame to be written to `port` at `due` (ns)."""
        if self._in_order:
            due = self._last[port.fd] = max(due, self._last.get(port.fd, due))
        self._count += 1
        heapq.heappush(self._heap, (due, self._count, port, frame))

    def pop(self, now: int) -> Iterable[tuple[int, Port, bytes]]:
        """Gives out, in order, what is due by `now`."""
        while self._heap and self._heap[0][0] <= now:
            due, _, port, frame = heapq.heappop(self._heap)
            yield due, port, frame

    def next_due(self, latest: int) -> int:
        """When the next frame is due, at most `latest`."""
        return min(self._heap[0][0], latest) if self._heap else latest


class Relay:
    """Carries frames between the two ports of each link; without a radio at once."""

    def __init__(self, ports: Iterable[Port], in_order: bool) -> None:
        self._ports = {port.fd: port for port in ports}
        self._peer = {
            port.fd: next(each for each in self._ports.values() if (each.link, each.side) == (port.link, 1 - port.side))
            for port in self._ports.values()
        }
        self._queue = Queue(in_order)
        self.radio: Fate | None = None
        self.lateness: list[int] = []  # ns, of each frame written while there is a radio
        self.crossed: list[Crossed] = []  # these frames
        self.counts: Counter[tuple[int, str]] = Counter()  # by side that sent, and what is counted

    def run(self, until: Callable[[], bool] | int, watched: Iterable[tuple[int, Callable[[], None]]] = ()) -> None:
        """Carries frames until a time (ns) or a condition; also serves other file descriptors with their handlers."""
        handlers = dict(watched)
        files = [*self._ports, *handlers]
        while True:
            now = time.monotonic_ns()
            if until() if callable(until) else now >= until:
                return
            latest = now + 50_000_000 if callable(until) else until
            wait = max(self._queue.next_due(latest) - now, 0) * 1e-9
            for fd in select.select(files, [], [], wait)[0]:
                handlers[fd]() if fd in handlers else self._take(self._ports[fd])
            self._deliver()

    def _take(self, port: Port) -> None:
        """Reads what the kernel holds of one interface."""
        while True:
            try:
                frame = os.read(port.fd, _FRAME)
            except OSError:  # nothing more to read, or the side is gone, which its channel tells
                return
            now = time.monotonic_ns()
            delay = 0.0 if self.radio is None else self.radio.fate(port.link, port.side, now)
            dropped = delay == float("inf")
            self._count(port, frame, dropped)
            if not dropped:
                self._queue.push(self._peer[port.fd], frame, now + round(delay * 1e9))

    def _deliver(self) -> None:
        for due, port, frame in self._queue.pop(time.monotonic_ns()):
            before = time.monotonic_ns()
            with contextlib.suppress(OSError):
                os.write(port.fd, frame)
            if self.radio is not None:
                self.crossed.append(Crossed(before, port.link, port.side, frame[port.header :]))
                self.lateness.append(time.monotonic_ns() - due)

    def _count(self, port: Port, frame: bytes, dropped: bool) -> None:
        size = max(len(frame) - port.header - _ETHERNET, 0)
        for name, amount in (("frames", 1), ("bytes", size)):
            self.counts[port.side, name] += amount
            self.counts[port.side, f"{name}_dropped"] += amount * dropped
        for name in submessages(frame[port.header :]):
            self.counts[port.side, name] += 1

    def snapshot(self) -> list[Counter[str]]:
        """Totals so far, of each side that sends."""
        return [Counter({name: n for (side, name), n in self.counts.items() if side == each}) for each in SIDES]


def raise_priority() -> None:
    """Lets the emulator run ahead of other processes where it may, and without pauses to collect garbage."""
    gc.collect()
    gc.freeze()
    gc.disable()
    run_ahead(_AHEAD_OF_SIDES)
