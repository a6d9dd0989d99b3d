"""What accelerations a robot is taken to be capable of, in rollouts and in the sequence of commands.

As Nav2's `nav2_mppi_controller` has it (motion_models.hpp and optimizer.cpp of its branches lyrical and main): away
from standstill a speed changes by at most `ax_max` per second, towards it by `-ax_min`, a rate of turn by `az_max`
either way.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike

from qocjax.robots import Command

if TYPE_CHECKING:
    from qocjax.navigation.critics import Scene
    from qocjax.navigation.mppi_config import MppiConfig

__all__ = ["driven", "feasible", "follow", "speed_now"]


def follow(config: MppiConfig, last: Command, wanted: Command, duration: ArrayLike) -> Command:
    """The speeds that a robot reaches on the way to those wanted.

    Args:
        config: With the limits.
        last: Speeds before, each field [...].
        wanted: Speeds to reach, likewise.
        duration: In which to reach them (s).
    """
    nu, omega, nu_y = wanted.nu, wanted.omega, wanted.nu_y
    nu = _followed(last.nu, nu, config.ax_max, config.ax_min, duration)
    if config.az_max is not None:
        turn = config.az_max * duration
        omega = jnp.clip(omega, last.omega - turn, last.omega + turn)
    if nu_y is not None and last.nu_y is not None:
        nu_y = _followed(last.nu_y, nu_y, config.ay_max, config.ay_min, duration)
    return Command(nu, omega, nu_y)


def _followed(last: Array, wanted: Array, most: float | None, least: float | None, duration: ArrayLike) -> Array:
    """A speed on the way to another, within the limits away from standstill and towards it (m/s²)."""
    if most is None and least is None:
        return wanted
    up, down = (jnp.inf if each is None else abs(each) * duration for each in (most, least))
    if most is not None and least == -most:
        return jnp.clip(wanted, last - up, last + up)
    ahead = last > 0
    return jnp.clip(wanted, last - jnp.where(ahead, down, up), last + jnp.where(ahead, up, down))


def speed_now(config: MppiConfig, sent: Command, speed: Command | None, period: ArrayLike) -> Command:
    """The speeds at which rollouts begin: those last sent, as near as the robot can come to them in a cycle.

    Args:
        config: With the limits.
        sent: The command sent last, each field [].
        speed: Of the robot, likewise; None to take it to be at those sent.
        period: Of the cycle (s).
    """
    if speed is None:
        return sent
    nu, omega, nu_y = sent.nu, sent.omega, sent.nu_y
    nu = _reachable(nu, speed.nu, config.ax_max, config.ax_min, period)
    if config.az_max is not None:
        omega = jnp.clip(omega, speed.omega - config.az_max * period, speed.omega + config.az_max * period)
    if nu_y is not None and speed.nu_y is not None:
        nu_y = _reachable(nu_y, speed.nu_y, config.ay_max, config.ay_min, period)
    return Command(nu, omega, nu_y)


def _reachable(sent: Array, speed: Array, most: float | None, least: float | None, period: ArrayLike) -> Array:
    if least is not None:
        sent = jnp.maximum(sent, speed + least * period)
    return sent if most is None else jnp.minimum(sent, speed + most * period)


def driven(config: MppiConfig, now: Command, wanted: Command) -> Command:
    """The speeds that a robot reaches on the way through sequences of commands, each field [H, *B] from [H, *B]."""
    limits = (
        config.ax_max,
        config.ax_min,
        config.az_max,
        *((config.ay_max, config.ay_min) if config.holonomic else ()),
    )
    if all(each is None for each in limits):
        return wanted

    def advance(last: Command, row: Command) -> tuple[Command, Command]:
        reached = follow(config, last, row, config.model_dt)
        return reached, reached

    begin = jax.tree.map(lambda each: jnp.broadcast_to(each, wanted.nu.shape[1:]), now)
    return lax.scan(advance, begin, wanted, unroll=8)[1]


def feasible(config: MppiConfig, now: Command, wanted: Command, scene: Scene) -> Command:
    """A sequence, each field [H], within the caps and the limits, that begins with the speeds of now.

    Of Ackermann the rate of turn is cut last of all to what its speed allows (motion_models.hpp).

    Args:
        config: With the limits.
        now: Where it begins, each field [].
        wanted: Each field [H].
        scene: With the caps.
    """
    nu, omega = jnp.clip(wanted.nu, scene.vx_min, scene.vx_max), jnp.clip(wanted.omega, -scene.wz_max, scene.wz_max)
    nu_y = None if wanted.nu_y is None else jnp.clip(wanted.nu_y, -scene.vy_max, scene.vy_max)
    within = jax.tree.map(lambda each, first: each.at[0].set(first), Command(nu, omega, nu_y), now)
    reached = driven(config, now, within)
    if config.motion_model != "Ackermann":
        return reached
    most = jnp.abs(reached.nu) * (1.0 / config.min_turning_r)
    return Command(reached.nu, jnp.clip(reached.omega, -most, most))
