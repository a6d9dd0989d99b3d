"""The navigation stack as a controller of the closed loop (model, section 9; the paper's experimental controller).

At each sampling instant every robot has its costmap made of the shared map and of the other robots where they were last
known, follows its global path, planned anew at a rate of its own, and draws, rolls out and averages its next command.
So everything that runs on the surrogate law runs on it. Of a design it reads v_max, omega_max, tau and the deadline.

Layout: what is remembered has the axes [N, *B] of the loop. One cycle of one robot is written once, in
`qocjax.navigation.cycle`, and is taken over all robots of all runs; `qocjax.navigation.gather` says what it starts
from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from qocjax import _checks
from qocjax.controllers.interface import Sight, Task
from qocjax.controllers.law import check_unread
from qocjax.navigation._batches import mapped
from qocjax.navigation.costmap import check_free
from qocjax.navigation.cycle import View, cycle
from qocjax.navigation.gather import Memory, gather
from qocjax.navigation.grid import Grid
from qocjax.navigation.maps import StaticMap, map_of_shapes
from qocjax.navigation.mppi import initial_state
from qocjax.navigation.stack_parts import StackParts
from qocjax.navigation.varied import value_at
from qocjax.network.schedule import Rules
from qocjax.robots import Command, Pose, Robot
from qocjax.scenario import Design, Scenario
from qocjax.tunables import NAVIGATION

__all__ = ["NavigationStack", "open_floor"]


@dataclass(frozen=True)
class NavigationStack(StackParts):
    """The parts at work: a cycle of every robot at each sampling instant."""

    costly = True
    sees_speed = True
    tunables = NAVIGATION
    smooth = False
    unread = ("eta", "kappa", "gamma", "c_miss", "d_safe")

    def check(self, scenario: Scenario, designs: Design, rules: Rules) -> None:
        """Checks designs, starts and goals against the stack and its map.

        Raises:
            ValueError: The rollouts' motion model is not the robot's; a design varies what the stack does not read, or
                turns faster than it can; a start or goal is in a closed cell; robots start in collision; predictions
                for another actuation than `deadline`; plans without predictions, or longer than the horizon of MPPI.
        """
        for name in designs.others:
            try:
                value_at(self, name)
            except AttributeError as error:
                raise ValueError(f"{name}: {error}") from None
        check_unread(self.unread, designs, "the navigation stack")
        _check_model(self.mppi.motion_model, scenario.robot)
        if _checks.is_concrete(designs.omega_max):
            fastest = float(np.max(np.asarray(designs.omega_max)))
            if fastest > self.mppi.wz_max * (1 + 1e-6):
                raise ValueError(
                    f"omega_max: got {fastest:g}, expected at most the stack's wz_max {self.mppi.wz_max:g}"
                )
        if self.predict and rules.actuation != "deadline":
            raise ValueError(f"actuation: got {rules.actuation!r} with predict=True, expected 'deadline'")
        if rules.plan_length is not None:
            self._check_plan(rules, rules.plan_length, designs)
        radius, own = (float(np.asarray(of.robot_radius)) for of in (scenario, self.inflation))
        if abs(radius - own) > 1e-6:
            raise ValueError(f"robot_radius: got {radius:g} m with an inflation for {own:g} m, expected one radius")
        goals = np.broadcast_to(np.asarray(scenario.goal), (scenario.num_robots, 2))
        check_free("goal", goals, self.static_map.grid, self.closed)
        self._check_places("start", scenario, np.asarray(scenario.start, np.float64)[:, :2])

    def _check_plan(self, rules: Rules, length: int, designs: Design) -> None:
        if not self.predict and rules.actuation == "deadline":
            raise ValueError("predict: got False with hold 'buffer', expected True (controller.predict=true): a plan "
                             "begins where the robot will be")  # fmt: skip
        ahead = self.mppi.time_steps * self.mppi.model_dt
        if _checks.is_concrete(designs.tau) and length * float(np.max(np.asarray(designs.tau))) > ahead * (1 + 1e-6):
            tau = float(np.max(np.asarray(designs.tau)))
            raise ValueError(f"plan_length: got {length}, expected at most {int(ahead / tau * (1 + 1e-6))}, the "
                             f"{ahead:g} s that MPPI looks ahead at a period of {tau:g} s")  # fmt: skip

    def check_start(self, scenario: Scenario, start: np.ndarray, seeds: np.ndarray) -> None:
        """Checks the jittered starts.

        Raises:
            ValueError: One is in a closed cell, or two are in collision; the message names the seed.
        """
        for seed, places in zip(seeds, np.moveaxis(np.asarray(start)[:, :2], -1, 0), strict=True):
            self._check_places(f"start of seed {seed}", scenario, places)

    def _check_places(self, name: str, scenario: Scenario, places: np.ndarray) -> None:
        check_free(name, places, self.static_map.grid, self.closed)
        apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)) + np.diag([np.inf] * len(places))
        i, j = np.unravel_index(np.argmin(apart), apart.shape)
        least = 2 * float(np.asarray(scenario.robot_radius))
        if apart[i, j] < least:
            raise ValueError(
                f"{name}: got robots {i} and {j} at a distance of {apart[i, j]:.3g} m, which is a collision, "
                f"expected at least two robot radii ({least:g} m)"
            )

    def begin(self, task: Task, pose: Pose, keys: Array | None) -> Memory:
        """Robots at rest, on a straight path to their goals."""
        shape, dtype = pose.x.shape, pose.x.dtype
        words = jax.random.key_data(jax.random.key(0)) if keys is None else keys
        size = words.shape[-1]
        words = jnp.broadcast_to(words, (*shape[1:], size)).reshape(-1, size)
        robots = jnp.arange(shape[0], dtype=jnp.uint32)
        split = jax.vmap(lambda run: jax.vmap(lambda i: jax.random.fold_in(jax.random.wrap_key_data(run), i))(robots))
        own = jnp.moveaxis(jax.random.key_data(split(words)), 0, 1).reshape(*shape, size)
        state = jax.tree.map(lambda a: jnp.broadcast_to(a, (*shape, *a.shape)), initial_state(self.mppi, dtype))
        goal = jnp.stack([jnp.broadcast_to(each, shape) for each in task.goal], axis=-1).astype(dtype)
        here = jnp.stack([pose.x, pose.y], axis=-1)
        points = self.planner.max_points or sum(self.static_map.grid.shape)
        share = jnp.linspace(0.0, 1.0, points, dtype=dtype).reshape((1,) * len(shape) + (-1, 1))
        none = jnp.zeros(shape, jnp.int32)
        fields = 3 if task.robot.holonomic else 2
        return Memory(
            own, state, here[..., None, :] + share * (goal - here)[..., None, :], none > 0,
            jnp.zeros((task.ticks, *shape, 2), dtype), jnp.zeros((task.slots + task.ticks, *shape, fields), dtype),
            jnp.array(0, jnp.int32), none, none,
        )  # fmt: skip

    def command(self, task: Task, memory: Memory, sight: Sight) -> tuple[Memory, Command, View]:
        """One cycle of every robot."""
        return self._cycles(task, memory, sight, None)

    def plan(self, task: Task, memory: Memory, sight: Sight, length: int) -> tuple[Memory, Command, View]:
        """One cycle of every robot, and of its local controller's sequence the first M commands [M, N, *B]."""
        return self._cycles(task, memory, sight, length)

    def _cycles(self, task: Task, memory: Memory, sight: Sight, length: int | None) -> tuple[Memory, Command, View]:
        pose, tick, shape = sight.pose, sight.tick, sight.pose.x.shape
        tau = jnp.asarray(task.design.tau)
        seen = lax.dynamic_update_index_in_dim(memory.seen, jnp.stack([pose.x, pose.y], axis=-1), tick, 0)
        robots = gather(self, task, memory._replace(seen=seen), sight)
        every = jnp.maximum(jnp.round(self.planner_period / tau), 1).astype(jnp.int32)
        due = tick % every == 0
        flat = jax.tree.map(lambda a: a.reshape(math.prod(shape), *a.shape[len(shape) :]), robots)
        done = mapped(lambda one: cycle(self, one, due, length), flat)
        command, state, view = jax.tree.map(lambda a: a.reshape(*shape, *a.shape[1:]), done)
        if length is not None:
            command = jax.tree.map(lambda a: jnp.moveaxis(a, -1, 0), command)
        first = command if length is None else jax.tree.map(lambda a: a[0], command)
        told = jnp.stack(jax.tree.leaves(first), axis=-1)
        sent = lax.dynamic_update_index_in_dim(memory.sent, told, tick + task.slots, 0)
        memory = Memory(
            memory.keys, state, view.path, view.has_path, seen, sent, memory.plans + due,
            memory.failed + (due & ~view.found), memory.blocked + view.blocked,
        )  # fmt: skip
        return memory, command, view

    def report(self, memory: Memory) -> dict[str, Array]:
        """Share of plans that found no path, and of cycles in which every rollout collided."""
        dtype = memory.seen.dtype
        return {
            "no_path_share": memory.failed.astype(dtype) / jnp.maximum(memory.plans, 1),
            "blocked_share": memory.blocked.astype(dtype) / memory.seen.shape[0],
        }


def open_floor(scenario: Scenario, margin: float = 1.0, resolution: float = 0.05) -> StaticMap:
    """A map without obstacles that holds all starts and goals.

    Args:
        scenario: Robots and goals.
        margin: Floor around them (m).
        resolution: Side of a cell (m).
    """
    _checks.bounded("margin", margin, above=0, shape=())
    places = np.concatenate([np.asarray(scenario.start)[:, :2], np.asarray(scenario.goal).reshape(-1, 2)])
    low, high = places.min(axis=0) - margin, places.max(axis=0) + margin
    return map_of_shapes(Grid.covering((low[0], low[1]), (high[0], high[1]), resolution))


def _check_model(motion_model: str, robot: Robot) -> None:
    """Checks that rollouts move as the robot does."""
    name = type(robot).__name__
    if robot.motion_model is None:
        raise ValueError(f"robot: got {name}, whose motion the navigation stack does not know, expected another "
                         "controller, or a robot with a motion_model of Nav2's MPPI")  # fmt: skip
    if robot.motion_model != motion_model:
        raise ValueError(f"mppi.motion_model: got {motion_model} for the robot {name}, expected {robot.motion_model}")
