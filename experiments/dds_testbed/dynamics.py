"""The robots' motion: qocjax's own, one step at a time."""

from __future__ import annotations

import jax
import numpy as np

from experiments.dds_testbed.plan import Plan
from qocjax._math import EXACT
from qocjax.robots import Command, Pose, arc, pose_from
from qocjax.ros.gate import DeadlineGate

__all__ = ["Robots"]

_move = jax.jit(lambda pose, speeds, h: arc(pose, Command(speeds[0], speeds[1]), h, EXACT))


class Robots:
    """N robots behind a deadline gate each; times in ns from the start of the run."""

    def __init__(self, plan: Plan) -> None:
        self._pose: Pose = pose_from(np.asarray(plan.start))
        self._speeds = np.zeros((2, plan.num_robots))
        self._now, self._tau = 0, plan.tau
        deadline, tau = plan.design["deadline"], plan.design["tau"]
        self.gates = [DeadlineGate(plan.as_rules(), deadline, tau, origin=0) for _ in range(plan.num_robots)]
        self._pieces: list[tuple[np.ndarray, ...]] = []
        self._changes: list[tuple[float, ...]] = []

    def command(self, arrived: int, robot: int, sequence: int, speeds: tuple[float, float]) -> None:
        """A command has come for a robot."""
        self.gates[robot].arrive(sequence * self._tau, speeds, arrived)

    def advance(self, until: int) -> None:
        """Moves the robots on; commands that are due at exactly `until` are in force after it."""
        changes = [(each, robot) for robot, gate in enumerate(self.gates) for each in gate.advance(until)]
        for change, robot in sorted(changes, key=lambda each: each[0].time):
            self._move_to(change.time)
            self._speeds[:, robot] = change.command
            source = change.stamp if change.gain > 0.0 else change.time  # a stop is no answer to a state
            self._changes.append((robot, source, change.time, *change.command))
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
        return [gate.age(self._now) or 0.0 for gate in self.gates]

    def speeds(self) -> list[tuple[float, float]]:
        """Speeds in force of each robot."""
        return [(float(nu), float(omega)) for nu, omega in self._speeds.T]

    def record(self) -> dict[str, np.ndarray]:
        """Every piece of motion: when it begins (ns) [K], poses [K, N, 3], speeds [K, 2, N]; and the last poses.

        Also what the gates let through, in order: robot, stamp and time of effect (ns), nu, omega, [L, 5].
        """
        changes = np.array(self._changes, float).reshape(-1, 5)  # ns of a run are exact in floats
        time, pose, speeds = (np.stack(each) for each in zip(*self._pieces, strict=True))
        return {"time": time, "pose": pose, "speeds": speeds, "last": self.poses(), "changes": changes}
