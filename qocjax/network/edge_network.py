"""A network behind a finite edge: loops that find no idle worker wait or are lost (model, section 12)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import jax.numpy as jnp
from jax import Array

from qocjax.network.edge import Edge, Served
from qocjax.network.estimate import simulated
from qocjax.network.interface import Contended, Load, Network, Reliability, Serve
from qocjax.network.trace import key_of_copy
from qocjax.scenario import _pytree

__all__ = ["EdgeNetwork", "Path", "copied_parts", "edge_usage", "with_edge"]


@runtime_checkable
class Path(Network, Protocol):
    """A network that can say what leads up to a computation, and what follows it."""

    @property
    def alike(self) -> bool:
        """Whether all samples that arrive at the edge take the same time to."""
        ...

    def draw_parts(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Any:
        """Draws what chance decides of one Monte Carlo seed, as a pytree; arguments as for `draw`."""
        ...

    def through(self, parts: Any, serve: Serve, tau: Array | float) -> Array:
        """Loop times [D, S, P, N] s of the loops of some seeds.

        Args:
            parts: From `draw_parts`, each leaf with an axis [S] before its own.
            serve: What the edge makes of the samples; called once.
            tau: Sampling period (s).
        """
        ...


@_pytree
@dataclass(frozen=True)
class EdgeNetwork:
    """A path through an edge with few workers.

    Attributes:
        path: Up to the edge and down from it, with the time of computation in between.
        edge: The workers.
    """

    path: Path = field(metadata={"static": True})
    edge: Edge

    def __post_init__(self) -> None:
        if not isinstance(self.path, Path):
            raise TypeError(f"EdgeNetwork.path: got {self.path!r}, expected a network with a computation of its own, "
                            "such as LoopNetwork (a trace says nothing of loops that it did not contain)")  # fmt: skip
        if not isinstance(self.edge, Edge):
            raise TypeError(f"EdgeNetwork.edge: got {self.edge!r}, expected an Edge")

    @property
    def name(self) -> str:
        """That of the path."""
        return self.path.name

    @property
    def prefix_stable(self) -> bool:
        """Whether what is drawn for a tick depends neither on how many there are nor on tau."""
        return bool(getattr(self.path, "prefix_stable", False))

    @property
    def uses_deadline(self) -> bool:
        """Whether what is late is given up."""
        return self.edge.abort

    @property
    def drawn_as(self) -> EdgeNetwork:
        """A network with the same draws, whatever the edge."""
        return EdgeNetwork(self.path, Edge())

    def draw(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Any:
        """Draws what chance decides of one Monte Carlo seed; `contend` makes loops of it."""
        return self.path.draw_parts(key, num_ticks, num_robots, tau)

    def draw_again(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Any:
        """Draws of a copy of the network at the same time."""
        return copied_parts(self.path, key, num_ticks, num_robots, tau)

    def contend(self, drawn: Any, num_ticks: Array | int, tau: Array | float, deadline: Array) -> Contended:
        """Works out the loops of all seeds at all deadlines (see `SharedNetwork`)."""
        found: list[Served] = []

        def serve(uplink: Array, compute: Array) -> Array:
            found.append(_serve_all(self.edge, uplink, compute, num_ticks, tau, deadline, self.path.alike))
            return found[0].ended

        times = self.path.through(drawn, serve, tau)
        times, began, busy = (
            jnp.broadcast_to(values, (deadline.shape[0], *values.shape[1:]))
            for values in (times, found[0].began, found[0].busy)
        )
        return Contended(times, {"edge": edge_usage(self.edge, began, busy, num_ticks, tau)}, began, busy)

    def reliability(self, deadline: Any, load: Load) -> Reliability:
        """Estimates F(deadline) under a load by simulating the network alone.

        Raises:
            ValueError: A deadline is NaN.
        """
        return simulated(self, deadline, load)

    def describe(self) -> dict[str, Any]:
        """Returns the network as plain values."""
        return self.path.describe() | {"edge": self.edge.describe()}


def copied_parts(path: Path, key: Array, num_ticks: int, num_robots: int, tau: float) -> Any:
    """What chance decides of a copy of a path, for the seed of a key; of a measured one what came at the same time."""
    again = getattr(path, "draw_parts_again", None)
    if again is not None:
        return again(key, num_ticks, num_robots, tau)
    return path.draw_parts(key_of_copy(key), num_ticks, num_robots, tau)


def with_edge(path: Path, edge: Edge) -> Network:
    """The path itself with an unlimited edge, else behind the finite one."""
    return EdgeNetwork(path, edge) if edge.finite else path


def _serve_all(
    edge: Edge,
    uplink: Array,
    compute: Array,
    num_ticks: Array | int,
    tau: Array | float,
    deadline: Array,
    alike: bool,
) -> Served:
    """Serves the samples of all seeds [S, P, N] at all deadlines [D]; each part of what comes out is [D, S, P, N].

    Where nothing depends on the deadline, D is 1.
    """
    taken = jnp.arange(uplink.shape[1]) < num_ticks
    uplink = jnp.where(taken[None, :, None], uplink, jnp.inf)
    # The kernel has the batch last: along vector registers.
    arrival, work = (jnp.moveaxis(values, 0, -1)[:, :, None, :] for values in (uplink, compute))
    limits = deadline[:, None] if edge.abort else jnp.zeros((1, 1), uplink.dtype)
    served = edge.serve(arrival, work, tau, limits.astype(uplink.dtype), alike)
    shape = jnp.broadcast_shapes(*(values.shape for values in served))
    return Served(*(jnp.moveaxis(jnp.broadcast_to(values, shape), (2, 3), (0, 1)) for values in served))


def edge_usage(edge: Edge, began: Array, busy: Array, num_ticks: Array | int, tau: Array | float) -> Array:
    """Share of the workers' time that is in use within the run, [D, S]; without a limit the workers in use.

    Args:
        edge: The workers.
        began: [D, S, P, N] s from sampling until each computation begins, inf for never.
        busy: [D, S, P, N] s that it takes.
        num_ticks: P.
        tau: s.
    """
    horizon = num_ticks * tau
    instants = (jnp.arange(busy.shape[2]) * tau)[None, None, :, None]
    left = horizon - instants - jnp.where(jnp.isfinite(began), began, 0.0)
    seconds = jnp.clip(left, 0.0, busy).sum(axis=(2, 3))
    return seconds / (horizon * (edge.total(busy.shape[3]) if edge.finite else 1.0))
