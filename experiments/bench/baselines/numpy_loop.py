"""The closed loop in NumPy: a Python loop over ticks, arrays over lanes and robots."""

from __future__ import annotations

import numpy as np

from experiments.bench.baselines.work import MIN_DISTANCE, Work, reference_path

__all__ = ["evaluate"]


def evaluate(work: Work) -> np.ndarray:
    """AUC of each lane and robot, [L, N] float32."""
    lanes = np.arange(work.num_lanes)
    lag, rest = work.change
    depth = int(lag.max()) + 1
    sent = np.zeros((depth, work.num_lanes, work.num_robots, 2), np.float32)  # ring of commands
    pose = np.array(work.start[work.seed])  # [L, N, 3]
    command = np.zeros_like(sent[0])
    born = np.zeros_like(pose[..., 0])  # tick of the command in force
    path = reference_path(work)
    initial = before = _disagreement(work, pose, path, 0)
    auc = np.zeros_like(initial)
    for p in range(work.num_ticks):
        sent[p % depth] = _control(work, pose, (p - born) * np.float32(work.tau))
        pose = _arc(pose, command, rest)
        loop = p - lag
        on_time = work.loop_times[work.seed, loop] <= work.deadline[:, None]
        done = on_time & (loop >= 0)[:, None]
        command = np.where(done[..., None], sent[loop % depth, lanes], command)
        born = np.where(done, loop[:, None].astype(np.float32), born)
        if work.mid_tick:
            pose = _arc(pose, command, np.float32(work.tau) - rest)
        now = _disagreement(work, pose, path, p + 1)
        auc += 0.5 * work.tau * (before + now)
        before = now
    return auc / initial


def _control(work: Work, pose: np.ndarray, age: np.ndarray) -> np.ndarray:
    """Commands [L, N, 2] from poses and ages (model, section 3)."""
    position, heading = pose[..., :2], pose[..., 2]
    v = -_per_lane(work.kappa, 3) * (position - np.asarray(work.goal, np.float32)) + _repulsion(work, position, age)
    speed = np.hypot(v[..., 0], v[..., 1])
    error = np.arctan2(v[..., 1], v[..., 0]) - heading
    error = (error + np.float32(np.pi)) % np.float32(2 * np.pi) - np.float32(np.pi)
    nu = np.minimum(speed * np.maximum(np.cos(error), 0), _per_lane(work.v_max, 2))
    cap = _per_lane(work.omega_max, 2)
    return np.stack([nu, np.clip(_per_lane(work.gamma, 2) * error, -cap, cap)], axis=-1)


def _repulsion(work: Work, position: np.ndarray, age: np.ndarray) -> np.ndarray:
    """Sum of v_ij over the other robots, [L, N, 2]."""
    gap = position[:, :, None] - position[:, None]  # [L, N, N, 2]
    distance = np.maximum(np.hypot(gap[..., 0], gap[..., 1]), np.float32(MIN_DISTANCE))
    stale = np.maximum(age[:, :, None], age[:, None]) - _per_lane(work.deadline, 3)
    effective = _per_lane(work.d_safe, 3) + _per_lane(work.c_miss, 3) * np.maximum(stale, 0)
    factor = _per_lane(work.eta, 3) * np.maximum(1 / distance - 1 / effective, 0) / distance**3
    return (factor[..., None] * gap).sum(axis=2)  # a robot's gap to itself is 0


def _arc(pose: np.ndarray, command: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Exact arc of length h [L] (model, section 2)."""
    nu, omega = command[..., 0], command[..., 1]
    half_turn = 0.5 * omega * h[:, None]
    chord = nu * h[:, None] * np.sinc(half_turn / np.float32(np.pi))
    middle = pose[..., 2] + half_turn
    return np.stack(
        [pose[..., 0] + chord * np.cos(middle), pose[..., 1] + chord * np.sin(middle), middle + half_turn], axis=-1
    )


def _disagreement(work: Work, pose: np.ndarray, path: np.ndarray, tick: int) -> np.ndarray:
    """|delta|²_W at a tick, [L, N]."""
    delta = pose[..., :2] - path[work.seed, tick][:, None]
    return (np.asarray(work.weights, np.float32) * delta**2).sum(axis=-1)


def _per_lane(a: np.ndarray, ndim: int) -> np.ndarray:
    return a.reshape((-1,) + (1,) * (ndim - 1))
