"""RELIABLE and BEST_EFFORT between one writer and one reader, event by event: slow, in plain Python, from the protocol.

Written apart from `qocjax.network.dds`: a queue of events, a writer with a history, a reader with a cache. Chance comes
from outside: `fate(kind, number, time)` gives the delay of a message in s, or None where it is lost.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

Fate = Callable[..., float | None]

# At one moment: samples are written, arrive, are told of, and only then a timer goes off.
WRITE, HEARTBEAT_TIMER, AT_WRITER, SAMPLE, HEARTBEAT, ACKNACK_TIMER = range(6)


@dataclass
class Outcome:
    """What came out: when each sample was handed over, and what was sent."""

    handed: dict[int, float] = field(default_factory=dict)
    received: dict[int, float] = field(default_factory=dict)
    asked: list[float] = field(default_factory=list)
    confirmed: list[float] = field(default_factory=list)
    heartbeats: list[float] = field(default_factory=list)
    repaired: int = 0
    packets: int = 0


class Pair:
    """A reliable writer and its reader."""

    def __init__(self, write: list[float], profile: Any, per_packet: int, heartbeats: int, fate: Fate) -> None:
        self.p, self.fate, self.per_packet, self.max_packets = profile, fate, per_packet, 8
        self.out, self.queue, self.order = Outcome(), [], 0
        self.history: dict[int, float] = {}  # writer
        self.written, self.alone, self.most = 0, 0, heartbeats
        self.cache: set[int] = set()  # reader
        self.next, self.first, self.last = 0, 0, -1
        self.void: set[int] = set()
        self.burst, self.burst_at = [], -math.inf
        self.timer, self.asked_at, self.asked_end, self.count = math.inf, -math.inf, 0, 0
        for k, time in enumerate(write):
            if math.isfinite(time):
                self.push(time, WRITE, k)
        self.start = min(write, default=math.inf)

    def push(self, time: float, kind: int, *what: Any) -> None:
        self.order += 1
        heapq.heappush(self.queue, (time, kind, self.order, what))

    def run(self) -> Outcome:
        if self.p.piggyback != "always" and math.isfinite(self.start):
            self.push(self.start + self.p.heartbeat_period, HEARTBEAT_TIMER, -1)
        steps = {WRITE: self.on_write, HEARTBEAT_TIMER: self.on_heartbeat_timer, AT_WRITER: self.on_acknack,
                 SAMPLE: self.on_packet, HEARTBEAT: self.on_heartbeat, ACKNACK_TIMER: self.on_timer}  # fmt: skip
        while self.queue:
            time, kind, _, what = heapq.heappop(self.queue)
            steps[kind](time, *what)
        return self.out

    # writer

    def prune(self, now: float) -> None:
        for k in list(self.history):
            old = self.p.depth is not None and k <= self.written - 1 - self.p.depth
            if old or now >= self.history[k] + self.p.lifespan:
                del self.history[k]

    def announce(self) -> tuple[int, int]:
        return (min(self.history) if self.history else self.written), self.written - 1

    def on_write(self, now: float, k: int) -> None:
        self.history[k], self.written = now, k + 1
        self.prune(now)
        delay = self.fate("data", k, now)
        told = self.announce() if self.carries() else None
        if delay is not None:
            self.push(now + delay, SAMPLE, [k], [], told)
        if self.p.piggyback == "always":
            self.push(now + self.p.heartbeat_period, HEARTBEAT_TIMER, k)

    def carries(self) -> bool:
        return self.p.piggyback == "always"

    def on_heartbeat_timer(self, now: float, since: int) -> None:
        if self.p.piggyback == "always" and since != self.written - 1:
            return  # a later sample carried one
        if self.alone == self.most:
            return  # so that a run ends
        self.prune(now)
        number, self.alone = self.alone, self.alone + 1
        self.out.heartbeats.append(now)
        delay = self.fate("heartbeat", number, now)
        if delay is not None:
            self.push(now + delay, HEARTBEAT, *self.announce(), True)
        self.push(now + self.p.heartbeat_period, HEARTBEAT_TIMER, since)

    def on_acknack(self, now: float, wanted: list[int], number: int) -> None:
        self.prune(now)
        have = [k for k in wanted if k in self.history]
        void = [k for k in wanted if k not in self.history]
        parts: dict[int, list[int]] = {}
        for rank, k in enumerate(have):
            parts.setdefault(min(rank // self.per_packet, self.max_packets - 1), []).append(k)
        self.out.repaired += len(have)
        self.out.packets += max(len(parts), 1)
        for packet in sorted(set(parts) | ({0} if void else set())):
            delay = self.fate("packet", number, now, packet)
            if delay is not None:
                self.push(now + delay, SAMPLE, parts.get(packet, []), void if packet == 0 else [], None)

    # reader

    def hand_over(self, now: float) -> None:
        while self.next in self.cache or self.next in self.void or self.next < self.first:
            if self.next in self.cache:
                self.out.handed[self.next] = now
                self.burst = [*self.burst, self.next] if now == self.burst_at else [self.next]
                self.burst_at = now
                if self.p.reader_depth is not None and len(self.burst) > self.p.reader_depth:
                    del self.out.handed[self.burst.pop(0)]  # nobody reads within a moment
            self.next += 1

    def on_packet(self, now: float, samples: list[int], void: list[int], told: tuple[int, int] | None) -> None:
        for k in samples:
            self.out.received.setdefault(k, now)
        self.cache |= {k for k in samples if k >= self.next}
        self.void |= set(void)
        if told is None:
            self.hand_over(now)
        else:
            self.on_heartbeat(now, *told, False)

    def on_heartbeat(self, now: float, first: int, last: int, alone: bool) -> None:
        at_once = False
        self.first = max(self.first, first)
        self.hand_over(now)
        if last >= self.last:
            self.last = last
            missing = self.missing()
            if missing:
                again = self.asked_at + self.p.nack_period
                at_once = missing[0] >= self.asked_end or now >= again
                due = now + self.p.acknack_delay if at_once else again
                if due < self.timer:
                    self.timer = due
                    self.push(due, ACKNACK_TIMER)
        if alone and not at_once:
            self.out.confirmed.append(now)

    def missing(self) -> list[int]:
        return [k for k in range(max(self.next, self.first), self.last + 1)
                if k not in self.cache and k not in self.void][:256]  # fmt: skip

    def on_timer(self, now: float) -> None:
        if now != self.timer:
            return  # set to another time meanwhile
        self.timer = math.inf
        missing = self.missing()
        if not missing:
            return
        self.asked_at, self.asked_end = now, missing[-1] + 1
        number, self.count = self.count, self.count + 1
        self.out.asked.append(now)
        delay = self.fate("acknack", number, now)
        if delay is not None:
            self.push(now + delay + self.p.repair_delay, AT_WRITER, missing, number)


class ConfirmingPair(Pair):
    """Every heartbeat is answered; a sample carries one while the history is full of what is not acknowledged."""

    acknowledged, carried, begin, payload = 0, 0, 0, 400

    def prune(self, now: float) -> None:
        super().prune(now)
        self.history = {k: time for k, time in self.history.items() if k >= self.acknowledged}

    def carries(self) -> bool:
        full = len(self.history) == self.p.depth
        self.carried += full
        return full

    def on_heartbeat(self, now: float, first: int, last: int, alone: bool) -> None:
        if last >= self.last:
            self.first, self.last = max(self.first, first), last
        self.hand_over(now)
        self.begin = min(self.missing(), default=self.last + 1)
        if self.timer == math.inf:
            self.timer = now + self.p.acknack_delay
            self.push(self.timer, ACKNACK_TIMER)

    def on_packet(self, now: float, samples: list[int], void: list[int], told: tuple[int, int] | None) -> None:
        super().on_packet(now, samples, void, told)
        self.hand_over(now)

    def on_timer(self, now: float) -> None:
        self.timer = math.inf
        missing = [k for k in self.missing() if k < self.begin + 256]  # what one ACKNACK can tell of
        number, self.count = self.count, self.count + 1
        (self.out.asked if missing else self.out.confirmed).append(now)
        if (delay := self.fate("acknack", number, now)) is not None:
            base = missing[0] if missing else self.last + 1
            self.push(now + delay, AT_WRITER, missing, number, base)

    def on_acknack(self, now: float, wanted: list[int], number: int, base: int | None = None) -> None:
        if base is not None:
            self.acknowledged = max(self.acknowledged, base)
            if wanted:
                self.push(now + self.p.repair_delay, AT_WRITER, wanted, number)
            return
        self.prune(now)
        have = [k for k in wanted if k in self.history]
        parts: dict[int, list[int]] = {}
        for rank, k in enumerate(have):
            parts.setdefault(min(rank // self.per_packet, self.max_packets - 1), []).append(k)
        self.out.repaired += len(have)
        self.out.packets += len(parts)
        for packet, repairs in parts.items():
            pieces = math.ceil((64 + (36 + self.payload) * len(repairs) - 20) / 1480)
            if (delay := self.fate("packet", number, now, packet, pieces)) is not None:
                self.push(now + delay, SAMPLE, repairs, [], None)


def best_effort(write: list[float], fate: Fate) -> dict[int, float]:
    """Samples handed over by a BEST_EFFORT reader: as they come, none older than the newest."""
    arrivals = []
    for k, time in enumerate(write):
        if math.isfinite(time) and (delay := fate("data", k, time)) is not None:
            arrivals.append((time + delay, k))
    handed, newest = {}, -1
    for time, k in sorted(arrivals):
        if k > newest:
            handed[k] = time
            newest = k
    return handed
