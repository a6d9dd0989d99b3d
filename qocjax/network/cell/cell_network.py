"""The network `cell`: robots that share the air of one 5G cell, and an edge behind it (model, section 13)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from qocjax import _checks, _draws
from qocjax.network._fields import plain, store_float
from qocjax.network.cell.air import through_air
from qocjax.network.cell.direction import Access, Direction
from qocjax.network.cell.frame import Frame
from qocjax.network.cell.traffic import Capacity
from qocjax.network.edge import Edge
from qocjax.network.edge_network import edge_usage
from qocjax.network.estimate import simulated
from qocjax.network.interface import Contended, DelayLaw, Load, Reliability
from qocjax.network.parametric import Constant
from qocjax.scenario import _pytree

__all__ = ["CellNetwork"]

_FIXED = {"static": True}  # what a program is compiled for


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Chances:
    """What chance decides of one seed."""

    compute: Array  # [P, N] s
    request: Array  # [P, N] wait for the next instant to ask, of its period
    uplink: tuple[Array, Array]  # failed transmissions [P, N]; slots in bursts
    downlink: tuple[Array, Array]


@_pytree
@dataclass(frozen=True, kw_only=True)
class CellNetwork:
    """One bandwidth part for all robots; each direction first come first served; the edge in between.

    Attributes:
        uplink: Samples.
        downlink: Commands.
        compute: Law of a computation.
        frame: Slots and the direction of each.
        access: How a robot comes to send; commands need no grant.
        stagger: Whether robot i samples i tau / N later, so that not all send at once. Loop times count from p tau.
        harq_rtt: From the end of a failed transmission to that of its repetition (s).
        harq_max: Transmissions after which a message is lost.
        core: Constant delay of each direction beyond the air (s).
        edge: The workers.
        name: For labels.
    """

    uplink: Direction
    downlink: Direction
    compute: DelayLaw = field(default_factory=Constant, metadata=_FIXED)
    frame: Frame = field(default=Frame(), metadata=_FIXED)
    access: Access = field(default=Access(), metadata=_FIXED)
    stagger: bool = field(default=False, metadata=_FIXED)
    harq_rtt: float = field(default=7.5e-3, metadata=_FIXED)
    harq_max: int = field(default=4, metadata=_FIXED)
    core: float = field(default=0.0, metadata=_FIXED)
    edge: Edge = Edge()
    name: str = field(default="cell", metadata=_FIXED)

    def __post_init__(self) -> None:
        store_float(self, "harq_rtt", least=0.0)
        store_float(self, "core", least=0.0)
        object.__setattr__(self, "harq_max", _checks.count("CellNetwork.harq_max", self.harq_max))
        if not isinstance(self.compute, DelayLaw):
            raise TypeError(f"CellNetwork.compute: got {self.compute!r}, expected a delay law")
        for way in ("uplink", "downlink"):
            direction, free = getattr(self, way), self.free_slots_per_s(way)
            if direction.size > free:
                most = free * direction.slot_bits / 8
                raise ValueError(f"CellNetwork.{way}.message_bytes: got {direction.message_bytes:g}, expected at most "
                                 f"{most:.0f}, what a second carries")  # fmt: skip

    @property
    def prefix_stable(self) -> bool:
        """Whether what is drawn for a tick depends neither on how many there are nor on tau."""
        return not (self.uplink.other.bursty or self.downlink.other.bursty)

    @property
    def uses_deadline(self) -> bool:
        """Whether what is late is given up."""
        return self.edge.abort

    @property
    def drawn_as(self) -> CellNetwork:
        """A network with the same draws, whatever its edge and the size of its messages and slots."""
        ways = {way: replace(getattr(self, way), message_bytes=1.0, slot_bits=1e6) for way in ("uplink", "downlink")}
        return replace(self, edge=Edge(), **ways)

    def free_slots_per_s(self, way: str) -> float:
        """Slots of a direction that other traffic leaves in a second, in the mean."""
        return self.frame.share(way) / self.frame.slot * (1.0 - getattr(self, way).other.mean_share)

    def draw(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Chances:
        """Draws what chance decides of one Monte Carlo seed; `contend` makes loops of it."""
        of_compute, of_request, of_up, of_down = jax.random.split(key, 4)
        shape, seconds = (num_ticks, num_robots), num_ticks * tau
        return Chances(
            self.compute.sample(of_compute, shape),
            _draws.uniform(of_request, shape),
            self.uplink.draw(of_up, shape, self.frame, seconds),
            self.downlink.draw(of_down, shape, self.frame, seconds),
        )

    def contend(self, drawn: Chances, num_ticks: Array | int, tau: Array | float, deadline: Array) -> Contended:
        """Works out the loops of all seeds at all deadlines (see `SharedNetwork`)."""
        # The batch comes last: [P, N, D, S].
        compute, request, failed_up, failed_down = (
            jnp.moveaxis(values, 0, -1)[:, :, None, :]
            for values in (drawn.compute, drawn.request, drawn.uplink[0], drawn.downlink[0])
        )
        ready = self._ready(request, num_ticks, tau)
        alike = not self.stagger and self.access.request_period == 0.0
        up, used_up = self._carried("uplink", ready, failed_up, drawn.uplink[1], num_ticks, tau, alike)
        limits = deadline[:, None] if self.uses_deadline else jnp.zeros((1, 1), compute.dtype)
        served = self.edge.serve(up, compute, tau, limits.astype(compute.dtype))
        failed_down = jnp.broadcast_to(failed_down, served.ended.shape)
        down, used_down = self._carried("downlink", served.ended, failed_down, drawn.downlink[1], num_ticks, tau)
        first = [jnp.moveaxis(values, (2, 3), (0, 1)) for values in (down, *served)]
        times, began, _, busy = (jnp.broadcast_to(values, (deadline.shape[0], *values.shape[1:])) for values in first)
        usage = {"uplink": used_up, "edge": edge_usage(self.edge, began, busy, num_ticks, tau), "downlink": used_down}
        return Contended(times, usage, began, busy)

    def reliability(self, deadline: Any, load: Load) -> Reliability:
        """Estimates F(deadline) under a load by simulating the network alone.

        Raises:
            ValueError: A deadline is NaN.
        """
        return simulated(self, deadline, load)

    def describe(self) -> dict[str, Any]:
        """Returns the network as plain values."""
        ways = {
            way: plain(getattr(self, way)) | {"other": getattr(self, way).other.describe()}
            for way in ("uplink", "downlink")
        }
        return plain(self) | ways | {
            "compute": self.compute.describe(), "frame": plain(self.frame), "access": plain(self.access),
            "edge": self.edge.describe(),
        }  # fmt: skip

    def _ready(self, request: Array, num_ticks: Array | int, tau: Array | float) -> Array:
        """When each sample may be sent, [P, N, 1, S] s after p tau; inf for those that are not taken."""
        ticks, robots = request.shape[:2]
        ready = request * self.access.request_period + self.access.grant
        if self.stagger:
            ready = ready + (jnp.arange(robots) * (tau / robots)).astype(ready.dtype)[None, :, None, None]
        return jnp.where((jnp.arange(ticks) < num_ticks)[:, None, None, None], ready, jnp.inf)

    def _carried(
        self,
        way: str,
        ready: Array,
        failures: Array,
        bursts: Array,
        num_ticks: Array | int,
        tau: Array | float,
        alike: bool = False,
    ) -> tuple[Array, Array]:
        """When each message is there, [P, N, *B] s after p tau (inf: lost), and the share of the air in use, *B."""
        direction: Direction = getattr(self, way)
        capacity = self._capacity(way, bursts, ready.dtype)
        sent = jnp.minimum(failures + 1.0, float(self.harq_max))
        size = sent * direction.size
        left = through_air(ready, size, tau, self.frame, way, capacity, alike)
        arrives = left + (sent - 1.0) * self.harq_rtt + self.core
        end = jnp.asarray(num_ticks * tau / self.frame.slot).astype(jnp.int32)
        within = left <= num_ticks * tau - (jnp.arange(ready.shape[0]) * tau).reshape(-1, *(1,) * (ready.ndim - 1))
        own = jnp.where(within, size, 0.0).sum(axis=(0, 1))
        total = self.frame.before(end, way).astype(own.dtype)
        free = capacity.between(jnp.zeros((1, *own.shape), jnp.int32), end + jnp.zeros((1, *own.shape), jnp.int32),
                                self.frame, way)[0]  # fmt: skip
        usage = jnp.moveaxis(1.0 - (free - own) / total, -1, 1)
        return jnp.where(failures < self.harq_max, arrives, jnp.inf), usage

    def _capacity(self, way: str, bursts: Array, dtype: Any) -> Capacity:
        """What the slots of a direction can carry; bursts [S, slots]."""
        other = getattr(self, way).other
        free, burst = (jnp.asarray(value, dtype) for value in (1.0 - other.share, other.burst_share))
        if not other.bursty:
            return Capacity(free, burst, None)
        serves = jnp.asarray(self.frame.serves(way, bursts.shape[1]))
        count = jnp.cumsum(bursts & serves[None, :], axis=1, dtype=jnp.int32)
        on = jnp.pad(count, ((0, 0), (1, 0))).T[:, None, :]
        return Capacity(free, burst, on)
