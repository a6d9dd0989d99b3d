"""Poses of several robots on common instants as quality of control: the same AUC as of a simulated run."""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array as JaxArray
from numpy.typing import NDArray

from qocjax.quality import initial_norm
from qocjax.recorded.findings import Findings
from qocjax.reference import reference_origin, reference_path
from qocjax.scenario import Design, Scenario

__all__ = ["Quality", "Yardstick", "judge", "path_length"]

Array = NDArray[np.float64]

_BLOCK = 100_000  # instants that are looked at together


@dataclass(frozen=True)
class Yardstick:
    """What a recorded run is judged by; lengths in m, times in s."""

    goal: tuple[float, ...] | str | None = None  # (x, y), `end` for where the robots end, None for the recording's own
    starts: dict[str, tuple[float, ...]] | None = None  # pose at which a robot's odometry begins, by robot
    begin: str | float = "first"  # `first` pose of all, `motion`, `command`, or seconds after the first pose of all
    horizon: float | None = None  # s; None for as long as the recording goes
    end: float = 1.0  # s, over which the last positions are averaged for the goal
    reference: str = "nominal"  # `nominal` or `uncapped`
    kappa: float = 2.0  # 1/s
    v_max: float = 0.7  # m/s
    per_robot: bool | None = None  # a reference for each robot; None for one for the group where robots share a frame
    normaliser: str | None = None  # None for `initial_disagreement`, and `goal_distance` with a reference per robot
    weights: tuple[float, float] = (1.0, 1.0)
    d_safe: float = 0.5
    robot_radius: float = 0.105
    path_resolution: float = 0.01  # m; smaller moves than that are noise, and no path


@dataclass(frozen=True)
class Quality:
    """What the poses of a run say; N robots, K instants (those of all robots' poses)."""

    robots: tuple[str, ...]
    time: Array  # [K] s since the begin
    pose: Array  # [K, N, 3] m, m, rad
    reference: Array  # [K, 2] or [K, N, 2] m; NaN without a goal
    goal: Array  # [2] or [N, 2] m; NaN where there is none
    auc: Array  # [N] s; NaN without a goal, and for a robot that starts where the normaliser is 0, which a remark says
    min_distance: float  # m; inf for one robot, NaN where robots share no frame
    collided: bool | None
    path_length: Array  # [N] m
    arrival_time: Array  # [N] s since the begin; inf if never, NaN without a goal
    began: float  # s after the recording's first message
    duration: float  # s
    d_safe: float = 0.5
    robot_radius: float = 0.105
    deadline: float | None = None  # none is known; for figures


def judge(
    robots: tuple[str, ...],
    time: Array,
    pose: Array,
    begin: float,
    yardstick: Yardstick,
    shared: bool,
    goal: Array | None,
    path_length: Array,
    findings: Findings,
) -> Quality:
    """Judges poses [K, N, 3] at times [K] (s since the begin).

    Args:
        robots: Their names.
        time: Increasing, from 0.
        pose: With continuous headings.
        begin: When the run began (s after the recording's first message), for the record.
        yardstick: Goal, reference and normaliser.
        shared: Whether the robots' positions are in one frame.
        goal: [2], or [N, 2] m for one a robot; None where there is none.
        path_length: [N] m, of each robot.
        findings: Takes remarks.

    Raises:
        ValueError: A value of the yardstick is out of range.
    """
    apart = _closest(pose) if shared else float("nan")
    auc, arrival = np.full(len(robots), np.nan), np.full(len(robots), np.nan)
    reference = np.full((time.size, 2), np.nan)
    if goal is not None:
        auc, reference = _judged(robots, time, pose, yardstick, shared, goal, findings)
        away = np.linalg.norm(pose[..., :2] - np.broadcast_to(goal, pose[0, :, :2].shape), axis=-1)
        arrival = np.array([_arrival(time, away[:, k] > 2.0 * yardstick.d_safe) for k in range(len(robots))])
    return Quality(
        robots, time, pose, reference, np.full(2, np.nan) if goal is None else goal, auc, apart,
        bool(apart < 2.0 * yardstick.robot_radius) if shared else None, path_length, arrival,
        begin, float(time[-1]), yardstick.d_safe, yardstick.robot_radius,
    )  # fmt: skip


def _judged(
    robots: tuple[str, ...], time: Array, pose: Array, yardstick: Yardstick, shared: bool, goal: Array,
    findings: Findings,
) -> tuple[Array, Array]:  # fmt: skip
    """AUC [N] and reference [K, 2] or [K, N, 2]."""
    per_robot = yardstick.per_robot if yardstick.per_robot is not None else not shared or goal.ndim == 2
    normaliser = yardstick.normaliser or ("goal_distance" if per_robot or len(robots) == 1 else "initial_disagreement")
    scenario = Scenario(
        start=pose[0], goal=goal, horizon=float(time[-1]), reference=yardstick.reference, nominal_kappa=yardstick.kappa,
        nominal_v_max=yardstick.v_max, reference_per_robot=per_robot, normaliser=normaliser,
        weights=np.asarray(yardstick.weights), start_jitter=(0.0, 0.0), robot_radius=yardstick.robot_radius,
    )  # fmt: skip
    every = _reference(scenario, time)
    auc, undefined = _auc(scenario, time, pose, every, max(yardstick.path_resolution, 1e-9))
    for robot in np.flatnonzero(undefined):
        findings.note(f"{robots[robot]}: has no AUC, as its {normaliser} begins below {yardstick.path_resolution:g} m")
    return auc, every if per_robot else every[:, 0]


def _reference(scenario: Scenario, time: Array) -> Array:
    """[K, 1 or N, 2], a block of instants after the other."""
    start = jnp.asarray(np.asarray(scenario.start, np.float64)[..., None])
    goal = jnp.asarray(np.broadcast_to(np.asarray(scenario.goal), (scenario.num_robots, 2))[..., None])
    found = []
    for first in range(0, time.size, _BLOCK):
        block = np.full(min(_BLOCK, time.size), time[-1])  # of one size, so that one program serves all
        block[: time[first : first + _BLOCK].size] = time[first : first + _BLOCK]
        x, y = reference_path(jnp.asarray(block), start, goal, scenario, Design())
        found.append(np.stack([np.asarray(x)[..., 0], np.asarray(y)[..., 0]], axis=-1))
    return np.concatenate(found)[: time.size].astype(float)


def _auc(
    scenario: Scenario, time: Array, pose: Array, reference: Array, least: float
) -> tuple[Array, NDArray[np.bool_]]:
    """J_i, the disagreement joined by straight lines: over a piece from a to b its square means (a² + ab + b²) / 3.

    Undefined, and NaN, for a robot whose normaliser is that of a distance below `least` (m).
    """
    start: JaxArray = jnp.asarray(np.asarray(scenario.start, np.float64)[..., None])
    goal = jnp.asarray(np.broadcast_to(np.asarray(scenario.goal), (scenario.num_robots, 2))[..., None])
    origin = reference_origin(start, scenario.reference_per_robot)
    norm = np.asarray(initial_norm(scenario, start, goal, origin), float)[:, 0]
    undefined = norm < least**2 * float(np.min(np.asarray(scenario.weights)))
    delta = pose[..., :2] - reference
    a, b = delta[:-1], delta[1:]
    mean = (a * a + a * b + b * b) @ np.asarray(scenario.weights) / 3.0
    return np.diff(time) @ mean / np.where(undefined, np.nan, norm), undefined


def _closest(pose: Array) -> float:
    """Smallest distance between two robots at the instants."""
    robots = range(pose.shape[1])
    pairs = [(i, j) for i in robots for j in robots if i < j]
    return min((float(np.hypot(*(pose[:, i, :2] - pose[:, j, :2]).T).min()) for i, j in pairs), default=float("inf"))


def path_length(points: Array, resolution: float) -> float:
    """Length of the polygon through points at least `resolution` apart, to the last point."""
    length, (x, y) = 0.0, points[0].tolist()
    for next_x, next_y in points[1:].tolist():
        step = math.hypot(next_x - x, next_y - y)
        if step >= resolution:
            length, x, y = length + step, next_x, next_y
    return length + math.hypot(points[-1, 0] - x, points[-1, 1] - y)


def _arrival(time: Array, away: NDArray[np.bool_]) -> float:
    """From when on a robot stays within 2 d_safe of its goal."""
    outside = np.flatnonzero(away)
    if not outside.size:
        return 0.0
    return float(time[outside[-1] + 1]) if outside[-1] + 1 < time.size else float("inf")
