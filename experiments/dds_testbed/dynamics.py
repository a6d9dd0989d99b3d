"""The robots' motion and the edge's law: qocjax's own, one step at a time."""

from __future__ import annotations

import heapq
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from experiments.dds_testbed.plan import Plan
from qocjax._math import EXACT
from qocjax.controllers import apf
from qocjax.unicycle import Command, Pose, arc, pose_from

__all__ = ["Law", "Robots", "law_of"]

Law = Callable[[list[float], list[float]], np.ndarray]

_move = jax.jit(lambda pose, speeds, h: arc(pose, Command(speeds[0], speeds[1]), h, EXACT))


def law_of(plan: Plan) -> Law:
    """The controller as a function of poses [3N] and ages [N] that gives speeds [2, N], compiled."""
    goal = jnp.broadcast_to(jnp.asarray(plan.goal), (plan.num_robots, 2))

    @jax.jit
    def compiled(poses: jax.Array, ages: jax.Array) -> jax.Array:
        command = apf(pose_from(poses.reshape(-1, 3)), ages, (goal[:, 0], goal[:, 1]), plan.as_design(), EXACT)
        return jnp.stack([command.nu, command.omega])

    return lambda poses, ages: np.asarray(compiled(np.asarray(poses), np.asarray(ages)))


class Robots:
    """N robots whose commands change at given times; times in ns from the start of the run."""

    def __init__(self, plan: Plan) -> None:
        self._pose: Pose = pose_from(np.asarray(plan.start))
        self._speeds = np.zeros((2, plan.num_robots))
        self._now = 0
        self._source = [0] * plan.num_robots  # when the command in force was sampled for
        self._newest = [-1] * plan.num_robots
        self._due: list[tuple[int, int, int, tuple[float, float]]] = []
        self._pieces: list[tuple[np.ndarray, ...]] = []

    def command(self, due: int, robot: int, sequence: int, speeds: tuple[float, float]) -> None:
        """A command that takes effect at `due`; one older than the command in force has no effect."""
        heapq.heappush(self._due, (max(due, self._now), robot, sequence, speeds))

    def advance(self, until: int, tau: int) -> None:
        """Moves the robots on; commands that are due at exactly `until` are in force after it."""
        while self._due and self._due[0][0] <= until:
            due, robot, sequence, speeds = heapq.heappop(self._due)
            if sequence > self._newest[robot]:
                self._move_to(due)
                self._newest[robot], self._source[robot] = sequence, sequence * tau
                self._speeds[:, robot] = speeds
        self._move_to(until)

    def _move_to(self, time: int) -> None:
        if time > self._now:
            speeds = self._speeds.copy()
            self._pieces.append((np.array(self._now), self.poses(), speeds))
            self._pose = _move(self._pose, speeds, (time - self._now) * 1e-9)
            self._now = time

    def poses(self) -> np.ndarray:
        """Where they are, [N, 3]."""
        return np.stack([np.asarray(self._pose.x), np.asarray(self._pose.y), np.asarray(self._pose.heading)], axis=-1)

    def ages(self) -> list[float]:
        """Age of the command in force of each robot (s)."""
        return [(self._now - source) * 1e-9 for source in self._source]

    def record(self) -> dict[str, np.ndarray]:
        """Every piece of motion: when it begins (ns) [K], poses [K, N, 3], speeds [K, 2, N]; and the last poses."""
        time, pose, speeds = (np.stack(each) for each in zip(*self._pieces, strict=True))
        return {"time": time, "pose": pose, "speeds": speeds, "last": self.poses()}
