"""When heartbeats are sent, what they say, and when they arrive."""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax.network.dds.link import Channel, Fates, lost_at
from qocjax.network.dds.profile import Profile

__all__ = ["Heartbeats", "alone_count", "arriving", "gone_times", "released"]

_TAIL = 20  # heartbeats after the last sample, which show that it was lost
_ROUNDING = 1e-4  # of a period


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Heartbeats:
    """Heartbeats of one writer in order of arrival; those that are lost come last, at infinity."""

    arrival: Array  # [J] s
    first: Array  # [J] first sample still in the history when it was sent
    last: Array  # [J] last sample written by then
    alone: Array  # [J] whether it came by itself, and so asks for an answer
    sent_alone: Array  # [M] s, heartbeats that the writer sends by themselves; inf for none


def alone_count(profile: Profile, num_ticks: int, tau: float) -> int:
    """Room for heartbeats by themselves within a run."""
    return math.ceil(num_ticks * tau / profile.heartbeat_period) + _TAIL


def gone_times(write: Array, profile: Profile) -> Array:
    """When each sample leaves the writer's history: overwritten or expired, [P] s, nondecreasing."""
    depth = write.shape[0] if profile.depth is None else min(profile.depth, write.shape[0])
    overwritten = jnp.concatenate([write[depth:], jnp.full((depth,), jnp.inf, write.dtype)])
    return jnp.minimum(overwritten, write + profile.lifespan)


def arriving(write: Array, arrival: Array, gone: Array, link: Channel, fates: Fates, profile: Profile) -> Heartbeats:
    """Works out all heartbeats of a writer; with `piggyback=full` those that may come, as the reader has a say then.

    Args:
        write: [P] s, nondecreasing, inf for samples never written.
        arrival: [P] s, when each sample first arrives, inf where lost.
        gone: [P] s, when each leaves the history.
        link: The direction from writer to reader.
        fates: [M] of the heartbeats that are sent by themselves.
        profile: QoS and timers.
    """
    sent, alone = _by_themselves(write, fates.delay.shape[0], profile)
    heard = jnp.where(lost_at(link, sent, fates.level), jnp.inf, sent + fates.delay)
    when, apart = heard, jnp.isfinite(sent)
    last = alone
    if profile.piggyback != "never":
        own = jnp.arange(write.shape[0], dtype=jnp.int32)
        sent, last = jnp.concatenate([write, sent]), jnp.concatenate([own, alone])
        when = jnp.concatenate([arrival, heard])
        apart = jnp.concatenate([jnp.zeros_like(own, bool), apart])
    first = jnp.searchsorted(gone, sent, side="right").astype(jnp.int32)
    order = jnp.argsort(when)
    end = jnp.full((1,), jnp.inf, when.dtype)  # so that a timer after the last heartbeat still goes off
    none = jnp.full((1,), -1, jnp.int32)
    return Heartbeats(
        jnp.concatenate([when[order], end]),
        jnp.concatenate([first[order], none]),
        jnp.concatenate([last[order], none]),
        jnp.concatenate([apart[order], jnp.zeros((1,), bool)]),
        sent[-fates.delay.shape[0] :],
    )


def _by_themselves(write: Array, count: int, profile: Profile) -> tuple[Array, Array]:
    """Times (s) and last samples of heartbeats sent by themselves, [M]."""
    number = jnp.arange(count, dtype=jnp.int32)
    if profile.piggyback != "always":
        sent = write[0] + (number + 1) * profile.heartbeat_period
        return sent, jnp.searchsorted(write, sent, side="right").astype(jnp.int32) - 1
    pause = jnp.append(write[1:], jnp.inf) - write
    pause = jnp.where(jnp.isfinite(write), pause / profile.heartbeat_period, 0.0)  # inf - inf after the last
    in_pause = jnp.clip(jnp.ceil(pause - _ROUNDING) - 1, 0, count).astype(jnp.int32)
    upto = jnp.minimum(jnp.cumsum(in_pause), count)
    sample = jnp.searchsorted(upto, number, side="right").astype(jnp.int32)
    known = jnp.minimum(sample, write.shape[0] - 1)
    before = jnp.where(known > 0, upto[known - 1], 0)
    sent = write[known] + (number - before + 1) * profile.heartbeat_period
    return jnp.where(sample < write.shape[0], sent, jnp.inf), known


def released(arrival: Array, first: Array, num_samples: int) -> Array:
    """When a heartbeat first tells the reader that a sample is no longer to be had, [P] s, inf for never.

    Args:
        arrival: [J] s, of the heartbeats, inf for none.
        first: [J] first sample still in the history.
        num_samples: P.
    """
    told = jnp.full((num_samples + 1,), jnp.inf, arrival.dtype)
    told = told.at[first].min(arrival, mode="drop")  # -1 wraps to the last, at inf
    return lax.cummin(told, reverse=True)[1:]
