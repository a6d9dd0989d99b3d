"""Critics: what a rollout of the local controller costs (model, section 9).

Names, parameters, defaults and formulas are those of Nav2's `nav2_mppi_controller` (docs.nav2.org, Model Predictive
Path Integral Controller; one C++ source per critic, which each class names). A critic is a sum over the points of a
rollout, `term`, that `cost` turns into the critic's share of the total; so rollouts are scored while they are made, and
only sums are kept.

Letters: K rollouts, H points each, M points of the local path.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import jax.numpy as jnp
from jax import Array, lax

from qocjax.cost_values import INSCRIBED, LETHAL
from qocjax.navigation.local_path import LocalPath, MapCosts

__all__ = [
    "COLLISION",
    "ConstraintCritic",
    "CostCritic",
    "Critic",
    "Ends",
    "GoalAngleCritic",
    "GoalCritic",
    "ObstaclesCritic",
    "Point",
    "PreferForwardCritic",
    "Scene",
]

# A round robot whose centre is in a cell of at least this cost touches an obstacle (INSCRIBED_INFLATED_OBSTACLE in
# Nav2). Cells unknown or outside the map (255) count likewise, as where Nav2 does not track unknown space.
COLLISION = float(INSCRIBED)

_STRAIGHT = 1e-6  # rad/s, below which a turn counts as this one


class Scene(NamedTuple):
    """What all rollouts of a cycle have in common."""

    goal: Array  # [3] m, m, rad
    to_goal: Array  # [] distance of the robot from the goal (m)
    path: LocalPath
    clear: Array  # [M] whether each point of the path is free of obstacles
    costs: MapCosts
    path_spacing: float  # between its points (m)
    model_dt: float  # s
    vx_max: Array  # [] m/s
    vx_min: Array  # [] m/s
    wz_max: Array  # [] rad/s
    vy_max: Array  # [] m/s; of robots that move sideways
    min_turning_r: float | None = None  # m, of robots that turn on circles alone


class Point(NamedTuple):
    """One point of each rollout, after a step of model_dt."""

    x: Array  # [K] m
    y: Array  # [K] m
    heading: Array  # [K] rad
    distance: Array  # [K] travelled from the first point on (m), where a critic asks for it, along chords
    vx: Array  # [K] speed of the step (m/s)
    wz: Array  # [K] its rate of turn (rad/s)
    vy: Array | None  # [K] its speed to the left (m/s), of robots that move sideways


class Ends(NamedTuple):
    """The last points."""

    x: Array  # [K] m
    y: Array  # [K] m
    furthest: Array  # [] largest index of a path point that is reached (`furthest_reached`)
    steps: int  # H


class Critic(Protocol):
    """A share of the cost of rollouts; frozen, so that a configuration of critics can be compiled for.

    Attributes:
        stride: Which points are scored: those whose index, from 0, is a multiple of it.
        chords: Optional. True where `Point.distance` is to be the length of the chords between the points that are
            scored; the first point then begins them and is not scored.
    """

    @property
    def stride(self) -> int:
        """Which points are scored."""
        ...

    def term(self, point: Point, scene: Scene) -> Any:
        """What a point adds to the sums: arrays [K], in any pytree."""
        ...

    def cost(self, total: Any, ends: Ends, scene: Scene) -> Array:
        """Cost [K] from the sums of the terms, or [] where it is the same for all."""
        ...


@dataclass(frozen=True)
class ConstraintCritic:
    """Speeds beyond the caps: weight Σ excess dt (constraint_critic.cpp).

    Of Omni the length of the velocity, signed as vx, beyond that of both caps. Of Ackermann also the radius by which a
    circle is too tight.
    """

    cost_weight: float = 4.0
    cost_power: int = 1
    stride = 1

    def term(self, point: Point, scene: Scene) -> Array:
        """Metres beyond the caps."""
        over, under = point.vx - scene.vx_max, scene.vx_min - point.vx
        if point.vy is not None:
            total = jnp.copysign(_distance(point.vx, point.vy), point.vx)
            most, least = (_distance(each, scene.vy_max) for each in (scene.vx_max, scene.vx_min))
            over, under = total - most, jnp.where(scene.vx_min > 0.0, least, -least) - total
        excess = jnp.maximum(over, 0.0) + jnp.maximum(under, 0.0)
        if scene.min_turning_r is not None:
            radius = jnp.abs(point.vx) / jnp.maximum(jnp.abs(point.wz), _STRAIGHT)
            excess = excess + jnp.maximum(scene.min_turning_r - radius, 0.0)
        return excess * scene.model_dt

    def cost(self, total: Array, ends: Ends, scene: Scene) -> Array:
        """Weighted sum."""
        return (self.cost_weight * total) ** self.cost_power


@dataclass(frozen=True)
class PreferForwardCritic:
    """Driving backwards, unless near the goal: weight Σ max(-vx, 0) dt (prefer_forward_critic.cpp)."""

    cost_weight: float = 5.0
    cost_power: int = 1
    threshold_to_consider: float = 0.5
    stride = 1

    def term(self, point: Point, scene: Scene) -> Array:
        """Metres driven backwards."""
        return jnp.maximum(-point.vx, 0.0) * scene.model_dt

    def cost(self, total: Array, ends: Ends, scene: Scene) -> Array:
        """Weighted sum, 0 near the goal."""
        return _where(scene.to_goal >= self.threshold_to_consider, (self.cost_weight * total) ** self.cost_power)


@dataclass(frozen=True)
class GoalCritic:
    """Mean distance from the goal, once the path to it is short (goal_critic.cpp)."""

    cost_weight: float = 5.0
    cost_power: int = 1
    threshold_to_consider: float = 1.4
    stride = 1

    def term(self, point: Point, scene: Scene) -> Array:
        """Distance from the goal (m)."""
        return _distance(point.x - scene.goal[0], point.y - scene.goal[1])

    def cost(self, total: Array, ends: Ends, scene: Scene) -> Array:
        """Weighted mean, 0 far from the goal."""
        close = scene.path.remaining <= self.threshold_to_consider
        return _where(close, (self.cost_weight / ends.steps * total) ** self.cost_power)


@dataclass(frozen=True)
class GoalAngleCritic:
    """Mean angle to the goal's heading, near the goal (goal_angle_critic.cpp)."""

    cost_weight: float = 3.0
    cost_power: int = 1
    threshold_to_consider: float = 0.5
    stride = 1

    def term(self, point: Point, scene: Scene) -> Array:
        """Shortest angle (rad)."""
        turn = point.heading - scene.goal[2]
        return jnp.abs(turn - (2 * jnp.pi) * jnp.round(turn * (0.5 / jnp.pi)))

    def cost(self, total: Array, ends: Ends, scene: Scene) -> Array:
        """Weighted mean, 0 away from the goal."""
        near = scene.to_goal < self.threshold_to_consider
        return _where(near, (self.cost_weight / ends.steps * total) ** self.cost_power)


@dataclass(frozen=True)
class CostCritic:
    """Mean cost of the map's cells under a rollout, J_map = Σ c(x(t)), and a price on collisions (cost_critic.cpp).

    Near the goal only collisions and near collisions count, since a goal may lie near obstacles.
    """

    cost_weight: float = 3.81
    cost_power: int = 1
    critical_cost: float = 300.0
    near_collision_cost: float = 253.0
    collision_cost: float = 1000000.0
    near_goal_distance: float = 0.5
    trajectory_point_step: int = 2

    @property
    def stride(self) -> int:
        """Which points are scored."""
        return self.trajectory_point_step

    def term(self, point: Point, scene: Scene) -> tuple[Array, Array]:
        """Cost of the cell, and 1 in a collision."""
        cost = lax.optimization_barrier(scene.costs.at(point.x, point.y))  # looked up once, read by both sums
        soft = _where(scene.to_goal >= self.near_goal_distance, cost)
        hit = (cost >= COLLISION).astype(cost.dtype)
        return jnp.where(cost >= self.near_collision_cost, self.critical_cost, soft), hit

    def cost(self, total: tuple[Array, Array], ends: Ends, scene: Scene) -> Array:
        """Weighted mean of the points scored; the collision cost, weighted likewise, for rollouts that collide."""
        score = jnp.where(self.collides(total), self.collision_cost, total[0])
        points = -(-ends.steps // self.stride)
        return (self.cost_weight / LETHAL / points * score) ** self.cost_power

    def collides(self, total: tuple[Array, Array]) -> Array:
        """Which rollouts touch an obstacle, [K]."""
        return total[1] > 0


@dataclass(frozen=True)
class ObstaclesCritic:
    """Distance from obstacles, read back from the inflation layer's decay (obstacles_critic.cpp).

    A cost c stands for the distance d = ln(253 / c) / cost_scaling_factor from the inscribed circle of the robot to the
    obstacle. Costs: critical_weight Σ max(margin - d, 0), or collision_cost; and repulsion_weight times the mean of
    inflation_radius - d, less its smallest value among the rollouts.
    """

    repulsion_weight: float = 1.5
    critical_weight: float = 20.0
    cost_power: int = 1
    collision_cost: float = 100000.0
    collision_margin_distance: float = 0.10
    near_goal_distance: float = 0.5
    cost_scaling_factor: float = 10.0
    inflation_radius: float = 0.55
    stride = 1

    def term(self, point: Point, scene: Scene) -> tuple[Array, Array, Array]:
        """Metres inside the margin, 1 in a collision, repulsion."""
        cost = lax.optimization_barrier(scene.costs.at(point.x, point.y))  # looked up once, read by all sums
        costly = cost >= 1.0
        distance = jnp.log(COLLISION / jnp.maximum(cost, 1.0)) / self.cost_scaling_factor
        inside = jnp.where(costly, jnp.maximum(self.collision_margin_distance - distance, 0.0), 0.0)
        repulsion = _where(costly & (scene.to_goal >= self.near_goal_distance), self.inflation_radius - distance)
        return inside, (cost >= COLLISION).astype(cost.dtype), repulsion

    def cost(self, total: tuple[Array, Array, Array], ends: Ends, scene: Scene) -> Array:
        """Weighted sum of the two terms."""
        critical = jnp.where(self.collides(total), self.collision_cost, total[0])
        repulsion = (total[2] - jnp.min(total[2])) / ends.steps
        return (self.critical_weight * critical + self.repulsion_weight * repulsion) ** self.cost_power

    def collides(self, total: tuple[Array, Array, Array]) -> Array:
        """Which rollouts touch an obstacle, [K]."""
        return total[1] > 0


def _where(condition: Array, value: Array) -> Array:
    return jnp.where(condition, value, jnp.zeros_like(value))


def _distance(x: Array, y: Array) -> Array:
    return jnp.sqrt(x * x + y * y)
