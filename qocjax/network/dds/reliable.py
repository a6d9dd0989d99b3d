"""RELIABLE: gaps shown by heartbeats, asked for by ACKNACKs, repaired by the writer (model, section 8; RTPS 2.5, 8.4).

The protocol is event-driven; here it is one scan over the heartbeats in the order in which they reach the reader, with
all times as numbers, none rounded to ticks. It is exact, since between two heartbeats the reader's ACKNACK timer goes
off at most once, and since all that follows from an ACKNACK (when it reaches the writer, which samples that still has,
when the repairs or the notice of a gap come back) is known as soon as it is sent. In each step first the timer, if it
is due before the heartbeat, then the heartbeat.

- The reader asks at once (after `acknack_delay`) if nothing that is missing was asked for before, else `nack_period`
  after its last ACKNACK: the rule of Eclipse Cyclone DDS. It asks for all that is missing then.
- All repairs that answer one ACKNACK share packets as far as they fit. A sample that the writer no longer has is
  answered by a GAP in the first of these packets.

Approximated: what does not fit into seven packets of repairs goes into the eighth, and after 256 ACKNACKs of a writer
the random numbers of ACKNACKs and repairs come round again. Repairs and ACKNACKs may overtake samples, also where
samples keep their order. Left out: heartbeats that accompany repairs, what limits a writer in what it sends again, and
fragments of samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax.network.dds.heartbeats import Heartbeats
from qocjax.network.dds.link import PACKETS, Channel, Fates, lost_at
from qocjax.network.dds.profile import Profile

__all__ = ["Repairs", "repair"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Repairs:
    """What the reader asked for and the writer sent again; one row per heartbeat, most of them empty."""

    asked: Array  # [J] s, when an ACKNACK that asks for samples is sent, inf for none
    answered: Array  # [J] s, when the writer answers it, inf for never
    samples: Array  # [J] samples that it sends again
    packets: Array  # [J] packets that they take
    confirmed: Array  # [J] s, when an ACKNACK that asks for nothing is sent, inf for none


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Reader:
    """What the scan carries."""

    received: Array  # [P + W] s, first arrival of each sample as far as it is settled, inf for none
    released: Array  # [P + W] s, when the reader learns that a sample is not to be had
    start: Array  # first sample of the window: what is before it is settled
    last: Array  # newest sample that a heartbeat has told of
    timer: Array  # s, when the next ACKNACK is due, inf for none
    asked: Array  # s, when the last one was sent
    asked_end: Array  # one past the last sample that it asked for
    count: Array  # of ACKNACKs that ask for samples


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _World:
    """What is the same in all steps."""

    gone: Array  # [P + W] s
    forward: Channel
    backward: Channel
    acknacks: Fates  # [K]
    packets: Fates  # [K, C]


def repair(
    arrival: Array,
    gone: Array,
    released: Array,
    heard: Heartbeats,
    links: tuple[Channel, Channel],
    fates: tuple[Fates, Fates],
    profile: Profile,
    payload: int,
) -> tuple[Array, Array, Repairs]:
    """Runs the protocol between one writer and one reader.

    Args:
        arrival: [P] s, when each sample first arrives, inf where lost.
        gone: [P] s, when each leaves the writer's history.
        released: [P] s, when a heartbeat tells the reader so.
        heard: The heartbeats as they arrive.
        links: From writer to reader, and back.
        fates: Of the ACKNACKs [K] and of the packets of repairs [K, C].
        profile: QoS and timers.
        payload: Bytes of a sample.

    Returns:
        When each sample arrives first, repairs included, [P] s; when the reader learns that it will not, [P] s; and
        what was sent for it.
    """
    padding = jnp.full((profile.window,), jnp.inf, arrival.dtype)
    wide = [jnp.concatenate([times, padding]) for times in (arrival, released, gone)]
    zero, never = jnp.zeros((), jnp.int32), jnp.full((), jnp.inf, arrival.dtype)
    begin = _Reader(wide[0], wide[1], zero, zero - 1, never, -never, zero, zero)
    world = _World(wide[2], *links, *fates)
    rows = (heard.arrival, heard.first, heard.last, heard.alone)
    end, repairs = lax.scan(partial(_step, world, profile, profile.repairs_per_packet(payload)), begin, rows)
    return end.received[: arrival.shape[0]], end.released[: arrival.shape[0]], repairs


def _step(
    world: _World, profile: Profile, per_packet: int, reader: _Reader, row: tuple[Array, Array, Array, Array]
) -> tuple[_Reader, Repairs]:
    arrival, first, last, alone = row
    due = reader.timer < arrival
    reader, repairs = _ask(world, profile, per_packet, reader, due)
    reader, at_once = _hear(profile, reader, arrival, first, last)
    confirmed = jnp.where(alone & ~at_once, arrival, jnp.inf)
    return reader, Repairs(*repairs, confirmed)


def _window(reader: _Reader, size: int) -> tuple[Array, Array, Array]:
    """Numbers [W] of the samples in the window, and when they are received and released."""
    number = reader.start + jnp.arange(size, dtype=jnp.int32)
    parts = [lax.dynamic_slice_in_dim(times, reader.start, size) for times in (reader.received, reader.released)]
    return number, parts[0], parts[1]


def _ask(
    world: _World, profile: Profile, per_packet: int, reader: _Reader, due: Array
) -> tuple[_Reader, tuple[Array, Array, Array, Array]]:
    """Sends the ACKNACK if it is due, and settles when what it brings arrives."""
    number, received, released = _window(reader, profile.window)
    now, row = reader.timer, reader.count % world.acknacks.delay.shape[0]
    missing = due & (number <= reader.last) & (received > now) & (released > now)
    asks = jnp.any(missing)
    asked = jnp.where(asks, now, jnp.inf)
    answered = asked + world.acknacks.delay[row] + profile.repair_delay
    answered = jnp.where(lost_at(world.backward, asked, world.acknacks.level[row]), jnp.inf, answered)
    back = jnp.where(
        lost_at(world.forward, answered, world.packets.level[row]), jnp.inf, answered + world.packets.delay[row]
    )
    again = missing & (lax.dynamic_slice_in_dim(world.gone, reader.start, profile.window) > answered)
    packet = jnp.clip((jnp.cumsum(again) - 1) // per_packet, 0, PACKETS - 1)
    received = jnp.minimum(received, jnp.where(again, back[packet], jnp.inf))
    released = jnp.minimum(released, jnp.where(missing & ~again, back[0], jnp.inf))
    samples = jnp.sum(again & jnp.isfinite(answered), dtype=jnp.int32)
    put = lax.dynamic_update_slice_in_dim
    reader = _Reader(
        put(reader.received, received, reader.start, 0),
        put(reader.released, released, reader.start, 0),
        reader.start,
        reader.last,
        jnp.where(due, jnp.inf, reader.timer),
        jnp.where(asks, now, reader.asked),
        jnp.where(asks, jnp.max(jnp.where(missing, number + 1, 0)), reader.asked_end),
        reader.count + asks,
    )
    needed = (samples + per_packet - 1) // per_packet
    used = jnp.where(jnp.isfinite(answered), jnp.clip(needed, 1, PACKETS), 0)  # a GAP needs one too
    return reader, (asked, answered, samples, used)


def _hear(profile: Profile, reader: _Reader, now: Array, first: Array, last: Array) -> tuple[_Reader, Array]:
    """Takes in a heartbeat, and sets the timer if it shows a gap; tells whether that is to be asked for at once."""
    newer = jnp.isfinite(now) & (last >= reader.last)
    start = jnp.where(newer, jnp.maximum(reader.start, first), reader.start)
    reader = _moved(reader, start, jnp.where(newer, last, reader.last))
    number, received, released = _window(reader, profile.window)
    settled = (received <= now) | (released <= now)
    missing = newer & (number <= reader.last) & ~settled
    base = jnp.min(jnp.where(missing, number, jnp.iinfo(jnp.int32).max))
    gap = jnp.any(missing)
    again = reader.asked + profile.nack_period
    at_once = (base >= reader.asked_end) | (now >= again)
    due = jnp.where(at_once, now + profile.acknack_delay, again)
    timer = jnp.where(gap, jnp.minimum(reader.timer, due), reader.timer)
    known = jnp.cumprod((settled & (number <= reader.last)).astype(jnp.int32), dtype=jnp.int32)
    start = reader.start + jnp.where(newer, jnp.sum(known, dtype=jnp.int32), 0)
    return _moved(reader, start, reader.last, timer), gap & at_once


def _moved(reader: _Reader, start: Array, last: Array, timer: Array | None = None) -> _Reader:
    return _Reader(
        reader.received, reader.released, start, last, reader.timer if timer is None else timer,
        reader.asked, reader.asked_end, reader.count,
    )  # fmt: skip
