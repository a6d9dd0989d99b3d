"""The robots: unicycles that move in real time, send their state every tau and apply what commands come down.

python -m experiments.dds_testbed.robot <plan> <file descriptor>     (started by run.py)
"""

from __future__ import annotations

import gc
import sys
import time
from pathlib import Path

import jax
import numpy as np

from experiments.dds_testbed.dynamics import Robots
from experiments.dds_testbed.link import ROBOT
from experiments.dds_testbed.messages import Command, State
from experiments.dds_testbed.side import Side

__all__ = ["Loops", "main"]


class Loops:
    """The run of loops, and the stamps of each on the robots' clock."""

    def __init__(self, side: Side, start: int) -> None:
        self._plan, self._side = side.plan, side
        self._start = start
        before, after = self._plan.padding
        self._first, self._last = -before, self._plan.num_ticks + after
        self.stamps = np.zeros(
            (2, self._last - self._first, self._plan.num_robots), np.int64
        )  # sent, received; 0 never
        self.robots = Robots(self._plan)

    def run(self) -> None:
        """One loop per robot and tick, from the first of the warm-up to the last after the run."""
        plan = self._plan
        horizon = round(plan.horizon * 1e9)
        for tick in range(self._first, self._last):
            self._receive_until(self._start + tick * plan.tau)
            if tick >= 0:
                self.robots.advance(min(tick * plan.tau, horizon))
            poses, ages, speeds = self.robots.poses().ravel().tolist(), self.robots.ages(), self.robots.speeds()
            for robot in range(plan.num_robots):
                stamp = time.monotonic_ns()
                self.stamps[0, tick - self._first, robot] = stamp
                self._side.write(robot, State(tick, stamp, poses, ages, speeds[robot]))
        self._receive_until(self._start + self._last * plan.tau)

    def _receive_until(self, until: int) -> None:
        while (left := until - time.monotonic_ns()) > 0:
            for received in self._side.take(left):
                if isinstance(received.message, Command):
                    self._received(received.robot, received.message, received.stamp)

    def _received(self, robot: int, message: Command, stamp: int) -> None:
        row = message.sequence - self._first
        if self.stamps[1, row, robot] == 0:
            self.stamps[1, row, robot] = stamp
        if message.sequence >= 0:
            self.robots.command(stamp - self._start, robot, message.sequence, (message.nu, message.omega))


def main(path: str, channel: str) -> None:
    """Runs the robots and keeps their record."""
    jax.config.update("jax_enable_x64", True)
    side = Side(path, channel, ROBOT)
    trial = Robots(side.plan)
    trial.advance(side.plan.tau)  # compiles
    loops = Loops(side, side.match())
    gc.disable()
    loops.run()
    np.savez(Path(side.plan.folder) / "robot.npz", stamps=loops.stamps, **loops.robots.record())
    side.done()


if __name__ == "__main__":
    main(*sys.argv[1:])
