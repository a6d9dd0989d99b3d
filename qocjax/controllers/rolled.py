"""Plans: the next commands of a law, worked out by letting it drive the robots' own model.

With x the predicted poses of all robots, f the robot's motion over a sampling period and a the age that the law sees,

    u_0 = law(x_0, a),   x_{k+1} = f(x_k, u_k),   u_{k+1} = law(x_{k+1}, a + (k + 1) τ):

command k is played only where k loops in a row were missed, and then what is known is older by k τ.
"""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax.controllers.interface import Controller, Sight, Task
from qocjax.robots import Command, Pose

__all__ = ["PlanMaker", "follow", "plan_of", "rolled"]

_At = tuple[Pose, Command | None, Command]  # poses, speeds and the command that follows

_UNROLLED = 16  # laws of one turn of the loop: faster, and compiled in bounded time


@runtime_checkable
class PlanMaker(Protocol):
    """A controller that makes plans in a way of its own, with its own prediction; any other is rolled."""

    def plan(self, task: Task, memory: Any, sight: Sight, length: int) -> tuple[Any, Command, Any]:
        """As `command`, but with the next commands, each field [M, N, *B]: from t_p + Delta on, one a period."""
        ...


def plan_of(controller: Controller, task: Task, memory: Any, sight: Sight, length: int) -> tuple[Any, Command, Any]:
    """What is remembered next, the commands of a packet, each field [M, N, *B], and what is to be recorded."""
    if isinstance(controller, PlanMaker):
        return controller.plan(task, memory, sight, length)
    return rolled(controller, task, memory, sight, length)


def rolled(controller: Controller, task: Task, memory: Any, sight: Sight, length: int) -> tuple[Any, Command, Any]:
    """The plan of a law that needs nothing but poses and ages: what it remembers is that of its first command.

    Args:
        controller: The law.
        task: What does not change.
        memory: The law's.
        sight: With the predicted poses in `begin`; without, the plan begins where the robots were sampled.
        length: M.
    """
    pose, speed = (sight.pose, sight.speed) if sight.begin is None else sight.begin
    sight = sight._replace(pose=pose, speed=speed)
    memory, first, view = lax.optimization_barrier(controller.command(task, memory, sight))
    tau = jnp.asarray(task.design.tau)

    if length == 1:
        return memory, jax.tree.map(lambda a: a[None], first), view

    # Each step is computed once, however often it is read.
    def step(at: _At, k: Array) -> tuple[_At, Command]:
        pose, speed = lax.optimization_barrier(follow(task, *at, tau))
        seen = sight._replace(pose=pose, speed=speed, age=sight.age + k * tau)
        command = lax.optimization_barrier(controller.command(task, memory, seen)[1])
        return (pose, speed, command), command

    steps = jnp.arange(1, length).astype(sight.age.dtype)
    _, later = lax.scan(step, (pose, speed, first), steps, unroll=min(length - 1, _UNROLLED))
    return memory, jax.tree.map(lambda a, rest: jnp.concatenate([a[None], rest]), first, later), view


def follow(
    task: Task, pose: Pose, speed: Command | None, command: Command, duration: Array
) -> tuple[Pose, Command | None]:
    """Pose and speed after a constant command; the speed is None where it is not kept, of robots that obey at once."""
    last = task.robot.move(pose, speed, command, duration, task.math)[-1]
    return last.pose, None if speed is None else last.speed
