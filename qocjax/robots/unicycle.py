"""The unicycle: it moves along exact arcs while its command is constant (model, section 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax._math import AngleMath
from qocjax.robots.acceleration import Acceleration, accelerated
from qocjax.robots.interface import Command, Piece, Pose, Robot

__all__ = ["Unicycle", "arc", "arc_piece"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Unicycle(Robot):
    """x' = nu cos theta, y' = nu sin theta, theta' = omega.

    Attributes:
        acceleration: Limits on how fast its speeds change; None where it obeys a command at once.
    """

    acceleration: Acceleration | None = None

    left_invariant = True
    motion_model = "DiffDrive"

    @property
    def remembers(self) -> bool:
        """Whether speeds take time to follow a command."""
        return self.acceleration is not None

    def check(self) -> None:
        """Checks the limits.

        Raises:
            TypeError: They are none.
            ValueError: One is zero, of the wrong sign, or no number.
        """
        if self.acceleration is not None:
            if not isinstance(self.acceleration, Acceleration):
                raise TypeError(f"acceleration: got {self.acceleration!r}, expected an Acceleration or None")
            self.acceleration.check()

    def obeyed(self, command: Command) -> Command | None:
        """The command, unless speeds take time to follow it."""
        return command if self.acceleration is None else None

    def move(
        self, pose: Pose, speed: Command | None, command: Command, duration: Array, math: AngleMath
    ) -> Sequence[Piece]:
        """One arc; or, within limits on acceleration, four parts (`qocjax.robots.acceleration`)."""
        if self.acceleration is None:
            return [arc_piece(pose, command, duration, math)]
        assert speed is not None  # as it remembers; for the type checker
        return accelerated(pose, speed, command, duration, self.acceleration, math)


def arc_piece(pose: Pose, command: Command, duration: Array, math: AngleMath) -> Piece:
    """The arc of a constant command as a piece of motion."""
    nu, omega = command.nu, command.omega
    return Piece(
        duration=duration,
        pose=_arc_in_parts(pose, command, duration, math),
        begin=command,
        speed=command,
        length=jnp.abs(duration * nu),
        effort=duration * (nu * nu + omega * omega),
    )


def _arc_in_parts(pose: Pose, command: Command, duration: Array, math: AngleMath) -> Pose:
    """The same as `arc`, in the fewest operations where a compiler computes each coordinate in a loop of its own.

    All four are one product away from the mean heading, sinc(a) (cos, sin)(theta + a), which is computed once:
    cos(theta + 2 a) = cos(theta) - 2 a sinc(a) sin(theta + a).
    """
    a = command.omega * (0.5 * duration)
    sinc, cos_a = math.sinc_cos(a)
    sin_a = a * sinc
    mean_cos = sinc * (pose.cos * cos_a - pose.sin * sin_a)
    mean_sin = sinc * (pose.sin * cos_a + pose.cos * sin_a)
    mean_cos, mean_sin = lax.optimization_barrier((mean_cos, mean_sin))
    chord, turn = command.nu * duration, command.omega * duration
    return Pose(
        x=pose.x + chord * mean_cos,
        y=pose.y + chord * mean_sin,
        cos=pose.cos - turn * mean_sin,
        sin=pose.sin + turn * mean_cos,
        heading=pose.heading + turn,
    )


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
