"""Rollouts, scored while they are made: one scan over the horizon that carries K of each number.

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
from qocjax.robots import Command, Pose, arc, glide
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


def roll_out(config: MppiConfig, scene: Scene, pose: Array, now: Command, samples: Command, record: bool) -> Rolled:
    """Moves K robots through their sequences along exact arcs, and adds up the terms of the critics.

    Args:
        config: Parameters.
        scene: What all rollouts have in common.
        pose: [3] where they begin (m, m, rad).
        now: Speeds at which they begin, each field [].
        samples: Sampled speeds, each field [H, K].
        record: Whether all points are returned.
    """
    steps, count = samples.nu.shape
    # As many steps are written out as it takes for every block to score the same of its points.
    block = min(math.lcm(*(critic.stride for critic in config.critics)), steps)
    whole = steps - steps % block

    def advance(carry: _Carry, rows: Command) -> tuple[_Carry, Any]:
        return _block(config, scene, carry, rows, record)

    carry = _start(config, scene, pose, now, count)
    blocks = jax.tree.map(lambda each: each[:whole].reshape(-1, block, count), samples)
    carry, points = lax.scan(advance, carry, blocks)
    if whole < steps:
        carry, rest = advance(carry, jax.tree.map(lambda each: each[whole:], samples))
    if record:
        points = tuple(each.reshape(whole, count) for each in points)
        if whole < steps:
            points = tuple(jnp.concatenate(both) for both in zip(points, rest, strict=True))
    return Rolled(carry.pose, carry.distance, carry.totals, (points[0].T, points[1].T) if record else None)


def _start(config: MppiConfig, scene: Scene, pose: Array, now: Command, samples: int) -> _Carry:
    x, y, heading = (jnp.full(samples, each) for each in pose)
    speed, nothing = jax.tree.map(lambda each: jnp.full(samples, each), now), jnp.zeros_like(x)
    begin = Pose(x, y, jnp.full_like(x, jnp.cos(pose[2])), jnp.full_like(x, jnp.sin(pose[2])), heading)
    first = _moved(config, begin, speed)
    point = Point(first.x, first.y, first.heading, nothing, speed.nu, speed.omega, speed.nu_y)
    chords = tuple(_Chords(first.x, first.y, nothing) if _measures(critic) else None for critic in config.critics)
    totals = tuple(_nothing(critic, point, scene) for critic in config.critics)
    return _Carry(begin, speed, speed, -_length(speed) * config.model_dt, chords, totals)


def _nothing(critic: Critic, first: Point, scene: Scene) -> Any:
    """Sums before the first point. Where chords are measured that point only begins them: it will cancel."""
    if _measures(critic):
        return jax.tree.map(jnp.negative, critic.term(first, scene))
    return jax.tree.map(lambda term: jnp.zeros(term.shape, term.dtype), jax.eval_shape(critic.term, first, scene))


def _block(config: MppiConfig, scene: Scene, carry: _Carry, rows: Command, record: bool) -> tuple[_Carry, Any]:
    """Some steps, written out; the first one's index is a multiple of every stride."""
    points = []
    for index in range(len(rows.nu)):
        carry = _move(config, carry, jax.tree.map(lambda each, index=index: each[index], rows))
        due = [index % critic.stride == 0 for critic in config.critics]
        carry = _score(config, scene, carry, due)
        points.append((carry.pose.x, carry.pose.y))
    return carry, tuple(jnp.stack(each) for each in zip(*points, strict=True)) if record else None


def _move(config: MppiConfig, carry: _Carry, drawn: Command) -> _Carry:
    """One step."""
    speed = follow(config, carry.speed, carry.wanted, config.model_dt)
    distance = carry.distance + _length(speed) * config.model_dt
    pose = _moved(config, carry.pose, speed)
    # Each step is computed before the next: what is made of it would otherwise compute all steps of a block again.
    pose, speed, distance = lax.optimization_barrier((pose, speed, distance))
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
            point = Point(pose.x, pose.y, pose.heading, along, carry.speed.nu, carry.speed.omega, carry.speed.nu_y)
            totals[i] = jax.tree.map(jnp.add, totals[i], critic.term(point, scene))
    return carry._replace(chords=tuple(chords), totals=tuple(totals))


def _moved(config: MppiConfig, pose: Pose, speed: Command) -> Pose:
    """A step at a speed."""
    return (arc if speed.nu_y is None else glide)(pose, speed, config.model_dt, _angles(config))


def _length(speed: Command) -> Array:
    """Metres per second along the way."""
    return jnp.abs(speed.nu) if speed.nu_y is None else jnp.sqrt(speed.nu**2 + speed.nu_y**2)


def _measures(critic: Critic) -> bool:
    return getattr(critic, "chords", False)


def _angles(config: MppiConfig) -> Any:
    spread = config.wz_std if is_concrete(config.wz_std) else WIDEST
    exact = angle_math(0.5 * (config.wz_max + LARGEST * spread) * config.model_dt)
    return exact._replace(sinc_cos=lambda angle: lax.optimization_barrier(exact.sinc_cos(angle)))  # once for all fields
