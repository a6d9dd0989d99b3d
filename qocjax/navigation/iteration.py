"""One pass of MPPI: sequences of commands drawn about a mean, rolled out, scored, and averaged by their weights."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax._checks import is_concrete, is_zero
from qocjax.navigation.critics import Ends, Scene
from qocjax.navigation.feasible import driven
from qocjax.navigation.mppi_config import MppiConfig
from qocjax.navigation.noise import normal_row, seed_of
from qocjax.navigation.path_critics import furthest_reached
from qocjax.navigation.rollout import Rolled, roll_out
from qocjax.robots import Command

__all__ = ["Rollouts", "iterate", "weights_of"]


class Rollouts(NamedTuple):
    """What a cycle has looked at, for figures and tests: of the last iteration."""

    cost: Array  # [K]
    weight: Array  # [K] sums to 1
    blocked: Array  # [] whether every rollout collides
    x: Array | None  # [K, H] m, where recorded
    y: Array | None  # [K, H] m


def iterate(
    config: MppiConfig, scene: Scene, pose: Array, mean: Command, key: Array, record: bool
) -> tuple[Command, Rollouts]:
    """Draws, rolls out, scores and averages once.

    Args:
        config: Parameters.
        scene: What all rollouts have in common.
        pose: [3] where they begin (m, m, rad).
        mean: Speeds to draw about, each field [H]; the first ones are those of now.
        key: Random key.
        record: Whether the points of the rollouts are returned.

    Returns:
        The average, each field [H], and what was looked at.
    """
    seeds = [seed_of(each) for each in ((key, jax.random.fold_in(key, 1)) if config.holonomic else (key,))]
    now = jax.tree.map(lambda each: each[0], mean)

    samples = lax.optimization_barrier(_samples(config, now, mean, seeds))  # drawn once, however often it is read
    rolled = roll_out(config, scene, pose, now, samples, record)
    cost, blocked = _scored(config, scene, _control_cost(config, mean, samples), rolled)
    weight = weights_of(cost, config.temperature)
    x, y = rolled.points if rolled.points is not None else (None, None)
    return jax.tree.map(lambda each: each @ weight, samples), Rollouts(cost, weight, blocked, x, y)


def weights_of(cost: Array, temperature: float) -> Array:
    """Importance weights exp(-cost / temperature), normalised; [K] of costs [K]."""
    weight = jnp.exp((jnp.min(cost) - cost) * (1.0 / temperature))
    return weight / jnp.sum(weight)


def _samples(config: MppiConfig, now: Command, mean: Command, seeds: list[Array]) -> Command:
    """Speeds drawn about a sequence, each field [H, K]; row after row, so that the noise never leaves the cache."""
    spread, column = _spread(config), jnp.arange(config.batch_size, dtype=jnp.uint32)

    def row(at: tuple[Array, Command]) -> Command:
        index, middle = at
        pairs = [normal_row(seed, index, column, middle.nu.dtype) for seed in seeds]
        noise = Command(*pairs[0], pairs[1][0] if config.holonomic else None)
        return jax.tree.map(lambda each, std, drawn: each + std * drawn, middle, spread, noise)

    samples = lax.map(row, (jnp.arange(config.time_steps, dtype=jnp.uint32), mean))
    if not config.clamp_raw_controls:
        return samples
    # The last sample is never driven.
    reached = driven(config, now, samples)
    return jax.tree.map(lambda made, drawn: jnp.concatenate([made[:-1], drawn[-1:]]), reached, samples)


def _spread(config: MppiConfig) -> Command:
    """Standard deviations of the samples."""
    return Command(config.vx_std, config.wz_std, config.vy_std if config.holonomic else None)  # type: ignore[arg-type]


def _control_cost(config: MppiConfig, mean: Command, samples: Command) -> Array:
    """γ/σ² Σ u (u_k - u), of all speeds, [K] (Williams et al., 2018, section III-D; optimizer.cpp)."""
    cost = jnp.zeros(samples.nu.shape[1], samples.nu.dtype)
    for each, sample, std in zip(*map(jax.tree.leaves, (mean, samples, _spread(config))), strict=True):
        if not (is_zero(std) or is_zero(config.gamma)):
            drawn = std if is_concrete(std) else jnp.where(std > 0, std, jnp.inf)
            cost = cost + (config.gamma / drawn**2) * (each @ sample - each @ each)
    return cost


def _scored(config: MppiConfig, scene: Scene, cost: Array, rolled: Rolled) -> tuple[Array, Array]:
    """Costs [K], and whether every rollout collides []."""
    end, critics = rolled.pose, config.critics
    furthest = furthest_reached(scene.path, scene.path_spacing, end.x, end.y, rolled.distance)
    ends = Ends(end.x, end.y, furthest, config.time_steps)
    for critic, total in zip(critics, rolled.totals, strict=True):
        cost = cost + critic.cost(total, ends, scene)
    hits = [critic.collides(t) for critic, t in zip(critics, rolled.totals, strict=True) if hasattr(critic, "collides")]
    return cost, jnp.all(jnp.stack(hits).any(axis=0)) if hits else jnp.array(False)
