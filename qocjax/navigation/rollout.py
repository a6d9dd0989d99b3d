"""Rollouts of the unicycle, scored while they are made: one scan over the horizon that carries K of each number.

As in Nav2 (`generateNoisedTrajectories` of optimizer.cpp and `predict` of motion_models.hpp), the first step is made at
the speed of now, and step i at what acceleration allows of the sampled commands i - 1. The caps do not bound a rollout:
the ConstraintCritic prices what is beyond them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax._checks import is_concrete
from qocjax._math import angle_math
from qocjax.navigation.critics import Critic, Point, Scene
from qocjax.navigation.feasible import follow
from qocjax.navigation.mppi_config import MppiConfig
from qocjax.navigation.noise import LARGEST
from qocjax.robots import Command, Pose, arc
from qocjax.tunables import WIDEST

__all__ = ["Rolled", "roll_out"]


class Rolled(NamedTuple):
    """What has come of K rollouts."""

    pose: Pose  # the last ones, each field [K]
    distance: Array  # [K] travelled from the first point on (m)
    totals: tuple[Any, ...]  # sums of each critic
    points: tuple[Array, Array] | None  # x and y [K, H] (m), if asked for


class _Chords(NamedTuple):
    """The polygon through the points that a critic scores."""

    x: Array  # [K] last corner (m)
    y: Array  # [K]
    length: Array  # [K] m


class _Carry(NamedTuple):
    pose: Pose
    speed: Command
    wanted: Command  # in the next step: the sample drawn for the one before
    distance: Array
    chords: tuple[_Chords | None, ...]  # of the critics that measure them
    totals: tuple[Any, ...]


def roll_out(config: MppiConfig, scene: Scene, pose: Array, now: Command, vx: Array, wz: Array, record: bool) -> Rolled:
    """Moves K robots through their sequences along exact arcs, and adds up the terms of the critics.

    Args:
        config: Parameters.
        scene: What all rollouts have in common.
        pose: [3] where they begin (m, m, rad).
        now: Speeds at which they begin, each field [].
        vx: [H, K] sampled speeds (m/s).
        wz: [H, K] sampled rates of turn (rad/s).
        record: Whether all points are returned.
    """
    steps, samples = vx.shape
    # As many steps are written out as it takes for every block to score the same of its points.
    block = min(math.lcm(*(critic.stride for critic in config.critics)), steps)
    whole = steps - steps % block

    def advance(carry: _Carry, rows: Sequence[Array]) -> tuple[_Carry, Any]:
        return _block(config, scene, carry, rows, record)

    carry = _start(config, scene, pose, now, samples)
    carry, points = lax.scan(advance, carry, [each[:whole].reshape(-1, block, samples) for each in (vx, wz)])
    if whole < steps:
        carry, rest = advance(carry, [each[whole:] for each in (vx, wz)])
    if record:
        points = tuple(each.reshape(whole, samples) for each in points)
        if whole < steps:
            points = tuple(jnp.concatenate(both) for both in zip(points, rest, strict=True))
    return Rolled(carry.pose, carry.distance, carry.totals, (points[0].T, points[1].T) if record else None)


def _start(config: MppiConfig, scene: Scene, pose: Array, now: Command, samples: int) -> _Carry:
    x, y, heading, nu, omega = (jnp.full(samples, each) for each in (*pose, now.nu, now.omega))
    nothing = jnp.zeros_like(x)
    begin = Pose(x, y, jnp.full_like(x, jnp.cos(pose[2])), jnp.full_like(x, jnp.sin(pose[2])), heading)
    speed = Command(nu, omega)
    first = arc(begin, speed, config.model_dt, _angles(config))
    point = Point(first.x, first.y, first.heading, nothing, nu)
    chords = tuple(_Chords(first.x, first.y, nothing) if _measures(critic) else None for critic in config.critics)
    totals = tuple(_nothing(critic, point, scene) for critic in config.critics)
    return _Carry(begin, speed, speed, -jnp.abs(nu) * config.model_dt, chords, totals)


def _nothing(critic: Critic, first: Point, scene: Scene) -> Any:
    """Sums before the first point. Where chords are measured that point only begins them: it will cancel."""
    if _measures(critic):
        return jax.tree.map(jnp.negative, critic.term(first, scene))
    return jax.tree.map(lambda term: jnp.zeros(term.shape, term.dtype), jax.eval_shape(critic.term, first, scene))


def _block(config: MppiConfig, scene: Scene, carry: _Carry, rows: Sequence[Array], record: bool) -> tuple[_Carry, Any]:
    """Some steps, written out; the first one's index is a multiple of every stride."""
    points = []
    for index in range(len(rows[0])):
        carry = _move(config, carry, Command(rows[0][index], rows[1][index]))
        due = [index % critic.stride == 0 for critic in config.critics]
        carry = _score(config, scene, carry, due)
        points.append((carry.pose.x, carry.pose.y))
    return carry, tuple(jnp.stack(each) for each in zip(*points, strict=True)) if record else None


def _move(config: MppiConfig, carry: _Carry, drawn: Command) -> _Carry:
    """One step."""
    speed = follow(config, carry.speed, carry.wanted, config.model_dt)
    distance = carry.distance + jnp.abs(speed.nu) * config.model_dt
    pose = arc(carry.pose, speed, config.model_dt, _angles(config))
    return carry._replace(pose=pose, speed=speed, wanted=drawn, distance=distance)


def _score(config: MppiConfig, scene: Scene, carry: _Carry, due: Sequence[bool]) -> _Carry:
    """Takes the point into the sums of the critics that are due."""
    pose, chords, totals = carry.pose, list(carry.chords), list(carry.totals)
    for i, critic in enumerate(config.critics):
        if due[i]:
            chord = chords[i]
            if chord is not None:
                length = chord.length + jnp.sqrt((pose.x - chord.x) ** 2 + (pose.y - chord.y) ** 2)
                chords[i] = _Chords(pose.x, pose.y, length)
            along = carry.distance if chord is None else length
            point = Point(pose.x, pose.y, pose.heading, along, carry.speed.nu)
            totals[i] = jax.tree.map(jnp.add, totals[i], critic.term(point, scene))
    return carry._replace(chords=tuple(chords), totals=tuple(totals))


def _measures(critic: Critic) -> bool:
    return getattr(critic, "chords", False)


def _angles(config: MppiConfig) -> Any:
    spread = config.wz_std if is_concrete(config.wz_std) else WIDEST
    return angle_math(0.5 * (config.wz_max + LARGEST * spread) * config.model_dt)
