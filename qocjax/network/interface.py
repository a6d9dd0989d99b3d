"""What a network is to the rest of qocjax, and how the loop times of a study are drawn."""

from __future__ import annotations

from functools import partial
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax import _checks

__all__ = ["DelayLaw", "LossProcess", "Network", "loop_times"]


@runtime_checkable
class DelayLaw(Protocol):
    """Distribution of one delay in s. Implementations are immutable and hashable."""

    def sample(self, key: Array, shape: tuple[int, ...]) -> Array:
        """Draws independent delays in s, JAX's default float type, infinite for a lost message."""
        ...

    def cdf(self, delay: Any) -> np.ndarray:
        """Returns P(delay of the law <= `delay`) in float64, the shape of `delay` (s)."""
        ...

    def quantile(self, probability: Any) -> np.ndarray:
        """Returns the smallest delay in s whose CDF reaches `probability`, float64, same shape."""
        ...

    def describe(self) -> dict[str, Any]:
        """Returns the law as plain values, to be written with results."""
        ...


@runtime_checkable
class LossProcess(Protocol):
    """Which messages of one direction are lost. Implementations are immutable and hashable."""

    @property
    def probability(self) -> float:
        """Stationary probability that a message is lost."""
        ...

    def sample(self, key: Array, num_ticks: int, num_robots: int) -> Array:
        """Draws which messages are lost: booleans [P, N], independent between robots."""
        ...

    def describe(self) -> dict[str, Any]:
        """Returns the process as plain values, to be written with results."""
        ...


@runtime_checkable
class Network(Protocol):
    """Where loop times come from (model, section 4).

    One object stands for the whole path of a loop: the two directions and the compute between them. It may be a
    distribution, a recording or a simulated transport whose state runs across ticks: `draw` makes all the ticks of a
    Monte Carlo seed at once, so what happens between ticks is the network's own affair.

    Implementations are immutable and hashable, so that `jax.jit` can hold them as static arguments. One whose row p
    depends neither on `num_ticks` nor on `tau` may say so by an attribute `prefix_stable = True`: fewer programs are
    then compiled to draw from it.
    """

    @property
    def name(self) -> str:
        """Short name for labels and file names."""
        ...

    def draw(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Array:
        """Draws the loop times of one Monte Carlo seed.

        A pure function of its arguments that works under `jax.jit` and, over `key`, under `jax.vmap`. All arguments
        but the key are Python numbers, static under jit.

        Args:
            key: Random key of the seed.
            num_ticks: Number P of loops started by each robot.
            num_robots: Number N of robots.
            tau: Sampling period in s, the time between two loops of a robot.

        Returns:
            Loop times T_net in s, [P, N], JAX's default float type, infinite for a lost loop.
        """
        ...

    def reliability(self, deadline: Any) -> np.ndarray:
        """Returns the loop-completion probability F(deadline) (paper, Eq. 12).

        Args:
            deadline: Deadlines in s, any shape.

        Returns:
            Probabilities in float64, the shape of `deadline`.
        """
        ...

    def describe(self) -> dict[str, Any]:
        """Returns the network as plain values, to be written with results."""
        ...


def loop_times(network: Network, keys: Array, num_ticks: int, num_robots: int, tau: float) -> Array:
    """Draws the loop times of a study, once for all its designs (common random numbers; model, section 4).

    Row s depends on `keys[s]` alone, so a Monte Carlo seed is the same whichever seeds are drawn with it.

    Args:
        network: Where the loop times come from.
        keys: Typed random keys, one for each Monte Carlo seed, [S].
        num_ticks: Number P of loops started by each robot.
        num_robots: Number N of robots.
        tau: Sampling period in s.

    Returns:
        Loop times T_net in s, [S, P, N], infinite for a lost loop.

    Raises:
        TypeError: `keys` are no typed keys, or a count is no whole number.
        ValueError: `keys` is not 1-D, a count is below 1, or `tau` is not positive and finite.
    """
    if not (hasattr(keys, "dtype") and jnp.issubdtype(keys.dtype, jax.dtypes.prng_key)):
        raise TypeError(f"keys: got {type(keys).__name__} of no key type, expected typed keys, as of jax.random.key")
    if keys.ndim != 1:
        raise ValueError(f"keys: got shape {keys.shape}, expected one key for each seed, (S,)")
    ticks, robots = _checks.count("num_ticks", num_ticks), _checks.count("num_robots", num_robots)
    return _draw_seeds(network, keys, ticks, robots, float(_checks.bounded("tau", tau, above=0.0)))


@partial(jax.jit, static_argnames=("network", "num_ticks", "num_robots", "tau"))
def _draw_seeds(network: Network, keys: Array, num_ticks: int, num_robots: int, tau: float) -> Array:
    return jax.vmap(lambda key: network.draw(key, num_ticks, num_robots, tau))(keys)
