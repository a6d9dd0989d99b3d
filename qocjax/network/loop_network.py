"""A network of independent legs: T_net = T_UL + T_C + T_DL (paper, Eq. 11; model, section 4)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jax import Array

from qocjax.network._fields import no_nan
from qocjax.network.completion import latest
from qocjax.network.convolution import DelaySum, add
from qocjax.network.interface import DelayLaw, Load, LossProcess, Reliability, Serve, exactly
from qocjax.network.loss import IndependentLoss
from qocjax.network.parametric import Constant

__all__ = ["Leg", "LoopNetwork"]


@dataclass(frozen=True)
class Leg:
    """One direction: how long a message takes, and whether it is lost, independently of each other."""

    delay: DelayLaw = field(default_factory=Constant)
    loss: LossProcess = field(default_factory=IndependentLoss)

    def __post_init__(self) -> None:
        if not isinstance(self.delay, DelayLaw):
            raise TypeError(f"Leg.delay: got {self.delay!r}, expected a delay law")
        if not isinstance(self.loss, LossProcess):
            raise TypeError(f"Leg.loss: got {self.loss!r}, expected a loss process")

    def sample(self, key: Array, num_ticks: int, num_robots: int) -> Array:
        """Draws the delays of one direction, [P, N] s, inf for a lost message."""
        of_delay, of_loss = jax.random.split(key)
        delay = self.delay.sample(of_delay, (num_ticks, num_robots))
        return jnp.where(self.loss.sample(of_loss, num_ticks, num_robots), jnp.inf, delay)

    def describe(self) -> dict[str, Any]:
        """Returns the leg as plain values."""
        return {"delay": self.delay.describe(), "loss": self.loss.describe()}


@dataclass(frozen=True, kw_only=True)
class LoopNetwork:
    """Loops of an uplink, a computation and a downlink, all independent, and independent between robots and ticks.

    Only a loss process may correlate the ticks. A law of whole loop times goes in as `compute`, between the default
    legs, which take no time and lose nothing.
    """

    uplink: Leg = field(default_factory=Leg)
    compute: DelayLaw
    downlink: Leg = field(default_factory=Leg)
    name: str

    prefix_stable: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for leg in ("uplink", "downlink"):
            if not isinstance(getattr(self, leg), Leg):
                raise TypeError(f"LoopNetwork.{leg}: got {getattr(self, leg)!r}, expected a Leg(delay, loss)")
        if not isinstance(self.compute, DelayLaw):
            raise TypeError(f"LoopNetwork.compute: got {self.compute!r}, expected a delay law")

    @property
    def alike(self) -> bool:
        """Whether all samples that arrive at the edge take the same time to."""
        return isinstance(self.uplink.delay, Constant)

    def draw_parts(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> tuple[Array, Array, Array]:
        """Draws T_UL, T_C and T_DL of one Monte Carlo seed, each [P, N] s; `tau` does not matter here."""
        up, compute, down = jax.random.split(key, 3)
        return (
            self.uplink.sample(up, num_ticks, num_robots),
            self.compute.sample(compute, (num_ticks, num_robots)),
            self.downlink.sample(down, num_ticks, num_robots),
        )

    def through(self, parts: tuple[Array, Array, Array], serve: Serve, tau: Array | float) -> Array:
        """Loop times [D, S, P, N] s of loops that are served by an edge (see `Path` in `edge_network`)."""
        uplink, compute, downlink = parts
        return serve(uplink, compute) + downlink[None]

    def draw(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Array:
        """Draws the loop times of one Monte Carlo seed, [P, N] s, inf where lost; `tau` does not matter here."""
        uplink, compute, downlink = self.draw_parts(key, num_ticks, num_robots, tau)
        return uplink + compute + downlink

    def reliability(self, deadline: Any, load: Load | None = None) -> Reliability:
        """Returns F(deadline), the share of loops that complete; it does not depend on the load.

        Exact where at most one delay is random, else to 1e-4 for laws with a smooth density (see `convolution.add`).

        Raises:
            ValueError: A deadline is NaN.
        """
        arrive = (1.0 - self.uplink.loss.probability) * (1.0 - self.downlink.loss.probability)
        return exactly(arrive * self._loop_law.cdf(latest(no_nan("deadline", deadline))))

    def describe(self) -> dict[str, Any]:
        """Returns the network as plain values."""
        return {
            "kind": type(self).__name__,
            "name": self.name,
            "uplink": self.uplink.describe(),
            "compute": self.compute.describe(),
            "downlink": self.downlink.describe(),
        }

    @cached_property
    def _loop_law(self) -> DelaySum:
        return add([self.uplink.delay, self.compute, self.downlink.delay])
