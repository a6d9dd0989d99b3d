"""Critics that hold a rollout to the path: how close it stays, and how far it gets (model, section 9)."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
from jax import Array, lax

from qocjax.navigation.critics import Ends, Point, Scene
from qocjax.navigation.local_path import LocalPath

__all__ = ["PathAlignCritic", "PathFollowCritic", "furthest_reached"]


@dataclass(frozen=True)
class PathAlignCritic:
    """Mean distance of a rollout's points from the path points as far along the path (path_align_critic.cpp).

    Path points on obstacles are left out. Off where less than `threshold_to_consider` of path is left, where no rollout
    reaches `offset_from_furthest` points along it, and where more than two points, and more than a share of
    `max_path_occupancy_ratio`, of those up to the furthest one reached are on obstacles.

    How far along a point is, is the length of the chords between the points scored, from the first of them on. Points
    that would lie beyond the furthest path point reached are compared with their own path point; Nav2 takes that one.
    """

    cost_weight: float = 10.0
    cost_power: int = 1
    threshold_to_consider: float = 0.5
    offset_from_furthest: int = 20
    trajectory_point_step: int = 4
    max_path_occupancy_ratio: float = 0.07
    chords = True

    @property
    def stride(self) -> int:
        """Which points are scored."""
        return self.trajectory_point_step

    def term(self, point: Point, scene: Scene) -> tuple[Array, Array]:
        """Distance from the path point (m), and 1, both 0 where that point is on an obstacle."""
        path = scene.path
        reach = jnp.minimum(point.distance * (1.0 / scene.path_spacing) + 0.5, path.last.astype(point.x.dtype))
        index = reach.astype(jnp.int32)
        # A point on an obstacle is put infinitely far away: so one look-up fewer says that it is left out.
        x, y = (_take(each, index) for each in (jnp.where(scene.clear, path.x, jnp.inf), path.y))
        gap = lax.optimization_barrier(jnp.sqrt((x - point.x) ** 2 + (y - point.y) ** 2))  # two sums read it
        clear = gap < jnp.inf
        return jnp.where(clear, gap, 0.0), clear.astype(gap.dtype)

    def cost(self, total: tuple[Array, Array], ends: Ends, scene: Scene) -> Array:
        """Weighted mean."""
        before = jnp.arange(len(scene.clear)) < ends.furthest
        blocked = jnp.sum(before & ~scene.clear)
        free = (blocked <= 2) | (blocked <= self.max_path_occupancy_ratio * ends.furthest)
        visible = jnp.minimum(scene.path.remaining, (len(scene.clear) - 1) * scene.path_spacing)
        used = free & (ends.furthest >= self.offset_from_furthest) & (visible >= self.threshold_to_consider)
        cost = (self.cost_weight * total[0] / jnp.maximum(total[1], 1.0)) ** self.cost_power
        return jnp.where(used, cost, jnp.zeros_like(cost))


@dataclass(frozen=True)
class PathFollowCritic:
    """Distance of a rollout's end from a path point somewhat beyond the furthest one reached (path_follow_critic.cpp).

    That point is the first one free of obstacles from `offset_from_furthest` points on, or the end of the local path.
    Off where less than `threshold_to_consider` of path is left.
    """

    cost_weight: float = 5.0
    cost_power: int = 1
    threshold_to_consider: float = 1.4
    offset_from_furthest: int = 6
    stride = 1

    def term(self, point: Point, scene: Scene) -> tuple[()]:
        """Nothing: the end alone counts."""
        return ()

    def cost(self, total: tuple[()], ends: Ends, scene: Scene) -> Array:
        """Weighted distance."""
        path, clear = scene.path, scene.clear
        index = jnp.arange(len(clear))
        ahead = clear & (index >= ends.furthest + self.offset_from_furthest)
        target = jnp.min(jnp.where(ahead, index, path.last))
        target = jnp.minimum(target, path.last)
        distance = jnp.sqrt((ends.x - path.x[target]) ** 2 + (ends.y - path.y[target]) ** 2)
        cost = (self.cost_weight * distance) ** self.cost_power
        return jnp.where(path.remaining >= self.threshold_to_consider, cost, jnp.zeros_like(cost))


def furthest_reached(path: LocalPath, spacing: float, x: Array, y: Array, distance: Array) -> Array:
    """Largest index of a path point that is the nearest one to any rollout's end (utils.hpp).

    A rollout is compared with the points up to the first one that lies as far along the path as it has travelled: so a
    point behind a corner is not reached through the air.

    Args:
        path: M points.
        spacing: Between them (m).
        x: [K] of the ends (m).
        y: [K] of the ends (m).
        distance: [K] travelled from the first points of the rollouts on (m).
    """
    reach = jnp.ceil(distance * (1.0 / spacing))

    def nearer(best: tuple[Array, Array], at: tuple[Array, Array, Array]) -> tuple[tuple[Array, Array], None]:
        (least, nearest), (index, path_x, path_y) = best, at
        squared = (x - path_x) ** 2 + (y - path_y) ** 2
        found = (squared < least) & (index <= reach)
        return (jnp.where(found, squared, least), jnp.where(found, index, nearest)), None

    index = jnp.arange(len(path.x), dtype=x.dtype)
    _, nearest = lax.scan(nearer, (jnp.full_like(x, jnp.inf), jnp.zeros_like(x)), (index, path.x, path.y))[0]
    return jnp.max(nearest).astype(jnp.int32)


def _take(values: Array, index: Array) -> Array:
    return values.at[index].get(mode="promise_in_bounds")
