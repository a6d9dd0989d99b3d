"""What accelerations a robot is taken to be capable of, in rollouts and in the sequence of commands.

As Nav2's `nav2_mppi_controller` has it (motion_models.hpp and optimizer.cpp of its branches lyrical and main): away
from standstill a speed changes by at most `ax_max` per second, towards it by `-ax_min`, a rate of turn by `az_max`
either way.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike

from qocjax.robots import Command

if TYPE_CHECKING:
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
    nu, omega = wanted.nu, wanted.omega
    if config.ax_max is not None or config.ax_min is not None:
        up, down = (jnp.inf if each is None else abs(each) * duration for each in (config.ax_max, config.ax_min))
        if config.ax_max is not None and config.ax_min == -config.ax_max:
            nu = jnp.clip(nu, last.nu - up, last.nu + up)
        else:
            ahead = last.nu > 0
            nu = jnp.clip(nu, last.nu - jnp.where(ahead, down, up), last.nu + jnp.where(ahead, up, down))
    if config.az_max is not None:
        turn = config.az_max * duration
        omega = jnp.clip(omega, last.omega - turn, last.omega + turn)
    return Command(nu, omega)


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
    nu, omega = sent.nu, sent.omega
    if config.ax_min is not None:
        nu = jnp.maximum(nu, speed.nu + config.ax_min * period)
    if config.ax_max is not None:
        nu = jnp.minimum(nu, speed.nu + config.ax_max * period)
    if config.az_max is not None:
        omega = jnp.clip(omega, speed.omega - config.az_max * period, speed.omega + config.az_max * period)
    return Command(nu, omega)


def driven(config: MppiConfig, now: Command, wanted: Command) -> Command:
    """The speeds that a robot reaches on the way through sequences of commands, each field [H, *B] from [H, *B]."""
    if config.ax_max is None and config.ax_min is None and config.az_max is None:
        return wanted

    def advance(last: Command, row: Command) -> tuple[Command, Command]:
        reached = follow(config, last, row, config.model_dt)
        return reached, reached

    begin = Command(*(jnp.broadcast_to(each, wanted.nu.shape[1:]) for each in (now.nu, now.omega)))
    return lax.scan(advance, begin, wanted, unroll=8)[1]


def feasible(
    config: MppiConfig, now: Command, vx: Array, wz: Array, caps: tuple[Array, Array, Array]
) -> tuple[Array, Array]:
    """A sequence [H] within the caps and the limits, that begins with the speeds of now.

    Args:
        config: With the limits.
        now: Where it begins, each field [].
        vx: [H] (m/s).
        wz: [H] (rad/s).
        caps: Smallest and largest speed (m/s), largest rate of turn (rad/s).
    """
    wanted = Command(jnp.clip(vx, caps[0], caps[1]), jnp.clip(wz, -caps[2], caps[2]))
    reached = driven(config, now, Command(wanted.nu.at[0].set(now.nu), wanted.omega.at[0].set(now.omega)))
    return reached.nu, reached.omega
