"""What a robot is: it makes a motion of a command, and a command of a velocity that a law wants (model, section 2)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax._math import AngleMath, at_least, at_most

__all__ = ["Command", "Gains", "Piece", "Pose", "Robot", "pose_from"]


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


def pose_from(start: Array) -> Pose:
    """Pose from start poses [N, 3, *B] (m, m, rad)."""
    x, y, heading = start[:, 0], start[:, 1], start[:, 2]
    return Pose(x, y, jnp.cos(heading), jnp.sin(heading), heading)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Command:
    """Speeds of N robots in any batch `*B`, told or driven: what ROS calls a Twist."""

    nu: Array  # [N, *B] m/s, ahead
    omega: Array  # [N, *B] rad/s
    nu_y: Array | None = None  # [N, *B] m/s, to the left; None of robots that cannot

    def scaled(self, gain: Array | None) -> Command:
        """The command times a gain (None for 1)."""
        return self if gain is None else jax.tree.map(lambda each: each * gain, self)


class Piece(NamedTuple):
    """A piece of a motion, and what it adds to the metrics of a run; each array [N, *B]."""

    duration: Array  # s; broadcastable where robots obey at once
    pose: Pose  # at its end
    begin: Command  # speeds as it begins
    speed: Command  # and at its end
    length: Array  # path length ∫ |velocity| dt (m)
    effort: Array  # control effort, ∫ of the squares of all speeds


class Gains(Protocol):
    """What a robot may read of a design, each broadcastable to [N, *B]."""

    @property
    def v_max(self) -> Any:
        """m/s."""
        ...

    @property
    def omega_max(self) -> Any:
        """rad/s."""
        ...

    @property
    def gamma(self) -> Any:
        """1/s."""
        ...


class Robot(ABC):
    """A kind of robot; a frozen dataclass registered as a pytree, whose numbers may be traced.

    Attributes:
        remembers: Whether its motion depends on the speed at which it drives; else it obeys commands at once.
        left_invariant: Whether its motion, seen from its body, is the same from any pose (left-invariant on SE(2)).
        holonomic: Whether its commands have a speed to the left.
        unread: Values of a design that `steer` does not read.
        motion_model: Of Nav2's MPPI for this robot; None where there is none.
    """

    left_invariant: ClassVar[bool] = False
    holonomic: ClassVar[bool] = False
    unread: ClassVar[tuple[str, ...]] = ()
    motion_model: ClassVar[str | None] = None

    @property
    def remembers(self) -> bool:
        """Whether its motion depends on the speed at which it drives."""
        return False

    def check(self) -> None:  # noqa: B027 (most have nothing to check)
        """Checks its numbers.

        Raises:
            ValueError: One is out of range; the message names it.
        """

    def still(self, pose: Pose) -> Command:
        """A command to stand."""
        nothing = jnp.zeros_like(pose.x)
        return Command(nothing, nothing, nothing if self.holonomic else None)

    def steer(self, v_x: Array, v_y: Array, pose: Pose, gains: Gains, math: AngleMath) -> Command:
        """The command, within the caps, that turns a wanted velocity into motion; here that of a unicycle.

        nu = |v| max(cos e, 0) and omega = gamma e, with e the angle from the heading to v (paper, Eqs. 7 and 8).

        Args:
            v_x: [N, *B] velocity wanted along x (m/s).
            v_y: [N, *B] along y (m/s).
            pose: As sampled.
            gains: Caps and gain of the design.
            math: Functions of angles.
        """
        # |v| cos e and |v| sin e: the desired velocity along and across the heading, so e needs no wrapping.
        along = v_x * pose.cos + v_y * pose.sin
        across = v_y * pose.cos - v_x * pose.sin
        along, across = lax.optimization_barrier((along, across))
        error = math.atan2(across, along)
        nu = at_most(at_least(along, 0.0), gains.v_max)
        omega = at_most(at_least(error * gains.gamma, jnp.negative(gains.omega_max)), gains.omega_max)
        return Command(nu, omega)

    def obeyed(self, command: Command) -> Command | None:
        """The speeds at which it drives all along a command, in one piece; None where only its motion tells."""
        return None

    @abstractmethod
    def move(
        self, pose: Pose, speed: Command | None, command: Command, duration: Array, math: AngleMath
    ) -> Sequence[Piece]:
        """The motion under a constant command, in one piece or several whose durations add up.

        The metrics are exact where the speeds are linear in time over a piece; the reference counts as straight over
        all of them.

        Args:
            pose: Where it begins.
            speed: At which it drives there; None for a robot that remembers nothing.
            command: In force all along.
            duration: h (s), broadcastable to [N, *B].
            math: Functions of angles, made for half turns of up to omega_max h / 2.
        """
