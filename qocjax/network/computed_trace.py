"""A measured network with a computation within each round trip: what a log of the network alone does not hold."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
from jax import Array

from qocjax.network._fields import no_nan
from qocjax.network.completion import latest
from qocjax.network.convolution import DelaySum, add
from qocjax.network.empirical import Empirical
from qocjax.network.interface import DelayLaw, Load, Reliability, Serve, exactly
from qocjax.network.trace import Trace, key_of_copy

__all__ = ["ComputedTrace"]


@dataclass(frozen=True, eq=False)
class ComputedTrace:
    """Round trips of the network as they were measured, in order, each with a computing time of its own.

    T_net = T_UL + T_C + T_DL (paper, Eq. 11), where the trace holds T_UL + T_DL. It does not tell these apart: half of
    a round trip counts as the way up, which decides no more than when a sample meets a busy edge.

    Attributes:
        trace: T_UL + T_DL (s).
        compute: Law of T_C (s), independent of the trace and from loop to loop.
    """

    trace: Trace
    compute: DelayLaw

    def __post_init__(self) -> None:
        if not isinstance(self.trace, Trace):
            raise TypeError(f"ComputedTrace.trace: got {self.trace!r}, expected a Trace")
        if not isinstance(self.compute, DelayLaw):
            raise TypeError(f"ComputedTrace.compute: got {self.compute!r}, expected a delay law")

    @property
    def name(self) -> str:
        """That of the trace."""
        return self.trace.name

    @property
    def alike(self) -> bool:
        """Whether all samples that arrive at the edge take the same time to: no."""
        return False

    def draw_parts(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> tuple[Array, Array]:
        """Draws round trips and computing times of one Monte Carlo seed, each [P, N] s."""
        return self.trace.draw(key, num_ticks, num_robots, tau), self._computing(key, num_ticks, num_robots)

    def draw_parts_again(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> tuple[Array, Array]:
        """As `draw_parts`, of a copy of the network at the same time (see `Trace.draw_again`)."""
        round_trip = self.trace.draw_again(key, num_ticks, num_robots, tau)
        return round_trip, self._computing(key_of_copy(key), num_ticks, num_robots)

    def through(self, parts: tuple[Array, Array], serve: Serve, tau: Array | float) -> Array:
        """Loop times [D, S, P, N] s of loops that are served by an edge (see `Path` in `edge_network`)."""
        way = 0.5 * parts[0]
        return serve(way, parts[1]) + way[None]

    def draw(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Array:
        """Draws the loop times of one Monte Carlo seed without a limit of workers, [P, N] s, inf where lost."""
        round_trip, compute = self.draw_parts(key, num_ticks, num_robots, tau)
        return round_trip + compute

    def draw_again(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Array:
        """As `draw`, of a copy of the network at the same time."""
        round_trip, compute = self.draw_parts_again(key, num_ticks, num_robots, tau)
        return round_trip + compute

    def reliability(self, deadline: Any, load: Load | None = None) -> Reliability:
        """Returns F(deadline), the share of loops that complete without a limit of workers, whatever the load.

        Raises:
            ValueError: A deadline is NaN.
        """
        return exactly(self._loop_law.cdf(latest(no_nan("deadline", deadline))))

    def describe(self) -> dict[str, Any]:
        """Returns the network as plain values: those of the trace, and the law of the computation."""
        return self.trace.describe() | {"kind": type(self).__name__, "compute": self.compute.describe()}

    def _computing(self, key: Array, num_ticks: int, num_robots: int) -> Array:
        return self.compute.sample(jax.random.fold_in(key, 104729), (num_ticks, num_robots))  # no key of the trace's

    @cached_property
    def _loop_law(self) -> DelaySum:
        return add([Empirical(self.trace.delays), self.compute])
