"""The testbed's robots and law without a middleware: every loop takes the time that it is given."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from experiments.dds_testbed.dynamics import Robots
from experiments.dds_testbed.law import Law
from experiments.dds_testbed.messages import State
from experiments.dds_testbed.plan import Plan


class Driven(NamedTuple):
    """What became of a run."""

    robots: Robots
    poses: np.ndarray  # [P, N, 3] at the sampling instants
    received: list[tuple[int, int, int, tuple[float, float]]]  # of each command: when (ns), robot, sequence, speeds


def drive(plan: Plan, law: Law, times: np.ndarray) -> Driven:
    """Drives the robots with loop times [P, N] (s, inf where lost)."""
    robots, poses, coming, received = Robots(plan), [], [], []
    for tick in range(plan.num_ticks):
        now = tick * plan.tau
        for each in sorted(each for each in coming if each[0] <= now):
            robots.command(*each)
            received.append(each)
        coming = [each for each in coming if each[0] > now]
        robots.advance(now)
        poses.append(robots.poses())
        for robot in np.flatnonzero(np.isfinite(times[tick])).tolist():
            state = State(tick, 0, poses[-1].ravel().tolist(), robots.ages(), robots.speeds()[robot])
            coming.append((now + round(times[tick, robot] * 1e9), robot, tick, law(robot, state)))
    robots.advance(round(plan.horizon * 1e9))
    return Driven(robots, np.stack(poses), received)
