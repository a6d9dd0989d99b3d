"""The nominal path p̄(t): straight from the start to the goal, by the law without repulsion (model, section 5)."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from qocjax.scenario import Design, Scenario

__all__ = ["reference_distance", "reference_left", "reference_origin", "reference_path", "reference_way"]


def reference_distance(time: Array, initial: Array, kappa: Array | float, v_max: Array | float | None) -> Array:
    """Distance left to the goal after `time`, of a point that follows dr/dt = -min(kappa r, v_max).

    At the cap until kappa r falls below it, exponential after; closed form.

    Args:
        time: t (s).
        initial: r(0) (m), broadcastable to time.
        kappa: Goal gain (1/s).
        v_max: Speed cap (m/s), None for none.
    """
    if v_max is None:
        return initial * jnp.exp(-kappa * time)
    knee = jnp.minimum(v_max / kappa, initial)
    capped = (initial - knee) / v_max  # time spent at the cap
    exponential = knee * jnp.exp(-kappa * jnp.maximum(time - capped, 0.0))
    return jnp.where(time < capped, initial - v_max * time, exponential)


def reference_origin(start: Array, per_robot: bool) -> tuple[Array, Array]:
    """Where the reference starts, each coordinate [1 or N, *B]: the centroid of [N, 3, *B], or each robot's own."""
    x, y = start[:, 0], start[:, 1]
    return (x, y) if per_robot else (jnp.mean(x, axis=0, keepdims=True), jnp.mean(y, axis=0, keepdims=True))


def reference_way(start: Array, goal: Array, per_robot: bool) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Where the reference ends, and the way from there to where it starts; each coordinate [1 or N, *B] (m).

    Args:
        start: [N, 3, *B] start poses.
        goal: [N, 2, *1] goals, of the same rank.
        per_robot: Whether each robot has a reference of its own.
    """
    x, y = reference_origin(start, per_robot)
    goal_x, goal_y = (goal[: x.shape[0], k] for k in (0, 1))
    return (goal_x, goal_y), (x - goal_x, y - goal_y)


def reference_left(time: Array, start: Array, goal: Array, scenario: Scenario, design: Design) -> Array:
    """Share of the reference's way that is left at given times, [K, 1 or N, *B]; see `reference_path`."""
    _, (way_x, way_y) = reference_way(start, goal, scenario.reference_per_robot)
    initial = jnp.sqrt(jnp.maximum(way_x**2 + way_y**2, jnp.finfo(way_x.dtype).tiny))
    kappa, v_max = _gain_and_cap(scenario, design)
    clock = time.reshape((-1,) + (1,) * initial.ndim)
    return reference_distance(clock, initial[None], kappa, v_max) / initial[None]


def reference_path(time: Array, start: Array, goal: Array, scenario: Scenario, design: Design) -> tuple[Array, Array]:
    """The reference at given times.

    Args:
        time: [K] times (s).
        start: [N, 3, *B] start poses.
        goal: [N, 2, *1] goals, of the same rank.
        scenario: Which reference, and its gain and cap.
        design: Its kappa and v_max are used by the reference `follow`, broadcastable to [1, *B].

    Returns:
        The two coordinates, each [K, 1 or N, *B] (m).
    """
    (goal_x, goal_y), (way_x, way_y) = reference_way(start, goal, scenario.reference_per_robot)
    left = reference_left(time, start, goal, scenario, design)
    return goal_x[None] + left * way_x[None], goal_y[None] + left * way_y[None]


def _gain_and_cap(scenario: Scenario, design: Design) -> tuple[Array, Array | None]:
    if scenario.reference == "follow":
        kappa, v_max = jnp.asarray(design.kappa), jnp.asarray(design.v_max)
        return (kappa[None], v_max[None]) if kappa.ndim else (kappa, v_max)
    cap = None if scenario.reference == "uncapped" else jnp.asarray(scenario.nominal_v_max)
    return jnp.asarray(scenario.nominal_kappa), cap
