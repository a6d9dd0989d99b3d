"""The robot: a unicycle that moves along exact arcs while its command is constant (model, section 2)."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from qocjax._math import AngleMath

__all__ = ["Command", "Pose", "arc", "pose_from"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Pose:
    """Poses of N robots in any batch `*B`.

    The heading is kept as an angle, continuous and never wrapped, and as the unit vector that the arcs and the
    controller use: so no tick needs a sine or a cosine of a large angle.
    """

    x: Array  # [N, *B] m
    y: Array  # [N, *B] m
    cos: Array  # [N, *B]
    sin: Array  # [N, *B]
    heading: Array  # [N, *B] rad


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Command:
    """Commanded speeds of N robots in any batch `*B`."""

    nu: Array  # [N, *B] m/s
    omega: Array  # [N, *B] rad/s

    def scaled(self, gain: Array | None) -> Command:
        """The command times a gain (None for 1)."""
        return self if gain is None else Command(self.nu * gain, self.omega * gain)


def pose_from(start: Array) -> Pose:
    """Pose from start poses [N, 3, *B] (m, m, rad)."""
    x, y, heading = start[:, 0], start[:, 1], start[:, 2]
    return Pose(x, y, jnp.cos(heading), jnp.sin(heading), heading)


def arc(pose: Pose, command: Command, duration: Array | float, math: AngleMath) -> Pose:
    """Moves along the exact arc of a constant command.

    With a = omega h / 2: the chord has length nu h sinc(a) and direction theta + a (model, section 2).

    Args:
        pose: Where the arc begins.
        command: In force all along.
        duration: h (s).
        math: Exact or polynomial functions of the half turn a.
    """
    a = command.omega * (0.5 * duration)
    sinc, cos_a = math.sinc_cos(a)
    sin_a = a * sinc
    cos_mid = pose.cos * cos_a - pose.sin * sin_a
    sin_mid = pose.sin * cos_a + pose.cos * sin_a
    chord = command.nu * duration * sinc
    return Pose(
        x=pose.x + chord * cos_mid,
        y=pose.y + chord * sin_mid,
        cos=cos_mid * cos_a - sin_mid * sin_a,
        sin=sin_mid * cos_a + cos_mid * sin_a,
        heading=pose.heading + 2.0 * a,
    )
