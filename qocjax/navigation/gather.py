"""What each robot's cycle starts from: its pose, and the other robots as they are known."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from qocjax.controllers.interface import Sight, Task
from qocjax.navigation.costmap import Obstacles, others
from qocjax.navigation.cycle import Robot
from qocjax.navigation.mppi import Limits, State, predict_driven
from qocjax.navigation.stack_parts import StackParts
from qocjax.robots import Command

__all__ = ["Memory", "gather"]


class Memory(NamedTuple):
    """What the stack remembers of a batch of runs."""

    keys: Array  # [N, *B, 2] words of each robot's random key
    state: State  # of the local controllers, leaves [N, *B, ...]
    path: Array  # [N, *B, L, 2] global paths (m)
    has_path: Array  # [N, *B] whether one was ever found
    seen: Array  # [P, N, *B, 2] positions at the sampling instants (m)
    sent: Array  # [slots + P, N, *B, 2 or 3] fields of the commands computed; the first `slots` are zero
    plans: Array  # [] plans made so far
    failed: Array  # [N, *B] of them, how many found no path
    blocked: Array  # [N, *B] cycles in which every rollout collided


def gather(stack: StackParts, task: Task, memory: Memory, sight: Sight) -> Robot:
    """What is known at a sampling instant, as each robot's cycle wants it; leaves [N, *B, ...]."""
    pose, shape = sight.pose, sight.pose.x.shape
    spread = lambda value: jnp.broadcast_to(jnp.asarray(value, pose.x.dtype), shape)  # noqa: E731
    sampled = jnp.stack([pose.x, pose.y, pose.heading])
    assert sight.speed is not None  # as it sees speeds; for the type checker
    begin, speed = _predicted(task, memory, sight) if stack.predict else (sampled, sight.speed)
    design = task.design
    keys = jax.vmap(lambda words: jax.random.fold_in(jax.random.wrap_key_data(words), sight.tick))
    words = jax.random.key_data(keys(memory.keys.reshape(-1, memory.keys.shape[-1]))).reshape(memory.keys.shape)
    return Robot(
        words,
        memory.state,
        memory.path,
        memory.has_path,
        jnp.moveaxis(begin, 0, -1),
        jax.tree.map(spread, speed),
        _obstacles(stack, task, memory, sight, begin),
        jnp.stack([spread(each) for each in task.goal], axis=-1),
        Limits(spread(design.v_max), spread(design.omega_max), spread(design.tau)),
        {name: spread(value) for name, value in design.others.items()},
    )


def _obstacles(stack: StackParts, task: Task, memory: Memory, sight: Sight, begin: Array) -> Obstacles:
    """The other robots, and how far each may be from where it is taken to be.

    A robot is where it was when the command that it now applies was sampled, its age ago, and may have moved since at
    the speed that it was told then (before its first command takes effect, that of the first one computed). With
    predictions it is where its own commands under way lead it. What is left
    unknown is then the age beyond the deadline, which missed loops leave, and the sampling period in which a new
    command moves it on.
    """
    tau, shape = jnp.asarray(task.design.tau), begin.shape[1:]
    age = jnp.broadcast_to(sight.age, shape)
    source = jnp.clip(sight.tick - jnp.round(age / tau).astype(jnp.int32), 0, sight.tick)
    sent = _at(memory.sent, source + task.slots)
    speed = jnp.hypot(sent[..., 0], sent[..., 2]) if task.robot.holonomic else jnp.abs(sent[..., 0])
    if stack.predict:
        x, y, unknown = begin[0], begin[1], jnp.maximum(age - task.design.deadline, 0.0) + tau
    else:
        known = _at(memory.seen, source)
        x, y, unknown = known[..., 0], known[..., 1], age
    widest = task.design.others.get("controller.max_widening", stack.max_widening)
    moved = jnp.minimum(speed * unknown, widest)
    x, y, moved = (others(each) for each in (x, y, moved))
    radius = float(np.asarray(stack.inflation.robot_radius))
    return Obstacles(x, y, jnp.ones_like(x), moved, jnp.full_like(x, radius))


def _predicted(task: Task, memory: Memory, sight: Sight) -> tuple[Array, Command]:
    """Poses [3, N, *B] and speeds when the commands of this instant take effect, if no loop is missed until then."""
    assert sight.speed is not None  # for the type checker
    sampled = jnp.stack([sight.pose.x, sight.pose.y, sight.pose.heading])
    under_way = lax.dynamic_slice_in_dim(memory.sent, sight.tick, task.slots)
    ago = task.slots - jnp.arange(task.slots)  # sampling periods
    # Each is in force for one period; between sampling instants, the oldest one for what is left of it.
    durations = jnp.where(ago <= task.lag, task.design.tau, jnp.where(ago == task.lag + 1, task.rest, 0.0))
    commands, durations = Command(*jnp.moveaxis(under_way, -1, 0)), durations.astype(sampled.dtype)
    begin, speed = predict_driven(task.robot, sampled, sight.speed, commands, durations)
    if task.slots == 0 or task.robot.remembers:
        return begin, speed
    # The command computed last is in force then, unless this one takes effect at once.
    at_once = task.lag + task.rest <= 0
    return begin, jax.tree.map(lambda sent, now: jnp.where(at_once, now, sent), speed, sight.speed)


def _at(rows: Array, index: Array) -> Array:
    """Row `index[n, ...]` of [P, N, *B, C] for each robot and run: [N, *B, C]."""
    return jnp.take_along_axis(rows, index[None, ..., None], axis=0, mode="promise_in_bounds")[0]
