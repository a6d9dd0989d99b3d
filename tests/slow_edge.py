"""An edge with a finite number of workers in plain Python: one instant after the other (section 12 of the model).

Slow and independent on purpose, as the slow loop is. Times are whole picoseconds inside, so that what falls on one
instant does so exactly, as long as tau and the times given are whole picoseconds up to rounding. The check values of
the model were computed in float64, where a sum of computations falls a rounding error beside the tick that it should
meet, on either side; `exact=False` adds up in the same way.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from typing import Any

import numpy as np

PER_SECOND = 10**12
DISCIPLINES = ("unlimited", "skip", "latest", "fifo")


def whole(seconds: float) -> float:
    """Whole picoseconds, or inf."""
    return round(seconds * PER_SECOND) if math.isfinite(seconds) else math.inf


def rotating(p: int, i: int, num_robots: int) -> tuple[int, int]:
    """Where robot i's sample of tick p stands among those of one instant."""
    return (i - p) % num_robots, p


@dataclass(eq=False)
class Sample:
    """What robot i sampled at tick p, on its way through the edge; times in ps, or s."""

    p: int
    i: int
    arrival: float  # inf where lost on the way
    need: float  # of a worker's time
    given_up: float  # the instant at which nobody waits for it any more; inf without abort
    start: float = math.inf  # of the computation; inf where there is none

    @property
    def free(self) -> float:
        """When its worker is idle again."""
        return min(self.start + self.need, self.given_up)

    @property
    def end(self) -> float:
        """When its computation ends, exactly at the deadline included; inf where it does not."""
        return self.start + self.need if self.start + self.need <= self.given_up else math.inf


def wait(waiting: list[Sample], sample: Sample, discipline: str) -> None:
    """What becomes of a sample that finds no idle worker; `waiting` is in the order of turns."""
    if discipline == "fifo":
        waiting.append(sample)
    elif discipline == "latest":
        place = next((k for k, other in enumerate(waiting) if other.i == sample.i), None)
        if place is None:
            waiting.append(sample)
        elif waiting[place].p < sample.p:  # newer is what was sampled later, not what arrived later
            waiting[place] = sample


def serve(samples: list[Sample], num_robots: int, workers: float, discipline: str) -> None:
    """Lead the samples through one group of workers: sets the starts."""
    due = defaultdict(list)
    for sample in sorted(samples, key=lambda s: rotating(s.p, s.i, num_robots)):
        if sample.arrival < math.inf:
            due[sample.arrival].append(sample)
    instants = list(due)
    heapify(instants)
    running: list[Sample] = []
    waiting: list[Sample] = []

    def begin(sample: Sample, now: float) -> None:
        sample.start = now
        running.append(sample)
        if sample.free < math.inf:
            heappush(instants, sample.free)

    while instants:
        now = heappop(instants)
        while instants and instants[0] == now:
            heappop(instants)
        running[:] = [s for s in running if s.free > now]
        waiting[:] = [s for s in waiting if s.given_up > now]
        while waiting and len(running) < workers:
            begin(waiting.pop(0), now)
        for sample in due.pop(now, []):
            if sample.given_up <= now:
                continue
            if len(running) < workers:
                begin(sample, now)
            else:
                wait(waiting, sample, discipline)


@dataclass(frozen=True)
class Served:
    """What an edge made of all samples, each [P, N] in s after its sampling instant, inf where there is none."""

    start: np.ndarray  # of the computation
    end: np.ndarray  # of the computation, if it comes to its end
    busy: float  # s of all workers together, for computations that are given up too


def edge(
    uplink: Any, compute: Any, tau: float, *, workers: int, per_robot: bool, discipline: str,
    deadline: float | None = None, exact: bool = True,
) -> Served:  # fmt: skip
    """Lead all samples through the edge until it has drained; arguments as for `edge_loop`."""
    if discipline not in DISCIPLINES:
        raise ValueError(f"discipline: got {discipline!r}, expected one of {DISCIPLINES}")
    if discipline != "unlimited" and workers < 1:
        raise ValueError(f"workers: got {workers}, expected at least 1")
    unit, in_units = (PER_SECOND, whole) if exact else (1, float)
    period, patience = in_units(tau), math.inf if deadline is None else in_units(deadline)
    shape = num_ticks, num_robots = np.shape(uplink)
    samples = [
        Sample(p, i, p * period + in_units(uplink[p][i]), in_units(compute[p][i]), p * period + patience)
        for p in range(num_ticks)
        for i in range(num_robots)
    ]
    groups = [samples[i::num_robots] for i in range(num_robots)] if per_robot else [samples]
    for group in groups:
        serve(group, num_robots, math.inf if discipline == "unlimited" else workers, discipline)
    return Served(
        np.reshape([(s.start - s.p * period) / unit for s in samples], shape),
        np.reshape([(s.end - s.p * period) / unit for s in samples], shape),
        sum(s.free - s.start for s in samples if s.start < math.inf) / unit,
    )


def edge_loop(
    uplink: Any, compute: Any, downlink: Any, tau: float, *, workers: int, per_robot: bool, discipline: str,
    deadline: float | None = None, exact: bool = True,
) -> np.ndarray:  # fmt: skip
    """Loop times through a finite edge.

    `uplink`, `compute` and `downlink` are [P, N] in s, inf where lost, in any order of arrival; `workers` is for each
    robot with `per_robot`, else for all together, and unused by `unlimited`. A `deadline` (s) stands for `abort`.
    `exact` says whether sums of times are exact, or rounded to float64.

    Returns:
        T_net [P, N] in s, inf where lost, dropped or given up.

    Raises:
        ValueError: for an unknown discipline, or less than one worker.
    """
    options = {"workers": workers, "per_robot": per_robot, "discipline": discipline, "deadline": deadline}
    return edge(uplink, compute, tau, **options, exact=exact).end + np.asarray(downlink, float)
