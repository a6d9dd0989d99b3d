"""In which order messages of several robots arrive where they compete for something (model, sections 12 and 13).

Instants are p tau + delay, with delays of any length: a sample may overtake later ones. They are compared as whole
sampling periods and a rest, so that two of them fall on one instant, or do not, late in a run as at its beginning.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from qocjax.scenario import TIME_TOLERANCE

__all__ = ["Arrivals", "arrivals", "rotation"]

_NEVER = 1 << 30  # sampling periods
_FINE = 1 << 20  # parts of a sampling period that instants are told apart by, about TIME_TOLERANCE


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Arrivals:
    """Messages in the order of their arrival; `M = P * N`, `*B` is any batch."""

    order: Array  # [M, *B] place of each in the [P, N] messages as one row, p-major
    gap: Array  # [M, *B] s since the arrival before it; 0 for the first, and for those that never arrive

    def take(self, values: Array) -> Array:
        """Values [P, N, *B'] in the order of arrival, [M, *B']; B' may have axes where B has length 1."""
        return jnp.take_along_axis(_one_row(values), self.order, axis=0)

    def put_back(self, values: Array, num_robots: int) -> Array:
        """Values [M, *B'] in the order of arrival, back in [P, N, *B']."""
        index = jnp.indices(values.shape, sparse=True)[1:]
        row = jnp.zeros_like(values).at[(self.order, *index)].set(values, unique_indices=True)
        return row.reshape(-1, num_robots, *values.shape[1:])


def arrivals(delay: Array, tau: Array | float, alike: bool = False, turn: np.ndarray | None = None) -> Arrivals:
    """Puts messages in the order of their arrival.

    At one instant they come in rotating order, robot i at tick p by (i - p) mod N, and of one robot the older first.

    Args:
        delay: [P, N, *B] s from p tau until message p of robot i arrives, inf for never.
        tau: Sampling period (s).
        alike: Whether all that arrive take the same time, so that nothing needs to be sorted.
        turn: [P, N, *1] by which messages of one instant come, where robots are not those along N.
    """
    if alike:
        return _as_sent(delay, tau)
    ticks, robots = delay.shape[:2]
    batch = (1,) * (delay.ndim - 2)
    turn = rotation(ticks, robots).reshape(ticks, robots, *batch) if turn is None else turn
    arrives = jnp.isfinite(delay)
    periods = jnp.where(arrives, delay, 0.0) / tau
    whole = jnp.floor(periods + max(TIME_TOLERANCE, 8 * float(jnp.finfo(delay.dtype).eps)))
    rest = jnp.maximum(periods - whole, 0.0)
    tick = jnp.arange(ticks, dtype=jnp.int32).reshape(-1, 1, *batch)
    at = jnp.where(arrives, tick + whole.astype(jnp.int32), _NEVER)
    fine = jnp.round(rest * _FINE).astype(jnp.int32) * (int(np.max(turn)) + 1) + turn
    place = jnp.arange(ticks * robots, dtype=jnp.int32).reshape(ticks, robots, *batch)
    keys = [_one_row(jnp.broadcast_to(values, delay.shape)) for values in (at, fine, place, rest)]
    at, _, order, rest = lax.sort(keys, dimension=0, num_keys=2, is_stable=True)
    gap = jnp.diff(at, axis=0).astype(rest.dtype) + jnp.diff(rest, axis=0)
    gap = jnp.concatenate([jnp.zeros_like(rest[:1]), jnp.maximum(gap, 0.0) * tau])
    return Arrivals(order, jnp.where(at < _NEVER, gap, 0.0))


def rotation(num_ticks: int, num_robots: int) -> np.ndarray:
    """Whose message comes first of those at one instant, [P, N]: (i - p) mod N."""
    tick, robot = np.indices((num_ticks, num_robots), dtype=np.int32)
    return (robot - tick) % num_robots


def _as_sent(delay: Array, tau: Array | float) -> Arrivals:
    """Messages in the order in which they are sent."""
    ticks, robots = delay.shape[:2]
    tick, turn = np.indices((ticks, robots))
    shape = (-1,) + (1,) * (delay.ndim - 2)
    order = tick * robots + (tick + turn) % robots
    first = jnp.asarray((turn == 0) & (tick > 0), delay.dtype)
    return Arrivals(jnp.asarray(order.reshape(shape), jnp.int32), (first * tau).reshape(shape).astype(delay.dtype))


def _one_row(values: Array) -> Array:
    return values.reshape(-1, *values.shape[2:])
