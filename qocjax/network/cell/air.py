"""Messages of all robots over one direction of a cell, first come first served (model, section 13).

In cumulated bits Y_k = max(C(n_k), Y_{k-1}) + b_k. Here it is the backlog Q_k = Y_k - b_k - C(n_k) that message k finds
at its first slot n_k, Q_k = max(Q_{k-1} + b_{k-1} - (C(n_k) - C(n_{k-1})), 0): the same recursion, but in
numbers that stay small, so that float32 carries it: running sums and minima, in blocks.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array, lax

from qocjax.network.arrivals import arrivals
from qocjax.network.cell.frame import Frame
from qocjax.network.cell.traffic import Capacity
from qocjax.network.schedule import split_deadline

__all__ = ["through_air"]

_BLOCK = 256  # messages


def through_air(
    ready: Array,
    size: Array,
    tau: Array | float,
    frame: Frame,
    direction: str,
    capacity: Capacity,
    alike: bool = False,
) -> Array:
    """When each message has left the air.

    Args:
        ready: [P, N, *B] s from p tau until message p of robot i may be sent, inf for never.
        size: [P, N, *B] what it takes of the air, in whole slots of the direction.
        tau: Sampling period (s).
        frame: The slots.
        direction: `uplink` or `downlink`.
        capacity: What the slots can carry.
        alike: Whether all that are sent are ready after the same time.

    Returns:
        [P, N, *B] s from p tau until the end of the slot that carries its last bit, inf for never.
    """
    slack = max(1e-6, 1e4 * float(jnp.finfo(ready.dtype).eps))  # slots; rounding of a long busy period
    sent = jnp.isfinite(ready)
    base, beyond = _slots_at_ticks(ready.shape[0], tau, frame.slot, ready.ndim)
    after = jnp.ceil(beyond + jnp.where(sent, ready, 0.0) / frame.slot - slack).astype(jnp.int32)
    order = arrivals(ready, tau, alike)
    first = lax.cummax(order.take(jnp.where(sent, base + after, 0)))
    load = order.take(jnp.where(sent, size, 0.0))
    last = capacity.carried_by(first, _backlog(first, load, frame, direction, capacity) + load, frame, direction, slack)
    leaves = order.put_back(last + 1, ready.shape[1]) - base - beyond
    return jnp.where(sent, leaves * frame.slot, jnp.inf)


def _slots_at_ticks(num_ticks: int, tau: Array | float, slot: float, rank: int) -> tuple[Array, Array]:
    """Slots that have begun at p tau, and how much of one is left over, each [P, 1, *1]."""
    whole, rest = split_deadline(tau, slot)
    tick = jnp.arange(num_ticks, dtype=jnp.int32).reshape(-1, *(1,) * (rank - 1))
    return tick * whole, tick * (rest / slot)


def _backlog(first: Array, load: Array, frame: Frame, direction: str, capacity: Capacity) -> Array:
    """Q_k [M, *B], in whole slots.

    Within a block that begins with a backlog q it is max(q + S_k, S_k - min S_j), S the running sum of what comes and
    goes; so sums stay as short as blocks.
    """
    served = capacity.between(first[:-1], first[1:], frame, direction)
    change = jnp.concatenate([jnp.zeros_like(load[:1]), load[:-1] - served])
    length = change.shape[0]
    blocks = jnp.pad(change, ((0, -length % _BLOCK),) + ((0, 0),) * (change.ndim - 1))
    total = jnp.cumsum(blocks.reshape(-1, _BLOCK, *change.shape[1:]), axis=1)
    alone = total - lax.cummin(total, axis=1)

    def then(before: Array, block: tuple[Array, Array]) -> tuple[Array, Array]:
        return jnp.maximum(before + block[0], block[1]), before

    _, begins = lax.scan(then, jnp.zeros_like(change[0]), (total[:, -1], alone[:, -1]))
    return jnp.maximum(begins[:, None] + total, alone).reshape(-1, *change.shape[1:])[:length]
