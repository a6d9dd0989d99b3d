"""The closed loop in JAX as one would first write it: a scan for one run, then vmap and jit."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from experiments.bench.baselines.work import DESIGN, MIN_DISTANCE, Work, reference_path

__all__ = ["evaluate"]


class _Lane(NamedTuple):
    """One run; under vmap each field has a leading axis of lanes."""

    design: dict[str, Array]
    deadline: Array
    lag: Array
    rest: Array
    seed: Array


class _Shared(NamedTuple):
    """What all runs read."""

    loop_times: Array  # [S, P, N]
    start: Array  # [S, N, 3]
    path: Array  # [S, P+1, 2]
    tau: Array
    goal: Array
    weights: Array


def evaluate(work: Work) -> np.ndarray:
    """AUC of each lane and robot, [L, N] float32."""
    lag, rest = work.change
    design = {name: jnp.asarray(getattr(work, name)) for name in DESIGN}
    lane = _Lane(design, *map(jnp.asarray, (work.deadline, lag, rest, work.seed)))
    arrays = map(jnp.asarray, (work.loop_times, work.start, reference_path(work)))
    scalars = (jnp.asarray(a, jnp.float32) for a in (work.tau, work.goal, work.weights))
    shared = _Shared(*arrays, *scalars)
    return np.asarray(_evaluate(lane, shared, depth=int(lag.max()) + 1, mid_tick=work.mid_tick))


@partial(jax.jit, static_argnames=("depth", "mid_tick"))
def _evaluate(lane: _Lane, shared: _Shared, depth: int, mid_tick: bool) -> Array:
    return jax.vmap(partial(_run, depth=depth, mid_tick=mid_tick), in_axes=(0, None))(lane, shared)


def _run(lane: _Lane, shared: _Shared, depth: int, mid_tick: bool) -> Array:
    """AUC of one run, [N]."""
    _, num_ticks, num_robots = shared.loop_times.shape
    pose = shared.start[lane.seed]

    def disagreement(pose: Array, reference: Array) -> Array:
        return jnp.sum(shared.weights[None] * (pose[:, :2] - reference[None]) ** 2, axis=1)

    def tick(carry: tuple, p: Array) -> tuple[tuple, None]:
        pose, command, born, sent, before, auc = carry
        sent = sent.at[p % depth].set(_control(lane, shared.goal, pose, (p - born) * shared.tau))
        pose = _arc(pose, command, lane.rest)
        loop = p - lane.lag
        done = (loop >= 0) & (shared.loop_times[lane.seed, loop] <= lane.deadline)
        command = jnp.where(done[:, None], sent[loop % depth], command)
        born = jnp.where(done, loop, born)
        if mid_tick:
            pose = _arc(pose, command, shared.tau - lane.rest)
        now = disagreement(pose, shared.path[lane.seed, p + 1])
        return (pose, command, born, sent, now, auc + 0.5 * shared.tau * (before + now)), None

    initial = disagreement(pose, shared.path[lane.seed, 0])
    still = jnp.zeros((num_robots, 2), pose.dtype)
    sent = jnp.zeros((depth, num_robots, 2), pose.dtype)  # ring of commands
    carry = (pose, still, jnp.zeros(num_robots, jnp.int32), sent, initial, jnp.zeros_like(initial))
    carry, _ = lax.scan(tick, carry, jnp.arange(num_ticks, dtype=jnp.int32))
    return carry[-1] / initial


def _control(lane: _Lane, goal: Array, pose: Array, age: Array) -> Array:
    """Commands [N, 2] from poses [N, 3] and ages [N] (model, section 3)."""
    design = lane.design
    gap = pose[:, None, :2] - pose[None, :, :2]  # [N, N, 2]
    distance = jnp.sqrt(jnp.maximum(jnp.sum(gap**2, axis=-1), MIN_DISTANCE**2))
    stale = jnp.maximum(jnp.maximum(age[:, None], age[None]) - lane.deadline, 0)
    effective = design["d_safe"] + design["c_miss"] * stale
    factor = design["eta"] * jnp.maximum(1 / distance - 1 / effective, 0) / distance**3
    v = -design["kappa"] * (pose[:, :2] - goal[None]) + jnp.sum(factor[..., None] * gap, axis=1)
    speed = jnp.sqrt(jnp.sum(v**2, axis=1))
    error = jnp.arctan2(v[:, 1], v[:, 0]) - pose[:, 2]
    error = (error + jnp.pi) % (2 * jnp.pi) - jnp.pi
    nu = jnp.minimum(speed * jnp.maximum(jnp.cos(error), 0), design["v_max"])
    omega = jnp.clip(design["gamma"] * error, -design["omega_max"], design["omega_max"])
    return jnp.stack([nu, omega], axis=1)


def _arc(pose: Array, command: Array, h: Array) -> Array:
    """Exact arc of length h (model, section 2)."""
    half_turn = 0.5 * command[:, 1] * h
    chord = command[:, 0] * h * jnp.sinc(half_turn / jnp.pi)
    middle = pose[:, 2] + half_turn
    return jnp.stack(
        [pose[:, 0] + chord * jnp.cos(middle), pose[:, 1] + chord * jnp.sin(middle), middle + half_turn], axis=1
    )
