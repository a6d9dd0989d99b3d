"""The reader of a RELIABLE topic: what it misses, when it asks, and what its ACKNACKs bring (RTPS 2.5, 8.4)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax.network.dds.link import PACKETS, Channel, Fates, lost_at
from qocjax.network.dds.profile import Profile

__all__ = ["Asked", "Reader", "World", "ask", "hear"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Reader:
    """What the reader knows."""

    received: Array  # [P + W] s, first arrival of each sample as far as it is settled, inf for none
    released: Array  # [P + W] s, when the reader learns that a sample is not to be had
    start: Array  # first sample of the window: what is before it is settled
    last: Array  # newest sample that a heartbeat has told of
    timer: Array  # s, when the next ACKNACK is due, inf for none
    asked: Array  # s, when the last one was sent
    asked_end: Array  # one past the last sample that it asked for
    count: Array  # of ACKNACKs sent by the timer

    @classmethod
    def new(cls, received: Array, released: Array) -> Reader:
        """Before the first heartbeat."""
        zero, never = jnp.zeros((), jnp.int32), jnp.full((), jnp.inf, received.dtype)
        return cls(received, released, zero, zero - 1, never, -never, zero, zero)

    def window(self, size: int) -> tuple[Array, Array, Array]:
        """Numbers [W] of the samples in the window, and when they are received and released."""
        number = self.start + jnp.arange(size, dtype=jnp.int32)
        parts = [lax.dynamic_slice_in_dim(times, self.start, size) for times in (self.received, self.released)]
        return number, parts[0], parts[1]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class World:
    """What is the same in all steps."""

    gone: Array  # [P + W] s, when each sample leaves the writer's history
    forward: Channel
    backward: Channel
    acknacks: Fates  # [K]
    packets: Fates  # [K, C]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Asked:
    """An ACKNACK and what comes of it; times in s, inf for never."""

    sent: Array  # if it asks for samples
    confirms: Array  # when it is sent if it asks for none
    arrives: Array  # at the writer
    base: Array  # first sample that is not acknowledged
    answered: Array
    samples: Array  # sent again
    packets: Array  # that these take


def ask(world: World, profile: Profile, payload: int, reader: Reader, due: Array) -> tuple[Reader, Asked]:
    """Sends the ACKNACK if it is due, and settles when what it brings arrives."""
    number, received, released = reader.window(profile.window)
    now, row = reader.timer, reader.count % world.acknacks.delay.shape[0]
    missing = due & (number <= reader.last) & (received > now) & (released > now)
    asks = jnp.any(missing)
    sends = due if profile.confirms else asks
    sent = jnp.where(sends, now, jnp.inf)
    lost = lost_at(world.backward, sent, world.acknacks.level[row])
    arrives = jnp.where(lost, jnp.inf, sent + world.acknacks.delay[row])
    answered = jnp.where(asks, arrives + profile.repair_delay, jnp.inf)
    again = missing & (lax.dynamic_slice_in_dim(world.gone, reader.start, profile.window) > answered)
    per_packet = profile.repairs_per_packet(payload)
    packet = jnp.clip((jnp.cumsum(again) - 1) // per_packet, 0, PACKETS - 1)
    in_each = jnp.zeros((PACKETS,), jnp.int32).at[packet].add(again)
    lost = lost_at(world.forward, answered, world.packets.level[row], profile.fragments(in_each, payload))
    back = jnp.where(lost, jnp.inf, answered + world.packets.delay[row])
    received = jnp.minimum(received, jnp.where(again, back[packet], jnp.inf))
    if not profile.confirms:  # a GAP tells of what is gone
        released = jnp.minimum(released, jnp.where(missing & ~again, back[0], jnp.inf))
    samples = jnp.sum(again & jnp.isfinite(answered), dtype=jnp.int32)
    needed = jnp.clip((samples + per_packet - 1) // per_packet, 0 if profile.confirms else 1, PACKETS)
    put, never = lax.dynamic_update_slice_in_dim, jnp.iinfo(jnp.int32).max
    asked = Asked(
        jnp.where(asks, now, jnp.inf), jnp.where(sends & ~asks, now, jnp.inf), arrives,
        jnp.minimum(jnp.min(jnp.where(missing, number, never)), reader.last + 1), answered, samples,
        jnp.where(jnp.isfinite(answered), needed, 0),
    )  # fmt: skip
    return replace(
        reader,
        received=put(reader.received, received, reader.start, 0),
        released=put(reader.released, released, reader.start, 0),
        timer=jnp.where(due, jnp.inf, now),
        asked=jnp.where(asks, now, reader.asked),
        asked_end=jnp.where(asks, jnp.max(jnp.where(missing, number + 1, 0)), reader.asked_end),
        count=reader.count + sends,
    ), asked


def hear(profile: Profile, reader: Reader, now: Array, first: Array, last: Array) -> tuple[Reader, Array]:
    """Takes in a heartbeat and sets the timer for an answer; tells whether it shows a gap to be asked for at once."""
    newer = jnp.isfinite(now) & (last >= reader.last)
    start = jnp.where(newer, jnp.maximum(reader.start, first), reader.start)
    reader = replace(reader, start=start, last=jnp.where(newer, last, reader.last))
    number, received, released = reader.window(profile.window)
    settled = (received <= now) | (released <= now)
    missing = newer & (number <= reader.last) & ~settled
    timer, at_once = _timer(profile, reader, now, number, missing)
    known = jnp.cumprod((settled & (number <= reader.last)).astype(jnp.int32), dtype=jnp.int32)
    start = reader.start + jnp.where(newer, jnp.sum(known, dtype=jnp.int32), 0)
    return replace(reader, start=start, timer=timer), at_once


def _timer(profile: Profile, reader: Reader, now: Array, number: Array, missing: Array) -> tuple[Array, Array]:
    gap = jnp.any(missing)
    if profile.confirms:  # a timer that runs is left alone
        return jnp.where(jnp.isfinite(reader.timer), reader.timer, now + profile.acknack_delay), gap
    base = jnp.min(jnp.where(missing, number, jnp.iinfo(jnp.int32).max))
    again = reader.asked + profile.nack_period
    at_once = (base >= reader.asked_end) | (now >= again)
    due = jnp.where(at_once, now + profile.acknack_delay, again)
    return jnp.where(gap, jnp.minimum(reader.timer, due), reader.timer), gap & at_once
