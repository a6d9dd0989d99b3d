"""The holonomic robot: it moves as it is told in any direction, whatever its heading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from qocjax._math import AngleMath
from qocjax.robots.interface import Command, Gains, Piece, Pose, Robot

__all__ = ["Holonomic", "glide"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Holonomic(Robot):
    """A single integrator, p' = v with |v| <= v_max, on a body that may turn: theta' = omega.

    Commands are velocities of the body, as those of Nav2's Omni: ahead, to the left, and the turn rate. Steered
    towards a velocity the body does not turn, so its heading stays what it was at the start. Path length is ∫ |v| dt,
    control effort ∫ |v|² + omega² dt.
    """

    left_invariant = True
    holonomic = True
    unread = ("omega_max", "gamma")
    motion_model = "Omni"

    def steer(self, v_x: Array, v_y: Array, pose: Pose, gains: Gains, math: AngleMath) -> Command:
        """The velocity itself, shortened to the cap."""
        squared = v_x * v_x + v_y * v_y
        over = squared > jnp.square(gains.v_max)
        share = jnp.where(over, gains.v_max * jax.lax.rsqrt(jnp.where(over, squared, 1.0)), 1.0)
        ahead = share * (v_x * pose.cos + v_y * pose.sin)
        left = share * (v_y * pose.cos - v_x * pose.sin)
        return Command(ahead, jnp.zeros_like(ahead), left)

    def obeyed(self, command: Command) -> Command:
        """The command."""
        return command

    def move(
        self, pose: Pose, speed: Command | None, command: Command, duration: Array, math: AngleMath
    ) -> Sequence[Piece]:
        """A straight line; an arc while the body turns, with a chord of length |v| h sinc(omega h / 2)."""
        nu, omega, left = command.nu, command.omega, command.nu_y
        assert left is not None  # as it is holonomic; for the type checker
        squared = nu * nu + left * left
        moving = squared > 0.0  # the gradient of a square root at zero is infinite
        return [
            Piece(
                duration=duration,
                pose=glide(pose, command, duration, math),
                begin=command,
                speed=command,
                length=duration * jnp.where(moving, jnp.sqrt(jnp.where(moving, squared, 1.0)), 0.0),
                effort=duration * (squared + omega * omega),
            )
        ]


def glide(pose: Pose, command: Command, duration: Array | float, math: AngleMath) -> Pose:
    """Moves along the exact arc of a constant command with a speed to the left; see `qocjax.robots.arc`."""
    assert command.nu_y is not None  # for the type checker
    half = command.omega * (0.5 * duration)
    sinc, cos_half = math.sinc_cos(half)
    sin_half = half * sinc
    middle = _turned((pose.cos, pose.sin), cos_half, sin_half)
    along, across = _turned((command.nu * duration, command.nu_y * duration), *middle)
    last = _turned(middle, cos_half, sin_half)
    return Pose(pose.x + sinc * along, pose.y + sinc * across, *last, pose.heading + 2.0 * half)


def _turned(vector: tuple[Array, Array], cos: Array, sin: Array) -> tuple[Array, Array]:
    return vector[0] * cos - vector[1] * sin, vector[0] * sin + vector[1] * cos
