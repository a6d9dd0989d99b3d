"""The edge's law: a controller of qocjax, told one state at a time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from experiments.dds_testbed.messages import State
from experiments.dds_testbed.plan import Plan
from qocjax._math import EXACT
from qocjax.controllers import Apf, Controller, Sight, Task, apf
from qocjax.navigation.gather import Memory
from qocjax.navigation.stack import NavigationStack
from qocjax.robots import Command, pose_from

__all__ = ["Law", "law_of"]

Law = Callable[[int, State], tuple[float, float]]  # speeds of a robot, from the state that it has sent


def law_of(plan: Plan, controller: Controller, key: int = 0) -> Law:
    """The controller as a function, compiled.

    Args:
        plan: Of the run.
        controller: The surrogate law or the navigation stack.
        key: Root of the stack's random numbers.
    """
    if isinstance(controller, Apf):
        return _surrogate(plan)
    if isinstance(controller, NavigationStack):
        return _Stack(plan, controller, key)
    raise TypeError(f"controller: got a {type(controller).__name__}, expected an Apf or a NavigationStack")


def _surrogate(plan: Plan) -> Law:
    goal = jnp.broadcast_to(jnp.asarray(plan.goal), (plan.num_robots, 2))

    @jax.jit
    def compiled(poses: Array, ages: Array) -> Array:
        command = apf(pose_from(poses.reshape(-1, 3)), ages, (goal[:, 0], goal[:, 1]), plan.as_design(), EXACT)
        return jnp.stack([command.nu, command.omega])

    def law(robot: int, state: State) -> tuple[float, float]:
        nu, omega = np.asarray(compiled(np.asarray(state.poses), np.asarray(state.ages)))[:, robot].tolist()
        return nu, omega

    return law


class _Stack:
    """The navigation stack, robot by robot: each state that comes is a cycle of its sender's.

    Where states were lost, robots are taken to have stood where they are now. Loops before and after the run leave
    nothing behind.
    """

    def __init__(self, plan: Plan, stack: NavigationStack, key: int) -> None:
        design = jax.tree.map(lambda value: jnp.asarray(value, jnp.float32), plan.as_design())
        goal = jnp.broadcast_to(jnp.asarray(plan.goal, jnp.float32), (plan.num_robots, 2))
        none = jnp.zeros((), jnp.int32), jnp.zeros((), jnp.float32)  # of the deadline, which predictions alone read
        task = Task((goal[:, 0], goal[:, 1]), design, EXACT, plan.num_ticks, *none, 0)
        start, words = pose_from(jnp.asarray(plan.start, jnp.float32)), jax.random.key_data(jax.random.key(key))
        self._memory, self._newest = stack.begin(task, start, words), -1
        self._last, self._ticks = [-1] * plan.num_robots, plan.num_ticks
        self._compiled = jax.jit(partial(_cycle, stack, task))

    def __call__(self, robot: int, state: State) -> tuple[float, float]:
        tick, speeds = state.sequence, np.zeros((2, len(self._last)), np.float32)
        speeds[:, robot] = state.speeds
        at = min(max(tick, 0), self._ticks - 1)
        known = np.asarray(state.poses, np.float32).reshape(-1, 3), np.asarray(state.ages, np.float32), speeds
        memory, speed = self._compiled(self._memory, self._newest, at, robot, *known)
        if self._last[robot] < tick < self._ticks:
            self._memory, self._last[robot], self._newest = memory, tick, max(tick, self._newest)
        nu, omega = np.asarray(speed).tolist()
        return nu, omega


def _cycle(
    stack: NavigationStack,
    task: Task,
    memory: Memory,
    newest: Array,
    tick: Array,
    robot: Array,
    poses: Array,
    ages: Array,
    speeds: Array,
) -> tuple[Memory, Array]:
    """A cycle of one robot at `tick`, `newest` being the last that any had: what is remembered, and its speeds [2]."""
    rows = jnp.arange(task.ticks)[:, None, None]
    memory = memory._replace(seen=jnp.where((rows > newest) & (rows < tick), poses[:, :2], memory.seen))
    sight = Sight(tick, pose_from(poses), ages, Command(speeds[0], speeds[1]))
    after, command, _ = stack.command(task, memory, sight)
    parts = (memory.state, memory.path, memory.has_path, memory.failed, memory.blocked)
    new = (after.state, after.path, after.has_path, after.failed, after.blocked)
    state, path, has_path, failed, blocked = jax.tree.map(lambda old, now: old.at[robot].set(now[robot]), parts, new)
    speed = jnp.stack([command.nu[robot], command.omega[robot]])
    sent = memory.sent.at[tick, robot].set(speed)
    return Memory(memory.keys, state, path, has_path, after.seen, sent, after.plans, failed, blocked), speed
