"""The edge: how many workers it has, and what happens to a sample that finds them busy (model, section 12)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array

from qocjax import _checks
from qocjax.network._fields import plain
from qocjax.network.arrivals import arrivals, rotation
from qocjax.network.completion import completes
from qocjax.network.disciplines import DISCIPLINES, Work
from qocjax.scenario import TIME_TOLERANCE, _pytree

__all__ = ["Edge", "Served"]

_ROOM = 8  # workers that a program has room for at least, so that one serves many edges


class Served(NamedTuple):
    """What the edge made of samples [P, N, *B]."""

    began: Array  # [P, N, *B] s from sampling until its computation begins; inf where none does
    ended: Array  # [P, N, *B] s from sampling until that ends; inf where it does not
    busy: Array  # [P, N, *B] s that a worker spends on it, on one that is given up too


@_pytree
@dataclass(frozen=True)
class Edge:
    """Workers that compute commands.

    Attributes:
        workers: W, each robot's own or all robots' together; not read by `unlimited`.
        per_robot: Whether each robot has `workers` of its own.
        discipline: What a sample does that finds no idle worker. `unlimited`: there always is one. `skip`: it is
            dropped. `latest`: it takes its robot's place to wait, from which a newer one drives it out (a ROS 2
            subscription of depth 1). `fifo`: it waits, in the order of arrival.
        abort: Whether a computation or a wait that passes t_p + Delta is given up then; loop times depend on Delta.
    """

    workers: int = 1
    per_robot: bool = field(default=True, metadata={"static": True})
    discipline: str = field(default="unlimited", metadata={"static": True})
    abort: bool = field(default=False, metadata={"static": True})
    room: int = field(init=False, metadata={"static": True})  # workers that a program serves: one for many numbers

    def __post_init__(self) -> None:
        _checks.choice("Edge.discipline", self.discipline, ("unlimited", *DISCIPLINES))
        object.__setattr__(self, "workers", _checks.count("Edge.workers", self.workers))
        object.__setattr__(self, "room", self._room() if self.finite else 0)
        for name in ("per_robot", "abort"):
            if not isinstance(getattr(self, name), bool):
                raise TypeError(f"Edge.{name}: got {getattr(self, name)!r}, expected True or False")

    def _room(self) -> int:
        """Workers that a program has room for: a power of two; one for many edges, but where deadlines multiply it."""
        least = 1 if self.abort else _ROOM
        return max(least, 1 << (self.workers - 1).bit_length())

    @property
    def finite(self) -> bool:
        """Whether a sample may find no idle worker."""
        return self.discipline != "unlimited"

    def total(self, num_robots: int) -> float:
        """Workers of all robots together, inf without a limit."""
        if not self.finite:
            return float("inf")
        return self.workers * (num_robots if self.per_robot else 1)

    def serve(
        self, uplink: Array, compute: Array, tau: Array | float, deadline: Array | float, alike: bool = False
    ) -> Served:
        """Works out when the computation of each sample ends.

        Args:
            uplink: [P, N, *B] s from sampling until the sample is at the edge, inf for never; of any length.
            compute: [P, N, *B] s of a worker.
            tau: Sampling period (s).
            deadline: Delta (s), broadcastable to the batch, which it may widen; read with `abort` alone.
            alike: Whether all samples that arrive take the same time to, which saves sorting them.
        """
        deadline = jnp.asarray(deadline, uplink.dtype)
        deadline = deadline.reshape((1,) * (uplink.ndim - deadline.ndim) + deadline.shape)
        limit = deadline - uplink if self.abort else jnp.full_like(uplink, jnp.inf)
        # Of sums of seconds; float32 rounds those more coarsely than the model's tolerance.
        slack = jnp.maximum(TIME_TOLERANCE * tau, 8 * float(jnp.finfo(uplink.dtype).eps))
        limit = jnp.where(jnp.isfinite(uplink) & (limit > slack), limit, 0.0)
        idle = jnp.where(limit > 0.0, 0.0, jnp.inf)
        wait = self._wait(uplink, compute, limit, tau, alike, slack) if self.finite else idle
        began = uplink + wait
        ended = began + compute
        if self.abort:
            ended = jnp.where(completes(ended, deadline), ended, jnp.inf)
        busy = jnp.where(jnp.isfinite(wait), jnp.minimum(compute, limit - wait), 0.0)
        return Served(began, ended, busy)

    def describe(self) -> dict[str, Any]:
        """Returns the edge as plain values."""
        return {name: value for name, value in plain(self).items() if name != "room"}

    def _wait(
        self, uplink: Array, compute: Array, limit: Array, tau: Array | float, alike: bool, slack: Array
    ) -> Array:
        """Waiting times [P, N, *B] s, inf where a sample is not served."""
        ticks, robots = uplink.shape[:2]
        # A robot with workers of its own is alone at its edge: one more of the batch.
        sharing = 1 if self.per_robot else robots
        uplink, compute, limit = (
            values.reshape(ticks, sharing, robots // sharing, *values.shape[2:]) for values in (uplink, compute, limit)
        )
        turn = rotation(ticks, robots).reshape(ticks, sharing, robots // sharing, *(1,) * (uplink.ndim - 3))
        order = arrivals(uplink, tau, alike, turn)
        robot, tick = order.order % sharing, order.order // sharing
        parts = (order.gap, robot, tick, order.take(compute), order.take(limit))
        work = Work(*(values[:, None] for values in parts))
        # Beyond those that there are, workers never become idle.
        there = jnp.arange(self.room).reshape(-1, *(1,) * (uplink.ndim - 2)) < self.workers
        idle = jnp.where(there, jnp.zeros((), uplink.dtype), jnp.inf)
        wait = DISCIPLINES[self.discipline](work, idle, sharing, slack)[:, 0]
        return order.put_back(wait, sharing).reshape(ticks, robots, *wait.shape[2:])
