"""What the navigation stack is made of: map, inflation, planner, local controller, and how they are used."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeVar

import jax
import numpy as np
from jax import Array

from qocjax import _checks
from qocjax._kept import called
from qocjax.navigation.costmap import Inflation, StaticLayer, costmap_layers, influence, static_layer
from qocjax.navigation.critics import ConstraintCritic, CostCritic, GoalCritic, PreferForwardCritic
from qocjax.navigation.grid import Grid
from qocjax.navigation.maps import StaticMap
from qocjax.navigation.mppi_config import MppiConfig
from qocjax.navigation.path_critics import PathAlignCritic, PathFollowCritic
from qocjax.navigation.wavefront import Planner

__all__ = ["STACK_MPPI", "StackParts"]

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

T = TypeVar("T", bound="StackParts")


@dataclass(frozen=True)
class StackParts:
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
            ahead only where there is no room behind (m/s).
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
            return np.asarray(called(_alone, (self.static, self.inflation), (self.static_map.grid,)))

    def held(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What is made of the map, for a program's arguments: static costs and those without robots, distances (m).

        As constants of a program they lie in what is traced, lowered and compiled, a dozen times over.
        """
        static = self.static
        return np.asarray(static.cost, np.uint8), self.closed.astype(np.uint8), np.asarray(static.distance)

    def holding(self: T, arrays: tuple[Array, Array, Array]) -> T:
        """The stack that takes what is made of the map from a program's arguments, in the order of `held`."""
        cost, closed, distance = arrays
        stack = copy(self)
        vars(stack).update(static=StaticLayer(cost, distance), closed=closed)
        return stack

    @property
    def influence(self) -> int | None:
        """Cells from another robot beyond which it costs nothing; None where a design varies what that hangs on."""
        values = (*jax.tree.leaves(self.inflation), self.max_widening)
        if not all(_checks.is_concrete(each) for each in values):
            return None
        radius = float(np.asarray(self.inflation.robot_radius))
        return influence(self.inflation, self.static_map.grid.resolution, radius, self.max_widening)


def _alone(static: StaticLayer, inflation: Inflation, grid: Grid) -> Array:
    """The costmap without other robots, [rows, cols]."""
    return costmap_layers(grid, static, None, inflation).total()
