"""The car: a bicycle whose front wheel steers up to a limit, about the middle of its rear axle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from qocjax import _checks
from qocjax._math import AngleMath
from qocjax.robots.interface import Command, Gains, Piece, Pose, Robot
from qocjax.robots.unicycle import arc_piece

__all__ = ["Ackermann"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Ackermann(Robot):
    """x' = nu cos theta, y' = nu sin theta, theta' = nu tan(delta) / wheelbase, |delta| <= max_steering.

    Commands are a speed and a turn rate, as those of Nav2's Ackermann; the steering angle delta follows at once. While
    both are constant so is delta, and the car drives an arc of radius `min_turning_r` or more; a turn rate that would
    need a tighter one is cut to |nu| / min_turning_r.

    Attributes:
        wheelbase: Between the axles (m).
        max_steering: Largest steering angle, below a quarter turn (rad).
    """

    wheelbase: ArrayLike = 0.1155
    max_steering: ArrayLike = 0.5236

    left_invariant = True
    motion_model = "Ackermann"

    @property
    def min_turning_r(self) -> ArrayLike:
        """Radius of the tightest circle of the rear axle (m), wheelbase / tan(max_steering)."""
        angle = self.max_steering
        return self.wheelbase / (np.tan(angle) if _checks.is_concrete(angle) else jnp.tan(angle))

    def check(self) -> None:
        """Checks the numbers.

        Raises:
            ValueError: One is out of range.
        """
        _checks.bounded("wheelbase", self.wheelbase, above=0, shape=())
        _checks.bounded("max_steering", self.max_steering, above=0, most=1.5, shape=())

    def steer(self, v_x: Array, v_y: Array, pose: Pose, gains: Gains, math: AngleMath) -> Command:
        """Towards the velocity, or backwards with the rear towards it, whichever takes the smaller turn.

        With e the angle from the heading to v: nu = |v| cos e and omega = gamma e', where e' is e, or where v lies
        behind e - pi or e + pi. A car cannot turn where it stands, so it backs up.
        """
        along = v_x * pose.cos + v_y * pose.sin
        across = v_y * pose.cos - v_x * pose.sin
        error = math.atan2(jnp.where(along < 0.0, -across, across), jnp.abs(along))
        nu = jnp.clip(along, jnp.negative(gains.v_max), gains.v_max)
        omega = jnp.clip(error * gains.gamma, jnp.negative(gains.omega_max), gains.omega_max)
        return self.within(Command(nu, omega))

    def within(self, command: Command) -> Command:
        """The command with the turn rate that the steering allows at its speed."""
        most = jnp.abs(command.nu) * (1.0 / jnp.asarray(self.min_turning_r))
        return Command(command.nu, jnp.clip(command.omega, -most, most))

    def obeyed(self, command: Command) -> Command:
        """The command within what the steering allows."""
        return self.within(command)

    def move(
        self, pose: Pose, speed: Command | None, command: Command, duration: Array, math: AngleMath
    ) -> Sequence[Piece]:
        """One arc."""
        return [arc_piece(pose, self.within(command), duration, math)]
