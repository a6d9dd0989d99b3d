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
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from qocjax import _checks
from qocjax.controllers.interface import Sight, Task
from qocjax.navigation.costmap import (
    Inflation,
    StaticLayer,
    check_free,
    costmap_layers,
    static_layer,
)
from qocjax.navigation.critics import (
    ConstraintCritic,
    CostCritic,
    GoalCritic,
    PreferForwardCritic,
)
from qocjax.navigation.cycle import View, cycle
from qocjax.navigation.gather import Memory, gather
from qocjax.navigation.grid import Grid
from qocjax.navigation.maps import StaticMap, map_of_shapes
from qocjax.navigation.mppi import initial_state
from qocjax.navigation.mppi_config import MppiConfig
from qocjax.navigation.path_critics import PathAlignCritic, PathFollowCritic
from qocjax.navigation.varied import value_at
from qocjax.navigation.wavefront import Planner
from qocjax.scenario import Design, Scenario
from qocjax.tunables import NAVIGATION
from qocjax.unicycle import Command, Pose

__all__ = ["STACK_MPPI", "NavigationStack", "open_floor"]

# Nav2's controller for goals that are places without a heading. For the model's cap of 0.7 m/s, not Nav2's 0.5, the
# path is seen further (more than v_max times the horizon) and followed harder; with Nav2's values a robot drives at
# about two thirds of the cap.
STACK_MPPI = MppiConfig(
    prune_distance=2.5,
    critics=(
        ConstraintCritic(),
        CostCritic(),
        GoalCritic(),
        PathAlignCritic(),
        PathFollowCritic(cost_weight=10.0),
        PreferForwardCritic(),
    ),
)


@dataclass(frozen=True)
class NavigationStack:
    """Costmap, global planner and local controller; names and defaults of Nav2's parameters where it has them.

    Attributes:
        static_map: The map that planner and local controller share.
        inflation: How costs fall off around obstacles. Some localisation uncertainty keeps robots apart by more than
            the half cell by which a map is wrong anyway.
        planner: Of the global planner. Its tolerance is wider than Nav2's, as robots with a common goal stand on it.
        mppi: Of the local controller. The design's v_max and omega_max and the loop's tau take the place of vx_max,
            wz_max and controller_frequency; wz_max is the largest omega_max that a design may have.
        planner_period: Time between global plans (s), rounded to sampling periods.
        predict: Whether rollouts start from the pose predicted through the commands that are under way, as if none of
            their loops were missed, instead of the sampled pose, and other robots are predicted likewise. For the
            actuation `deadline`.
        xy_goal_tolerance: Within this distance of its goal a robot is told to stand still (m).
        max_widening: Most by which age and speed widen the inflation around another robot (m).
        backup_speed: Where every rollout collides, the robot backs up straight at this speed, as Nav2's recovery does;
            ahead if that is the freer way (m/s).
        backup_dist: How far it looks for that (m).
    """

    static_map: StaticMap
    inflation: Inflation = field(default_factory=lambda: Inflation(localisation_sigma=0.02))
    planner: Planner = field(default_factory=lambda: Planner(tolerance=0.5))
    mppi: MppiConfig = STACK_MPPI
    planner_period: float = 1.0
    predict: bool = False
    xy_goal_tolerance: float = 0.25
    max_widening: float = 0.5
    backup_speed: float = 0.15
    backup_dist: float = 0.3

    costly = True
    sees_speed = True
    tunables = NAVIGATION
    unread = ("eta", "kappa", "gamma", "c_miss", "d_safe")

    def __post_init__(self) -> None:
        if not isinstance(self.static_map, StaticMap):
            raise TypeError(f"static_map: got {type(self.static_map).__name__}, expected a StaticMap")
        for name in ("planner_period", "xy_goal_tolerance", "max_widening", "backup_speed", "backup_dist"):
            limit = {"above": 0.0} if name in ("planner_period", "backup_dist") else {"least": 0.0}
            value = _checks.bounded(name, getattr(self, name), shape=(), **limit)
            object.__setattr__(self, name, float(value) if _checks.is_concrete(value) else value)
        if not isinstance(self.predict, bool):
            raise TypeError(f"predict: got {self.predict!r}, expected True or False")

    @cached_property
    def static(self) -> StaticLayer:
        """The static layer and its distance transform, made once."""
        with jax.ensure_compile_time_eval():
            return jax.tree.map(np.asarray, static_layer(self.static_map))

    @cached_property
    def closed(self) -> np.ndarray:
        """The costmap without other robots, which says where none can be."""
        with jax.ensure_compile_time_eval():
            return np.asarray(costmap_layers(self.static_map.grid, self.static, None, self.inflation).total())

    def check(self, scenario: Scenario, designs: Design, actuation: str) -> None:
        """Checks designs, starts and goals against the stack and its map.

        Raises:
            ValueError: A design varies what the stack does not read, or turns faster than it can; a start or goal is in
                a closed cell; robots start in collision; predictions for another actuation than `deadline`.
        """
        for name in designs.others:
            try:
                value_at(self, name)
            except AttributeError as error:
                raise ValueError(f"{name}: {error}") from None
        for name in self.unread:
            value = getattr(designs, name)
            if _checks.is_concrete(value) and np.unique(np.asarray(value)).size > 1:
                raise ValueError(
                    f"{name}: got several values, but the navigation stack does not read it, expected one value"
                )
        if _checks.is_concrete(designs.omega_max):
            fastest = float(np.max(np.asarray(designs.omega_max)))
            if fastest > self.mppi.wz_max * (1 + 1e-6):
                raise ValueError(
                    f"omega_max: got {fastest:g}, expected at most the stack's wz_max {self.mppi.wz_max:g}"
                )
        if self.predict and actuation != "deadline":
            raise ValueError(f"actuation: got {actuation!r} with predict=True, expected 'deadline'")
        radius, own = (float(np.asarray(of.robot_radius)) for of in (scenario, self.inflation))
        if abs(radius - own) > 1e-6:
            raise ValueError(f"robot_radius: got {radius:g} m with an inflation for {own:g} m, expected one radius")
        goals = np.broadcast_to(np.asarray(scenario.goal), (scenario.num_robots, 2))
        check_free("goal", goals, self.static_map.grid, self.closed)
        self._check_places("start", scenario, np.asarray(scenario.start, np.float64)[:, :2])

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
        return Memory(
            own, state, here[..., None, :] + share * (goal - here)[..., None, :], none > 0,
            jnp.zeros((task.ticks, *shape, 2), dtype), jnp.zeros((task.slots + task.ticks, *shape, 2), dtype),
            jnp.array(0, jnp.int32), none, none,
        )  # fmt: skip

    def command(self, task: Task, memory: Memory, sight: Sight) -> tuple[Memory, Command, View]:
        """One cycle of every robot."""
        pose, tick, shape = sight.pose, sight.tick, sight.pose.x.shape
        tau = jnp.asarray(task.design.tau)
        seen = lax.dynamic_update_index_in_dim(memory.seen, jnp.stack([pose.x, pose.y], axis=-1), tick, 0)
        robots = gather(self, task, memory._replace(seen=seen), sight)
        every = jnp.maximum(jnp.round(self.planner_period / tau), 1).astype(jnp.int32)
        due = tick % every == 0
        flat = jax.tree.map(lambda a: a.reshape(math.prod(shape), *a.shape[len(shape) :]), robots)
        done = _over_robots(lambda one: cycle(self, one, due), flat)
        command, state, view = jax.tree.map(lambda a: a.reshape(*shape, *a.shape[1:]), done)
        sent = lax.dynamic_update_index_in_dim(
            memory.sent, jnp.stack([command.nu, command.omega], axis=-1), tick + task.slots, 0
        )
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


def _over_robots(kernel: Any, robots: Any) -> Any:
    """One robot after the other on a CPU, where its rollouts stay in cache; all at once on an accelerator."""
    return lax.platform_dependent(
        robots, cpu=lambda each: lax.map(kernel, each), default=lambda each: jax.vmap(kernel)(each)
    )
