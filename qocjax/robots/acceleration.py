"""A robot that takes time to reach the speed it is told: limits on acceleration, and how it moves under them.

Names and signs are Nav2's: ax_max away from standstill, ax_min (negative) towards it, az_max both ways. Under a
constant command the speeds are linear in time but for three kinks: where the speed has come down to what the old one
and the new one have in common (standstill, for a change of direction), where it has arrived at the new one, and where
the turn rate has. Between kinks the position has no elementary closed form; it is integrated by Lobatto's
rule, with an error below 1e-9 m over 0.1 s at 0.7 m/s and 2.84 rad/s. Speeds and heading are exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike

from qocjax import _checks
from qocjax._math import AngleMath
from qocjax.robots.interface import Command, Piece, Pose

__all__ = ["Acceleration", "Part", "accelerated", "drive", "linear_piece", "parts"]

# Stands for a limit that is infinite: so steep that it counts as none, and no product with a time of 0 is NaN.
_STEEP = 1e9

# The inner points of Lobatto's rule on [0, 1]; they weigh five times as much as the ends.
_INNER = (0.5 - 0.5 / math.sqrt(5.0), 0.5 + 0.5 / math.sqrt(5.0))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Acceleration:
    """Limits on how fast a robot's speeds change; infinite ones are none.

    Attributes:
        ax_max: Of a speed that grows, in either direction (m/s²).
        ax_min: Of a speed that shrinks, negative as in Nav2 (m/s²).
        az_max: Of the turn rate (rad/s²).
    """

    ax_max: ArrayLike = np.inf
    ax_min: ArrayLike = -np.inf
    az_max: ArrayLike = np.inf

    def check(self) -> None:
        """Checks signs and shapes.

        Raises:
            ValueError: A limit is zero, of the wrong sign, or no number.
        """
        for name, sign in (("ax_max", 1.0), ("ax_min", -1.0), ("az_max", 1.0)):
            value = getattr(self, name)
            if not _checks.is_concrete(value):
                continue
            array = np.asarray(value)
            if array.dtype.kind not in "iuf" or array.ndim or not sign * array > 0:
                raise ValueError(f"{name}: got {value!r}, expected a number {'above' if sign > 0 else 'below'} 0")


class Part(NamedTuple):
    """A stretch of time over which both speeds are linear in it."""

    duration: Array  # [N, *B] s
    begin: Command  # speeds, each [N, *B]
    end: Command


def accelerated(
    pose: Pose, speed: Command, command: Command, duration: Array, limits: Acceleration, angles: AngleMath
) -> list[Piece]:
    """The motion of a robot that follows a constant command within limits, in four parts.

    Args:
        pose: Where it begins.
        speed: Speeds there, each [N, *B].
        command: What they go to.
        duration: h (s).
        limits: On the way there.
        angles: Exact or polynomial functions of half of the angle turned.
    """
    pieces = []
    for part in parts(speed, command, duration, limits):
        pieces.append(linear_piece(pose, part, angles))
        pose = pieces[-1].pose
    return pieces


def linear_piece(pose: Pose, part: Part, angles: AngleMath) -> Piece:
    """The motion over which both speeds are linear in time; see `drive`."""
    h, first, last = part
    squares = (a * (a + b) + b * b for a, b in ((first.nu, last.nu), (first.omega, last.omega)))
    return Piece(
        duration=h,
        pose=drive(pose, part, angles),
        begin=first,
        speed=last,
        length=jnp.abs(0.5 * (h * first.nu + h * last.nu)),
        effort=(1 / 3) * h * sum(squares),
    )


def parts(speed: Command, command: Command, duration: Array, limits: Acceleration) -> list[Part]:
    """The four parts, some of no length, in which a robot follows a constant command.

    Args:
        speed: Speeds at the start, each [N, *B].
        command: What they go to.
        duration: h (s).
        limits: On the way there.
    """
    up, down = (jnp.minimum(jnp.abs(each), _STEEP) for each in (limits.ax_max, limits.ax_min))
    turn = jnp.minimum(limits.az_max, _STEEP)
    common = jnp.where(speed.nu * command.nu > 0, jnp.minimum(jnp.abs(speed.nu), jnp.abs(command.nu)), 0.0)
    falls, rises = jnp.abs(speed.nu) - common, jnp.abs(command.nu) - common
    change = command.omega - speed.omega
    fallen, turned = falls * (1.0 / down), jnp.abs(change) * (1.0 / turn)
    risen = fallen + rises * (1.0 / up)

    def at(t: Array) -> Command:
        fall = jnp.sign(speed.nu) * jnp.minimum(down * t, falls)
        rise = jnp.sign(command.nu) * jnp.clip(up * (t - fallen), 0.0, rises)
        # Exactly the command once it is reached, so that rounding does not add up.
        nu = jnp.where(t >= risen, command.nu, speed.nu - fall + rise)
        return Command(nu, jnp.where(t >= turned, command.omega, speed.omega + jnp.clip(change, -turn * t, turn * t)))

    middle = jnp.maximum(fallen, jnp.minimum(risen, turned))
    kinks = (jnp.minimum(fallen, turned), middle, jnp.maximum(risen, turned))
    times = [
        jnp.zeros_like(middle),
        *(jnp.minimum(kink, duration) for kink in kinks),
        jnp.zeros_like(middle) + duration,
    ]
    speeds = [speed, *map(at, times[1:])]
    found = [Part(t1 - t0, v0, v1) for (t0, t1), (v0, v1) in zip(pairwise(times), pairwise(speeds), strict=True)]
    return lax.optimization_barrier(found)  # computed once, however often it is read


def drive(pose: Pose, part: Part, angles: AngleMath) -> Pose:
    """Moves along a part: the heading exactly, the position by Lobatto's rule with four points.

    Args:
        pose: Where it begins.
        part: Its duration and speeds.
        angles: Exact or polynomial functions of half of the angle turned.
    """
    h, begin, end = part
    half = 0.25 * h * (begin.omega + end.omega)
    cos, sin = _cos_sin(half, angles)
    along, across = begin.nu + end.nu * cos, end.nu * sin
    for share in _INNER:
        turned = (0.5 * share) * h * (begin.omega + (0.5 * share) * (end.omega - begin.omega))
        five = 5.0 * (begin.nu + share * (end.nu - begin.nu))
        inner_cos, inner_sin = _cos_sin(turned, angles)
        along, across = along + five * inner_cos, across + five * inner_sin
    twelfth = (1 / 12) * h
    moved = Pose(
        x=pose.x + twelfth * (along * pose.cos - across * pose.sin),
        y=pose.y + twelfth * (along * pose.sin + across * pose.cos),
        cos=pose.cos * cos - pose.sin * sin,
        sin=pose.sin * cos + pose.cos * sin,
        heading=pose.heading + 2.0 * half,
    )
    return lax.optimization_barrier(moved)


def _cos_sin(half: Array, angles: AngleMath) -> tuple[Array, Array]:
    """Of an angle, from its half."""
    sinc, cos = angles.sinc_cos(half)
    sin = half * sinc
    return cos * cos - sin * sin, 2.0 * sin * cos
