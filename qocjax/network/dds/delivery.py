"""What the reader hands over to the application, and when (model, section 8)."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array, lax

from qocjax.network.dds.profile import Profile

__all__ = ["best_effort", "in_sequence", "missed_periods", "queued"]

_SPACING = 2e-5  # s, least time between two packets of one link, so that a queue is not a burst of one moment


def queued(arrival: Array) -> Array:
    """Arrivals of a link whose packets cannot overtake each other, [P] s in the order of sending, inf where lost."""
    place = jnp.arange(arrival.shape[0], dtype=arrival.dtype) * _SPACING
    behind = lax.cummax(jnp.where(jnp.isfinite(arrival), arrival - place, -jnp.inf)) + place
    return jnp.where(behind > arrival + 0.5 * _SPACING, behind, arrival)  # without a queue to the last digit


def best_effort(write: Array, arrival: Array, profile: Profile) -> Array:
    """Hands over each sample as it arrives, unless a newer one is there or its lifespan is over; [P] s, inf if not."""
    later = jnp.append(lax.cummin(arrival, reverse=True)[1:], jnp.inf)
    return _young(write, arrival, jnp.where(arrival <= later, arrival, jnp.inf), profile)


def in_sequence(write: Array, received: Array, released: Array, profile: Profile) -> Array:
    """Hands over samples in order: each waits until all before it have come or are known not to come.

    Of the samples that become available at one moment the reader keeps the newest `reader_depth`.

    Args:
        write: [P] s.
        received: [P] s, when each sample arrives, inf for never.
        released: [P] s, when the reader learns that it is not to be had; later than that it is no longer wanted.
        profile: QoS.

    Returns:
        When each is handed over, [P] s, inf for never.
    """
    turn = lax.cummax(jnp.minimum(received, released))
    arrived = (received <= released) & jnp.isfinite(turn)
    if profile.reader_depth is not None:
        upto = jnp.cumsum(arrived)
        of_burst = upto[jnp.searchsorted(turn, turn, side="right") - 1]
        arrived = arrived & (of_burst - upto < profile.reader_depth)
    return _young(write, received, jnp.where(arrived, turn, jnp.inf), profile)


def _young(write: Array, received: Array, handed: Array, profile: Profile) -> Array:
    begin = write if profile.lifespan_from == "source" else received
    begin = jnp.where(jnp.isfinite(begin), begin, 0.0)
    return jnp.where(handed - begin <= profile.lifespan, handed, jnp.inf)


def missed_periods(handed: Array, period: float, until: Array | float) -> Array:
    """Counts the periods of a DEADLINE QoS in which no sample was handed over, from the first one on to `until` (s)."""
    order = jnp.sort(jnp.where(handed <= until, handed, until))
    gaps = jnp.where(jnp.isfinite(order[0]), jnp.diff(jnp.append(order, until)), 0.0)
    return jnp.sum(jnp.floor(gaps / period * (1 - 1e-6)).astype(jnp.int32))
