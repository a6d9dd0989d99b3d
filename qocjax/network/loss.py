"""Which messages are lost: independently, or in bursts (Gilbert-Elliott)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax import _draws
from qocjax.network._fields import plain, store_float

__all__ = ["GilbertElliott", "IndependentLoss"]


@dataclass(frozen=True)
class IndependentLoss:
    """Every message is lost with the same probability, whatever happened to the others."""

    probability: float = 0.0

    def __post_init__(self) -> None:
        store_float(self, "probability", least=0.0, most=1.0)

    def sample(self, key: Array, num_ticks: int, num_robots: int) -> Array:
        """Draws which messages are lost: booleans [P, N]."""
        if self.probability == 0.0:
            return jnp.zeros((num_ticks, num_robots), bool)
        return _draws.bernoulli(key, self.probability, (num_ticks, num_robots))

    def chance(self, key: Array, num_ticks: int, num_robots: int) -> Array:
        """Returns the loss probability of whatever is sent within each sampling period, [P, N]."""
        return jnp.full((num_ticks, num_robots), self.probability, jnp.result_type(float))

    def describe(self) -> dict[str, Any]:
        """Returns the process as plain values."""
        return plain(self)


@dataclass(frozen=True)
class GilbertElliott:
    """A channel that is good or bad, a two-state Markov chain over the messages; each state has its own loss.

    One step of the chain per message, that is per sampling period: the mean length of a bad spell is
    `1 / p_bad_to_good` messages. The chain starts in its stationary distribution, each robot has its own.
    """

    p_good_to_bad: float
    p_bad_to_good: float
    loss_good: float = 0.0
    loss_bad: float = 1.0

    def __post_init__(self) -> None:
        for name in ("p_good_to_bad", "p_bad_to_good", "loss_good", "loss_bad"):
            store_float(self, name, least=0.0, most=1.0)
        if self.p_good_to_bad + self.p_bad_to_good == 0.0:
            raise ValueError("GilbertElliott: got p_good_to_bad = p_bad_to_good = 0, expected at least one above 0")

    @property
    def bad_share(self) -> float:
        """Stationary probability of the bad state."""
        return self.p_good_to_bad / (self.p_good_to_bad + self.p_bad_to_good)

    @property
    def probability(self) -> float:
        """Stationary probability that a message is lost."""
        return self.loss_good + self.bad_share * (self.loss_bad - self.loss_good)

    def sample(self, key: Array, num_ticks: int, num_robots: int) -> Array:
        """Draws which messages are lost: booleans [P, N], correlated along the ticks."""
        levels = _draws.uniform(jax.random.split(key, 3)[2], (num_ticks, num_robots))
        return levels < self.chance(key, num_ticks, num_robots)

    def chance(self, key: Array, num_ticks: int, num_robots: int) -> Array:
        """Draws the state of the channel, as the loss probability of whatever is sent within each period, [P, N]."""
        of_start, of_steps, _ = jax.random.split(key, 3)
        dtype = jnp.result_type(float)
        steps = _draws.uniform(of_steps, (num_ticks, num_robots))
        start = _draws.bernoulli(of_start, self.bad_share, (num_robots,))

        def step(bad: Array, level: Array) -> tuple[Array, Array]:
            then = jnp.where(bad, level >= self.p_bad_to_good, level < self.p_good_to_bad)
            return then, bad

        _, bad = lax.scan(step, start, steps)
        return jnp.where(bad, self.loss_bad, self.loss_good).astype(dtype)

    def describe(self) -> dict[str, Any]:
        """Returns the process as plain values."""
        return plain(self)
