"""What Monte Carlo seeds fix: start poses, what chance decides of the network, keys; and the loop times that follow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from qocjax import _draws
from qocjax._kept import called
from qocjax._room import check_runs
from qocjax.network.contention import contended_times
from qocjax.network.interface import Network, SharedNetwork

__all__ = ["NOTHING", "Chance", "draw_seeds", "drawn", "loops_of"]


class Chance(NamedTuple):
    """What Monte Carlo seeds fix, whatever the design."""

    start: Array  # [S, N, 3] start poses
    network: Any  # loop times [S, P, N] s; of a `SharedNetwork` what `contend` makes them from
    keys: Array  # [S, 2] words of a random key, for controllers that draw


@dataclass(frozen=True)
class _Nothing:
    """Stands for a network whose loop times are known, where the rest is drawn."""

    prefix_stable = True

    def draw(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Array:
        """No loop time."""
        return jnp.zeros(0)


NOTHING: Any = _Nothing()


def drawn(
    start: Array,
    seeds: Array,
    key: int | Array,
    jitter: tuple[float, float],
    network: Network,
    num_ticks: int,
    tau: float,
) -> Chance:
    """Draws what Monte Carlo seeds fix; a seed's draws do not depend on which others are drawn with it.

    Args:
        start: [N, 3] nominal start poses.
        seeds: [S] whole numbers.
        key: Root of all random numbers.
        jitter: Standard deviation of position (m) and heading (rad) (model, section 1).
        network: Where loop times come from.
        num_ticks: P.
        tau: Sampling period (s).

    Returns:
        Start poses and loop times in JAX's default float type, and words of keys.
    """
    spread = jnp.asarray([jitter[0], jitter[0], jitter[1]], start.dtype)
    root = jax.random.key(key)

    def draw(seed: Array) -> Chance:
        of_seed = jax.random.fold_in(root, seed)
        of_start, of_network = jax.random.split(of_seed)
        noise = _draws.normal(of_start, start.shape)
        drawn = network.draw(of_network, num_ticks, start.shape[0], tau)
        return Chance(start + noise * spread[None, :], drawn, jax.random.key_data(jax.random.fold_in(of_seed, 2)))

    return jax.vmap(draw)(seeds)


def draw_seeds(
    start: ArrayLike,
    jitter: tuple[float, float],
    network: Network,
    seeds: ArrayLike,
    key: int,
    num_ticks: int,
    tau: float,
) -> Chance:
    """What `drawn` draws, compiled."""
    check_runs(num_ticks, np.shape(start)[0], np.size(seeds))
    args = (start, np.asarray(seeds), np.int32(key))
    return called(drawn, args, (jitter, network, num_ticks, tau))


def loops_of(network: Network, drawn: Any, num_ticks: int, tau: float, deadline: float) -> Array:
    """Loop times [S, P, N] s at one deadline, whatever the network."""
    if not isinstance(network, SharedNetwork):
        return drawn
    return contended_times(network, drawn, num_ticks, tau, [deadline])[0]
