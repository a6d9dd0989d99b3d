"""What a network is to the rest of qocjax, and how the loop times of a study are drawn."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import partial
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax import _checks
from qocjax._room import check_runs

__all__ = [
    "Contended",
    "DelayLaw",
    "Load",
    "LossProcess",
    "Network",
    "Reliability",
    "Serve",
    "SharedNetwork",
    "exactly",
    "general_length",
    "loop_times",
]


class Load(NamedTuple):
    """What a network has to carry: N robots, each of which starts a loop every tau, P times."""

    num_ticks: int
    num_robots: int
    tau: float  # s


class Reliability(NamedTuple):
    """Loop-completion probability F with its standard error, float64, each of the shape of the deadlines."""

    share: np.ndarray
    error: np.ndarray  # 0 where F is known from a law, and not from simulated loops


def exactly(share: np.ndarray) -> Reliability:
    """F without an error."""
    return Reliability(share, np.zeros(np.shape(share)))


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
class Network(Hashable, Protocol):
    """Where loop times come from (model, section 4).

    One object stands for the whole path of a loop: the two directions and the compute between them. It may be a
    distribution, a recording or a simulated transport whose state runs across ticks: `draw` makes all the ticks of a
    Monte Carlo seed at once, so what happens between ticks is the network's own affair.

    Implementations are immutable and hashable, so that `jax.jit` can hold them as static arguments. One whose row p
    depends neither on `num_ticks` nor on `tau` may say so by an attribute `prefix_stable = True`: fewer programs are
    then compiled to draw from it. One whose loop times were worked out beforehand may give them to batches by
    `given(seeds, key, num_ticks, num_robots)`, arrays [S, P, N] of NumPy: no program is then compiled for it. One in
    which loops get into each other's way is a `SharedNetwork`.
    """

    @property
    def name(self) -> str:
        """Short name for labels and file names."""
        ...

    def draw(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Any:
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

    def reliability(self, deadline: Any, load: Load) -> Reliability:
        """Returns the loop-completion probability F(deadline) (paper, Eq. 12) under a load.

        Args:
            deadline: Deadlines in s, any shape.
            load: What the network carries. A network of which loops do not get into each other's way need not read it.
        """
        ...

    def describe(self) -> dict[str, Any]:
        """Returns the network as plain values, to be written with results."""
        ...


Serve = Callable[[Array, Array], Array]
"""Arrival at the edge and computing time, [S, P, N] s each, to the end of the computation, [D, S, P, N] s."""


class Contended(NamedTuple):
    """What becomes of the loops of some seeds at some deadlines."""

    loop_times: Array  # [D, S, P, N] s, inf for a lost loop
    usage: dict[str, Array]  # [D, S] of each thing that is scarce, the share of it that is in use within the run
    began: Array  # [D, S, P, N] s from sampling until the computation begins, inf where none does
    busy: Array  # [D, S, P, N] s that a worker spends on it


@runtime_checkable
class SharedNetwork(Network, Protocol):
    """A network whose loops compete for workers or for the air (model, sections 12 and 13).

    It comes in two steps. `draw` gives what chance alone decides, as a pytree of arrays in place of the loop times:
    designs of one tau share it, whatever else differs. `contend` works out what becomes of the loops. Where that does
    not depend on the deadline (`uses_deadline` is false) it is done once for all deadlines, so that designs of one tau
    share the loop times too.
    """

    @property
    def uses_deadline(self) -> bool:
        """Whether loop times depend on the deadline."""
        ...

    def contend(self, drawn: Any, num_ticks: Array | int, tau: Array | float, deadline: Array) -> Contended:
        """Works out the loops of all seeds at all deadlines; works under `jax.jit`, where all arguments may be traced.

        Args:
            drawn: From `draw`, for each seed: every leaf has an axis [S] before its own. It may hold more ticks.
            num_ticks: P; loops from there on are not started, and their times are infinite.
            tau: Sampling period (s).
            deadline: [D] s.
        """
        ...


def general_length(ticks: int, least: int = 2048) -> int:
    """Ticks of the general program that draws or simulates a run of that many; `least` is those of the shortest."""
    length = least
    while length < ticks:
        length *= 2
    return length


def loop_times(
    network: Network, keys: Array, num_ticks: int, num_robots: int, tau: float, deadline: float | None = None
) -> Array:
    """Draws the loop times of a study, once for all its designs (common random numbers; model, section 4).

    Row s depends on `keys[s]` alone, so a Monte Carlo seed is the same whichever seeds are drawn with it.

    Args:
        network: Where the loop times come from.
        keys: Typed random keys, one for each Monte Carlo seed, [S].
        num_ticks: Number P of loops started by each robot.
        num_robots: Number N of robots.
        tau: Sampling period in s.
        deadline: Delta in s, for a network whose loop times depend on it.

    Returns:
        Loop times T_net in s, [S, P, N], infinite for a lost loop.

    Raises:
        TypeError: `keys` are no typed keys, or a count is no whole number.
        ValueError: `keys` is not 1-D, a count is below 1, `tau` is not positive and finite, or there is no deadline
            where the loop times depend on it.
    """
    if not (hasattr(keys, "dtype") and jnp.issubdtype(keys.dtype, jax.dtypes.prng_key)):
        raise TypeError(f"keys: got {type(keys).__name__} of no key type, expected typed keys, as of jax.random.key")
    if keys.ndim != 1:
        raise ValueError(f"keys: got shape {keys.shape}, expected one key for each seed, (S,)")
    ticks, robots = _checks.count("num_ticks", num_ticks), _checks.count("num_robots", num_robots)
    check_runs(ticks, robots, keys.size)
    period = float(_checks.bounded("tau", tau, above=0.0))
    if deadline is None and getattr(network, "uses_deadline", False):
        raise ValueError(f"deadline: got None for {network.name!r}, whose loop times depend on it, expected s")
    at = jnp.asarray([0.0 if deadline is None else _checks.bounded("deadline", deadline, least=0.0, shape=())], float)
    return _draw_seeds(network, keys, at, ticks, robots, period)


@partial(jax.jit, static_argnames=("network", "num_ticks", "num_robots", "tau"))
def _draw_seeds(network: Network, keys: Array, deadline: Array, num_ticks: int, num_robots: int, tau: float) -> Array:
    drawn = jax.vmap(lambda key: network.draw(key, num_ticks, num_robots, tau))(keys)
    if not isinstance(network, SharedNetwork):
        return drawn
    return network.contend(drawn, num_ticks, tau, deadline).loop_times[0]
