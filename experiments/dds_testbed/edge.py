"""The edge: computes a command from every state that comes up, and sends it down.

python -m experiments.dds_testbed.edge <plan> <file descriptor>     (started by run.py)
"""

from __future__ import annotations

import gc
import heapq
import sys
import time
from pathlib import Path

import jax
import numpy as np

from experiments.dds_testbed.config import written_config
from experiments.dds_testbed.law import Law, law_of
from experiments.dds_testbed.link import EDGE
from experiments.dds_testbed.messages import Command, State
from experiments.dds_testbed.side import Side

__all__ = ["Edge", "main"]

_LONGEST_WAIT = 50_000_000  # ns, between two looks at the channel


class Edge:
    """Answers states, each after the time that its computation takes."""

    def __init__(self, side: Side, law: Law) -> None:
        self._side, self._law = side, law
        self._compute = np.load(Path(side.plan.folder) / "compute.npy")  # [M, N] s
        self._waiting: list[tuple[int, int, int, Command]] = []
        self.stamps: list[tuple[int, int, int, int]] = []  # robot, sequence, edge receive, edge send

    def run(self) -> None:
        """Answers until told to stop."""
        while not self._side.stopped():
            due = self._waiting[0][0] - time.monotonic_ns() if self._waiting else _LONGEST_WAIT
            for received in self._side.take(min(due, _LONGEST_WAIT)):
                if isinstance(received.message, State):
                    self._compute_for(received.robot, received.message, received.stamp)
            self._answer()

    def _compute_for(self, robot: int, state: State, received: int) -> None:
        nu, omega = self._law(robot, state)
        due = received + round(self._compute[state.sequence % len(self._compute), robot] * 1e9)
        command = Command(sequence=state.sequence, nu=nu, omega=omega)
        heapq.heappush(self._waiting, (due, len(self.stamps), robot, command))
        self.stamps.append((robot, state.sequence, received, 0))

    def _answer(self) -> None:
        while self._waiting and self._waiting[0][0] <= time.monotonic_ns():
            _, row, robot, command = heapq.heappop(self._waiting)
            self.stamps[row] = (*self.stamps[row][:3], time.monotonic_ns())
            self._side.write(robot, command)


def main(path: str, channel: str) -> None:
    """Runs the edge and keeps its record."""
    jax.config.update("jax_enable_x64", True)
    side = Side(path, channel, EDGE)
    config = written_config(Path(side.plan.folder))
    law = law_of(side.plan, config.build_controller(), config.key)
    law(0, State(-1, 0, np.ravel(side.plan.start).tolist(), [0.0] * side.plan.num_robots))  # compiles
    side.match()
    gc.disable()
    edge = Edge(side, law)
    edge.run()
    np.save(Path(side.plan.folder) / "edge.npy", np.array(edge.stamps, np.int64).reshape(-1, 4))
    side.done()


if __name__ == "__main__":
    main(*sys.argv[1:])
