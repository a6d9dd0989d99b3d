"""What a run must offer to be drawn, as checked arrays; the closest approach and the time on the way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Paths", "RunLike", "check_run", "closest_approach", "travel_time"]


class RunLike(Protocol):
    """What a recorded or simulated run must offer to be drawn. P ticks, N robots."""

    @property
    def time(self) -> ArrayLike:
        """[P+1] s."""

    @property
    def pose(self) -> ArrayLike:
        """[P+1, N, 3] m, m, rad."""

    @property
    def reference(self) -> ArrayLike:
        """[P+1, 2] m for the group, or [P+1, N, 2] for each robot."""

    @property
    def goal(self) -> ArrayLike:
        """[2] m for the group, or [N, 2] for each robot."""

    @property
    def d_safe(self) -> ArrayLike:
        """Nominal safety distance between two robots, m."""

    @property
    def robot_radius(self) -> ArrayLike:
        """Radius of a robot's body, m."""

    @property
    def deadline(self) -> ArrayLike | None:
        """The deadline Δ, s; None where none is known, as of a recording."""

    @property
    def auc(self) -> ArrayLike:
        """[N] s, normalised AUC of each robot."""

    @property
    def min_distance(self) -> ArrayLike:
        """Smallest distance between two robots, m; infinite for one robot."""


@dataclass(frozen=True)
class Paths:
    """A run as checked arrays, R = 1 or N references and goals."""

    time: NDArray[np.float64]  # [P+1]
    pose: NDArray[np.float64]  # [P+1, N, 3]
    reference: NDArray[np.float64]  # [P+1, R, 2]
    goal: NDArray[np.float64]  # [R, 2]
    auc: NDArray[np.float64]  # [N]
    d_safe: float
    robot_radius: float
    deadline: float | None
    min_distance: float


def check_run(run: RunLike) -> Paths:
    """Returns the run as float arrays of checked shapes.

    Raises:
        ValueError: An attribute has the wrong shape or is not finite, or time does not increase.
    """
    time = _numbers("time", run.time, (None,))
    ticks = time.size
    if not (np.diff(time) > 0.0).all():
        raise ValueError("time: got instants out of order, expected increasing ones")
    pose = _numbers("pose", run.pose, (ticks, None, 3))
    robots = pose.shape[1]
    if ticks < 2 or robots < 1:
        raise ValueError(f"pose: got shape {pose.shape}, expected at least two instants and one robot")
    reference = _numbers("reference", run.reference, (ticks, 2), (ticks, robots, 2)).reshape(ticks, -1, 2)
    goal = _numbers("goal", run.goal, (2,), (robots, 2)).reshape(-1, 2)
    auc = _numbers("auc", run.auc, (robots,))
    scalars = {name: float(_numbers(name, getattr(run, name), ())) for name in ("d_safe", "robot_radius")}
    deadline = None if run.deadline is None else float(_numbers("deadline", run.deadline, ()))
    min_distance = float(np.asarray(run.min_distance))
    if robots > 1 and not np.isfinite(min_distance):
        raise ValueError(f"min_distance: got {min_distance}, expected a finite distance for {robots} robots")
    return Paths(time, pose, reference, goal, auc, **scalars, deadline=deadline, min_distance=min_distance)


def _numbers(name: str, value: ArrayLike, *shapes: tuple[int | None, ...]) -> NDArray[np.float64]:
    array = np.asarray(value, dtype=float)
    if not any(
        array.ndim == len(shape) and all(n is None or n == m for n, m in zip(shape, array.shape, strict=True))
        for shape in shapes
    ):
        raise ValueError(f"{name}: got shape {array.shape}, expected {' or '.join(map(str, shapes))}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: got {array[~np.isfinite(array)].flat[0]}, expected finite numbers")
    return array


def closest_approach(pose: NDArray[np.float64]) -> tuple[int, int, int] | None:
    """Returns the tick of the closest approach and its two robots, None for a single robot."""
    best: tuple[float, int, int, int] | None = None
    for first in range(pose.shape[1] - 1):
        gap = np.hypot(*np.moveaxis(pose[:, first + 1 :, :2] - pose[:, first, None, :2], -1, 0))  # [P+1, robots after]
        tick, other = np.unravel_index(int(gap.argmin()), gap.shape)
        if best is None or gap[tick, other] < best[0]:
            best = float(gap[tick, other]), int(tick), first, first + 1 + int(other)
    return best[1:] if best else None


def travel_time(paths: Paths) -> float:
    """Returns when the last robot has come within 2 d_safe of its goal to stay, or the end where one never does."""
    away = np.linalg.norm(paths.pose[..., :2] - paths.goal, axis=-1).max(axis=1) > 2.0 * paths.d_safe  # [P+1]
    outside = np.flatnonzero(away)
    return float(paths.time[min(outside[-1] + 1, away.size - 1) if outside.size else 0])
