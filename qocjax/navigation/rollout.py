"""Rollouts of the unicycle, scored while they are made: one scan over the horizon that carries K of each number."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax._math import angle_math
from qocjax.navigation.critics import Point, Scene
from qocjax.navigation.mppi_config import MppiConfig
from qocjax.unicycle import Command, Pose, arc

__all__ = ["roll_out"]

_Carry = tuple[Pose, Array, tuple[Any, ...]]  # pose, distance travelled, sums of the critics


def roll_out(
    config: MppiConfig, scene: Scene, pose: Array, vx: Array, wz: Array, record: bool
) -> tuple[Pose, tuple[Any, ...], tuple[Array, Array] | None]:
    """Moves K robots through their sequences along exact arcs, and adds up the terms of the critics.

    The speeds of the motion are capped; the critics see the sampled ones.

    Args:
        config: Parameters.
        scene: What all rollouts have in common.
        pose: [3] where they begin (m, m, rad).
        vx: [H, K] sampled speeds (m/s).
        wz: [H, K] sampled rates of turn (rad/s).
        record: Whether all points are returned.

    Returns:
        The last poses [K], the sums of each critic, and x and y of all points [K, H] if asked for.
    """
    steps, samples = vx.shape
    # As many steps are written out as it takes for every block to score the same of its points.
    block = min(math.lcm(*(critic.stride for critic in config.critics)), steps)
    whole = steps - steps % block

    def advance(carry: _Carry, rows: Sequence[Array]) -> tuple[_Carry, Any]:
        return _block(config, scene, carry, rows, record)

    carry = _start(config, scene, pose, samples)
    carry, points = lax.scan(advance, carry, [each[:whole].reshape(-1, block, samples) for each in (vx, wz)])
    if whole < steps:
        carry, rest = advance(carry, (vx[whole:], wz[whole:]))
    if not record:
        return carry[0], carry[2], None
    points = tuple(each.reshape(whole, samples) for each in points)
    if whole < steps:
        points = tuple(jnp.concatenate(both) for both in zip(points, rest, strict=True))
    return carry[0], carry[2], (points[0].T, points[1].T)


def _start(config: MppiConfig, scene: Scene, pose: Array, samples: int) -> _Carry:
    x, y, heading = (jnp.full(samples, each) for each in pose)
    nothing = jnp.zeros_like(x)
    begin = Pose(x, y, jnp.full_like(x, jnp.cos(pose[2])), jnp.full_like(x, jnp.sin(pose[2])), heading)
    point = Point(x, y, heading, nothing, nothing)
    terms = tuple(jax.eval_shape(critic.term, point, scene) for critic in config.critics)
    return begin, nothing, jax.tree.map(lambda term: jnp.zeros(term.shape, term.dtype), terms)


def _block(config: MppiConfig, scene: Scene, carry: _Carry, rows: Sequence[Array], record: bool) -> tuple[_Carry, Any]:
    """Some steps, written out; the first one's index is a multiple of every stride."""
    pose, distance, totals = carry
    angles = angle_math(0.5 * config.wz_max * config.model_dt)
    points = []
    for index in range(len(rows[0])):
        vx, wz = rows[0][index], rows[1][index]
        nu = jnp.clip(vx, scene.vx_min, scene.vx_max)
        command = Command(nu, jnp.clip(wz, -scene.wz_max, scene.wz_max))
        pose = arc(pose, command, config.model_dt, angles)
        distance = distance + jnp.abs(nu) * config.model_dt
        point = Point(pose.x, pose.y, pose.heading, distance, vx)
        totals = tuple(
            jax.tree.map(jnp.add, total, critic.term(point, scene)) if index % critic.stride == 0 else total
            for critic, total in zip(config.critics, totals, strict=True)
        )
        points.append((pose.x, pose.y))
    return (pose, distance, totals), tuple(jnp.stack(each) for each in zip(*points, strict=True)) if record else None
