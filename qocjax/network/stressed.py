"""Networks that became worse: slower, with more losses, with longer bursts, with a slower edge (model, section 4)."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax import _checks
from qocjax.network._fields import store_float
from qocjax.network.completion import completes
from qocjax.network.contention import source_of
from qocjax.network.edge import Edge
from qocjax.network.edge_network import EdgeNetwork, Path, copied_parts
from qocjax.network.interface import Contended, Load, Network, Reliability, Serve, SharedNetwork
from qocjax.network.trace import key_of_copy

__all__ = ["LostTwice", "SlowCompute", "Stressed", "with_lost_twice", "with_slow_compute"]


@jax.tree_util.register_pytree_node_class
@dataclass(frozen=True)
class Stressed:
    """A network that became worse: every loop takes longer, or is lost when a second copy of the network fails too.

    Losses of the copy come as they do in the network itself, in bursts where it has bursts: a lost share p becomes
    1 - (1 - p)², about 2 p. With `hang` each loop time counts for that many ticks, so that bursts last as many times
    longer at the same F. With `miss_deadline` a loop is also lost where its copy misses that deadline: so F becomes F²
    there.
    """

    network: Network
    delay_factor: float = 1.0
    double_losses: bool = False
    hang: int = 1
    miss_deadline: float | None = None  # s

    def __post_init__(self) -> None:
        store_float(self, "delay_factor", above=0.0)
        _checks.count("hang", self.hang)
        if self.miss_deadline is not None:
            store_float(self, "miss_deadline", least=0.0)

    @property
    def name(self) -> str:
        """Name of the network and what happened to it."""
        doubled = ", losses doubled" if self._copied else ""
        longer = f", bursts x {self.hang}" if self.hang > 1 else ""
        return f"{self.network.name}, delay x {self.delay_factor:g}{doubled}{longer}"

    @property
    def drawn_as(self) -> Stressed:
        """A network with the same draws: factors and bursts are no matter of chance."""
        like = source_of(self.network)
        return replace(self, network=like, delay_factor=1.0, hang=1, miss_deadline=None, double_losses=self._copied)

    def tree_flatten(self) -> tuple[tuple[Any, ...], Any]:
        """Numbers, of which one program serves all, and what it is compiled for: a network that has none among it."""
        inner = isinstance(self.network, SharedNetwork)
        children = (self.network if inner else None, self.delay_factor, self.miss_deadline)
        return children, (None if inner else self.network, self.double_losses, self.hang)

    @classmethod
    def tree_unflatten(cls, aux: Any, children: Any) -> Stressed:
        """The network again; within a program its numbers are traced, and so not checked."""
        found = object.__new__(cls)
        values = dict(zip(("network", "delay_factor", "miss_deadline"), children, strict=True))
        values |= {"double_losses": aux[1], "hang": aux[2]}
        for name, value in (values | ({} if aux[0] is None else {"network": aux[0]})).items():
            object.__setattr__(found, name, value)
        return found

    @property
    def uses_deadline(self) -> bool:
        """Whether the network's own loop times depend on the deadline."""
        return bool(getattr(self.network, "uses_deadline", False))

    def draw(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> tuple[Any, Any]:
        """Draws from the network for one Monte Carlo seed, and from its copy where there is one."""
        own = self.network.draw(key, num_ticks, num_robots, tau)
        if not self._copied:
            return own, None
        again = getattr(self.network, "draw_again", None)
        if again is not None:  # what was measured at the same time
            return own, again(key, num_ticks, num_robots, tau)
        return own, self.network.draw(key_of_copy(key), num_ticks, num_robots, tau)

    def contend(self, drawn: tuple[Any, Any], num_ticks: Array | int, tau: Array | float, deadline: Array) -> Contended:
        """Loop times of all seeds at all deadlines; those that stay are the network's own times the factor."""
        own, copy = drawn
        found = self._loops(own, num_ticks, tau, deadline / self.delay_factor)
        times = found.loop_times
        if self._copied:
            other = self._loops(copy, num_ticks, tau, deadline / self.delay_factor).loop_times
            kept = jnp.isfinite(other) if self.miss_deadline is None else completes(other, self.miss_deadline)
            times = jnp.where(kept, times, jnp.inf)
        if self.hang > 1:
            times = times[:, :, jnp.arange(times.shape[2]) // self.hang]
        return found._replace(loop_times=times * self.delay_factor)

    def reliability(self, deadline: Any, load: Load) -> Reliability:
        """Returns F(deadline) under a load."""
        share, error = self.network.reliability(np.asarray(deadline, float) / self.delay_factor, load)
        if not self._copied:
            return Reliability(share, error)
        kept, spread = self.network.reliability(np.inf if self.miss_deadline is None else self.miss_deadline, load)
        return Reliability(share * kept, np.hypot(error * kept, share * spread))

    @property
    def _copied(self) -> bool:
        return self.double_losses or self.miss_deadline is not None

    def _loops(self, drawn: Any, num_ticks: Array | int, tau: Array | float, deadline: Array) -> Contended:
        if isinstance(self.network, SharedNetwork):
            return self.network.contend(drawn, num_ticks, tau, deadline)
        times = jnp.broadcast_to(drawn[None], (deadline.shape[0], *drawn.shape))
        return Contended(times, {}, jnp.full_like(times, jnp.inf), jnp.zeros_like(times))

    def describe(self) -> dict[str, Any]:
        """Returns the network as plain values."""
        own = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "network"}
        return {"kind": "Stressed", "name": self.name} | own | {"network": self.network.describe()}


@dataclass(frozen=True)
class _WorsePath:
    """A path that is worse than another; what it takes from that one."""

    path: Path

    @property
    def alike(self) -> bool:
        """That of the path."""
        return self.path.alike

    @property
    def prefix_stable(self) -> bool:
        """That of the path."""
        return bool(getattr(self.path, "prefix_stable", False))

    def draw_parts(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Any:
        """Those of the path."""
        return self.path.draw_parts(key, num_ticks, num_robots, tau)

    def through(self, parts: Any, serve: Serve, tau: Array | float) -> Array:
        """Loop times [D, S, P, N] s of the loops of some seeds (see `Path`)."""
        raise NotImplementedError

    def draw(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Array:
        """Draws the loop times of one Monte Carlo seed without a limit of workers, [P, N] s."""
        parts = jax.tree.map(lambda leaf: leaf[None], self.draw_parts(key, num_ticks, num_robots, tau))
        return self.through(parts, _at_once, tau)[0, 0]

    def reliability(self, deadline: Any, load: Load) -> Reliability:
        """Estimates F(deadline) by simulating the network alone."""
        return EdgeNetwork(self, Edge()).reliability(deadline, load)  # type: ignore[arg-type]

    def describe(self) -> dict[str, Any]:
        """Returns the network as plain values."""
        own = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "path"}
        return {"kind": type(self).__name__} | own | {"path": self.path.describe()}


def _at_once(uplink: Array, compute: Array) -> Array:
    """An edge without a limit."""
    return (uplink + compute)[None]


@dataclass(frozen=True)
class SlowCompute(_WorsePath):
    """A path whose computations take longer: an edge that is slower or shared, or a heavier controller."""

    factor: float

    def __post_init__(self) -> None:
        store_float(self, "factor", above=0.0)

    @property
    def name(self) -> str:
        """Name of the path and what happened to it."""
        return f"{self.path.name}, computing x {self.factor:g}"

    def through(self, parts: Any, serve: Serve, tau: Array | float) -> Array:
        """Loop times [D, S, P, N] s of the loops of some seeds (see `Path`)."""
        return self.path.through(parts, lambda uplink, compute: serve(uplink, self.factor * compute), tau)


@dataclass(frozen=True)
class LostTwice(_WorsePath):
    """A path that also loses what a second copy of it loses; what a busy edge drops is none of its losses."""

    @property
    def name(self) -> str:
        """Name of the path and what happened to it."""
        return f"{self.path.name}, losses doubled"

    def draw_parts(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Any:
        """Those of the path and of its copy."""
        own = self.path.draw_parts(key, num_ticks, num_robots, tau)
        return own, copied_parts(self.path, key, num_ticks, num_robots, tau)

    def through(self, parts: Any, serve: Serve, tau: Array | float) -> Array:
        """Loop times [D, S, P, N] s of the loops of some seeds (see `Path`)."""
        own, copy = parts
        lost = ~jnp.isfinite(self.path.through(copy, _at_once, tau)[0])
        return self.path.through(own, lambda uplink, compute: serve(jnp.where(lost, jnp.inf, uplink), compute), tau)


def with_lost_twice(network: Network) -> Network:
    """The network with its losses doubled; behind a finite edge those of the path alone."""
    if isinstance(network, EdgeNetwork):
        return EdgeNetwork(LostTwice(network.path), network.edge)
    return Stressed(network, double_losses=True)


def with_slow_compute(network: Network, factor: float) -> Network | None:
    """The network with computations that take longer; None where it does not tell them from the rest of a loop."""
    if isinstance(network, EdgeNetwork):
        return EdgeNetwork(SlowCompute(network.path, factor), network.edge)
    return EdgeNetwork(SlowCompute(network, factor), Edge()) if isinstance(network, Path) else None
