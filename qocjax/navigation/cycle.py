"""One cycle of one robot: costmap, path, start of the rollouts, command."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax.navigation.costmap import Layers, Obstacles, StaticLayer, costmap_layers
from qocjax.navigation.critics import COLLISION
from qocjax.navigation.local_path import MapCosts
from qocjax.navigation.mppi import Limits, Rollouts, State, step
from qocjax.navigation.patches import patched
from qocjax.navigation.planner import plan
from qocjax.navigation.stack_parts import StackParts
from qocjax.navigation.varied import varied
from qocjax.robots import Command

__all__ = ["Robot", "View", "cycle", "look"]


class Robot(NamedTuple):
    """What a cycle starts from."""

    words: Array  # [2] of the random key of this cycle
    state: State  # of the local controller
    path: Array  # [L, 2] the last global path (m)
    has_path: Array  # [] whether one was ever found
    begin: Array  # [3] where rollouts and paths begin: the pose sampled, or predicted (m, m, rad)
    speed: Command  # at which the robot drives there, each field []
    obstacles: Obstacles  # [M] the other robots
    goal: Array  # [2] m
    limits: Limits
    values: dict[str, Array]  # what the design varies of the stack, each []


class View(NamedTuple):
    """What a cycle had before it, for records and figures."""

    words: Array  # [2] of the random key
    state: State  # of the local controller before the cycle
    path: Array  # [L, 2] followed (m)
    has_path: Array  # [] whether one was ever found
    found: Array  # [] whether a plan of this cycle found one
    blocked: Array  # [] whether every rollout collided
    begin: Array  # [3] where the rollouts begin (m, m, rad)
    speed: Command  # at which the robot drives there, each field []
    obstacles: Obstacles  # [M]
    goal: Array  # [2] m
    limits: Limits
    values: dict[str, Array]  # what the design varies of the stack, each []


def cycle(stack: StackParts, robot: Robot, planning: Array, length: int | None = None) -> tuple[Command, State, View]:
    """Makes the costmap, plans if it is time, and computes the command.

    Args:
        stack: Parameters.
        robot: What is known.
        planning: Whether a new global plan is due.
        length: How many commands are asked for, each a period after the one before; None for one, of shape [].

    Returns:
        The command, or the commands [M], the state of the local controller for the next cycle, and what the cycle
        looked at.
    """
    stack = varied(stack, robot.values)
    dtype, begin = robot.begin.dtype, robot.begin
    cost = _cost(stack, robot.obstacles, dtype)
    path, found = _path(stack, robot, cost, planning)
    has_path = robot.has_path | (planning & found)
    command, state, rollouts = _step(
        stack, robot.words, robot.state, begin, robot.speed, cost, path, robot.goal, robot.limits
    )
    fastest = jnp.asarray(robot.limits.vx_max)
    back = jnp.clip(_back_up(stack, begin, cost), -fastest, fastest)
    stop = jax.tree.map(jnp.zeros_like, command)
    command = jax.tree.map(
        lambda own, backing: jnp.where(rollouts.blocked, backing, own), command, replace(stop, nu=back)
    )
    there = jnp.hypot(begin[0] - robot.goal[0], begin[1] - robot.goal[1]) <= stack.xy_goal_tolerance
    going = has_path & ~there
    still = jax.tree.map(jnp.zeros_like, state)
    state = jax.tree.map(lambda new, none: jnp.where(going, new, none), state, still)
    command = jax.tree.map(lambda own, none: jnp.where(going, own, none), command, stop)
    view = View(
        robot.words, robot.state, path, has_path, found, going & rollouts.blocked, begin, robot.speed,
        robot.obstacles, robot.goal, robot.limits, robot.values,
    )  # fmt: skip
    return (command if length is None else _sequence(stack, robot, command, state, rollouts, length)), state, view


def _sequence(
    stack: StackParts, robot: Robot, command: Command, state: State, rollouts: Rollouts, length: int
) -> Command:
    """The command and those after it, [M]: the local controller's sequence, linear between its steps.

    After a recovery, of which no more than its first command was looked at, the robot stands.
    """
    steps = jnp.arange(1, length) * (jnp.asarray(robot.limits.period) / stack.mppi.model_dt)
    places = jnp.arange(stack.mppi.time_steps, dtype=state.vx.dtype)

    def after(first: Array, sequence: Array) -> Array:
        later = jnp.interp(steps.astype(sequence.dtype), places, sequence)
        return jnp.concatenate([first[None], jnp.where(rollouts.blocked, 0.0, later)])

    return jax.tree.map(after, command, state.sequence)


def look(stack: StackParts, view: View) -> tuple[Layers, Rollouts]:
    """The costmap of a cycle and its rollouts, with their points."""
    stack, dtype = varied(stack, view.values), view.begin.dtype
    layers = _layers(stack, view.obstacles, dtype)
    cost = layers.total().astype(jnp.uint8)
    _, _, rollouts = _step(
        stack, view.words, view.state, view.begin, view.speed, cost, view.path, view.goal, view.limits, record=True
    )
    return layers, rollouts


def _cost(stack: StackParts, obstacles: Obstacles, dtype: jnp.dtype) -> Array:
    """The sum of the layers, in bytes: patches around the other robots where they are smaller than the map."""
    grid, reach = stack.static_map.grid, stack.influence
    discs = obstacles.x.shape[-1]
    if reach is None or discs * (2 * reach + 1) ** 2 >= math.prod(grid.shape):
        return _layers(stack, obstacles, dtype).total().astype(jnp.uint8)
    alone, cost = (jnp.asarray(each, jnp.uint8) for each in (stack.closed, stack.static.cost))
    static = StaticLayer(cost, jnp.asarray(stack.static.distance, dtype))
    return patched(alone, grid, static, obstacles, stack.inflation, reach)


def _static(stack: StackParts, dtype: jnp.dtype) -> StaticLayer:
    return StaticLayer(*(jnp.asarray(each, dtype) for each in stack.static))


def _layers(stack: StackParts, obstacles: Obstacles, dtype: jnp.dtype) -> Layers:
    return costmap_layers(stack.static_map.grid, _static(stack, dtype), obstacles, stack.inflation)


def _path(stack: StackParts, robot: Robot, cost: Array, planning: Array) -> tuple[Array, Array]:
    """A new path where one is due and there is one, else the last."""

    def planned() -> tuple[Array, Array]:
        new = plan(cost, robot.begin[:2], robot.goal, stack.static_map.grid, stack.planner)
        return jnp.where(new.reached, new.points.astype(robot.path.dtype), robot.path), new.reached

    return lax.cond(planning, planned, lambda: (robot.path, jnp.array(False)))


def _back_up(stack: StackParts, pose: Array, cost: Array) -> Array:
    """Speed of the recovery: straight back, ahead only where the end behind is closed, 0 where both are (m/s).

    Back also where ahead is cheaper: what blocks lies ahead, and other robots lie where they were an age ago, so that
    a cost says little of which side is the freer one.
    """
    grid, ways = stack.static_map.grid, jnp.array([-1.0, 1.0], pose.dtype)
    x = pose[0] + ways * stack.backup_dist * jnp.cos(pose[2])
    y = pose[1] + ways * stack.backup_dist * jnp.sin(pose[2])
    ends = MapCosts(cost, grid.resolution, grid.origin).at(x, y)
    behind, ahead = ends < COLLISION
    return jnp.where(behind, ways[0], jnp.where(ahead, ways[1], 0.0)) * stack.backup_speed


def _step(
    stack: StackParts,
    words: Array,
    state: State,
    begin: Array,
    speed: Command,
    cost: Array,
    path: Array,
    goal: Array,
    limits: Limits,
    record: bool = False,
) -> tuple[Command, State, Rollouts]:
    grid = stack.static_map.grid
    costs = MapCosts(cost, grid.resolution, grid.origin)
    place = jnp.append(goal, jnp.zeros_like(goal[:1]))
    key = jax.random.wrap_key_data(words)
    return step(stack.mppi, state, begin, costs, path, place, key, record, limits, speed)
