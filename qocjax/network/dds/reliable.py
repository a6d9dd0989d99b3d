"""RELIABLE: gaps shown by heartbeats, asked for by ACKNACKs, repaired by the writer (model, section 8; RTPS 2.5, 8.4).

The protocol is event-driven; here it is one scan over the heartbeats in the order in which they reach the reader, with
all times as numbers, none rounded to ticks. It is exact, since between two heartbeats the reader's ACKNACK timer goes
off at most once, and since all that follows from an ACKNACK (when it reaches the writer, which samples that still has,
when the repairs or the notice of a gap come back) is known as soon as it is sent. In each step first the timer, if it
is due before the heartbeat, then the heartbeat.

- `piggyback=always`, Eclipse Cyclone DDS: the reader asks at once (after `acknack_delay`) if nothing that is missing
  was asked for before, else `nack_period` after its last ACKNACK. It asks for all that is missing then. A sample that
  the writer no longer has is answered by a GAP in the first packet of repairs.
- `piggyback=full`, eProsima Fast DDS: the reader answers every heartbeat, after `acknack_delay`, by what it misses or
  by an acknowledgement, and a sample carries a heartbeat while the writer's history is full of samples that no ACKNACK
  has acknowledged. So the scan goes over what is written, too. The next heartbeat tells what the writer no longer has.
- All repairs that answer one ACKNACK share packets as far as they fit.

Approximated: what does not fit into seven packets of repairs goes into the eighth, and after 256 ACKNACKs of a writer
the random numbers of ACKNACKs and repairs come round again. Repairs and ACKNACKs may overtake samples, also where
samples keep their order. Left out: heartbeats that accompany repairs, what limits a writer in what it sends again, and
fragments of samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax.network.dds.heartbeats import Heartbeats
from qocjax.network.dds.link import Channel, Fates
from qocjax.network.dds.profile import Profile
from qocjax.network.dds.reader import Asked, Reader, World, ask, hear

__all__ = ["Repairs", "repair"]

_IN_FLIGHT = 32  # ACKNACKs whose arrival the writer still awaits


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Repairs:
    """What the reader asked for and the writer sent again; one row per event, most of them empty."""

    asked: Array  # [J] s, when an ACKNACK that asks for samples is sent, inf for none
    answered: Array  # [J] s, when the writer answers it, inf for never
    samples: Array  # [J] samples that it sends again
    packets: Array  # [J] packets that they take
    confirmed: Array  # [J] s, when an ACKNACK that asks for nothing is sent, inf for none
    heard: Array  # [J] s, when a heartbeat comes, inf for none
    first: Array  # [J] the first sample that it says the writer still has
    carrying: Array  # [J] s, when a sample that carries a heartbeat is written, inf for none


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Writer:
    """What the writer has been told, and which samples carried a heartbeat."""

    arrives: Array  # [F] s, of the newest ACKNACKs
    base: Array  # [F] what they acknowledge: all before
    low: Array  # what all before them have acknowledged
    carries: Array  # [P] whether a sample carries a heartbeat

    @classmethod
    def new(cls, write: Array) -> _Writer:
        """Before the first sample."""
        zero = jnp.zeros((), jnp.int32)
        never = jnp.full((_IN_FLIGHT,), jnp.inf, write.dtype)
        return cls(never, jnp.zeros((_IN_FLIGHT,), jnp.int32), zero, jnp.zeros(write.shape, bool))

    def acknowledged(self, now: Array) -> Array:
        """The first sample that no ACKNACK has acknowledged by a time (s)."""
        return jnp.maximum(self.low, jnp.max(jnp.where(self.arrives <= now, self.base, 0)))


def repair(
    write: Array,
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
        write: [P] s, when each sample is written.
        arrival: [P] s, when each first arrives, inf where lost.
        gone: [P] s, when each leaves the writer's history.
        released: [P] s, when a heartbeat tells the reader so, as far as that is known beforehand.
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
    world = World(wide[2], *links, *fates)
    begin, rows = Reader.new(wide[0], wide[1]), (heard.arrival, heard.first, heard.last, heard.alone)
    if profile.confirms:
        step = partial(_with_acknowledgements, world, profile, payload)
        (end, _), repairs = lax.scan(step, (begin, _Writer.new(write)), _merged(write, rows))
    else:
        end, repairs = lax.scan(partial(_step, world, profile, payload), begin, rows)
    return end.received[: arrival.shape[0]], end.released[: arrival.shape[0]], repairs


def _step(
    world: World, profile: Profile, payload: int, reader: Reader, row: tuple[Array, Array, Array, Array]
) -> tuple[Reader, Repairs]:
    arrival, first, last, alone = row
    reader, asked = ask(world, profile, payload, reader, reader.timer < arrival)
    reader, at_once = hear(profile, reader, arrival, first, last)
    confirmed, never = jnp.where(alone & ~at_once, arrival, jnp.inf), jnp.full_like(arrival, jnp.inf)
    return reader, Repairs(asked.sent, asked.answered, asked.samples, asked.packets, confirmed, arrival, first, never)


def _merged(write: Array, rows: tuple[Array, ...]) -> tuple[Array, ...]:
    """What is written (without `first`) and what may carry a heartbeat when it comes, in the order of time."""
    own = jnp.arange(write.shape[0], dtype=jnp.int32)
    written = (write, jnp.full_like(own, -1), own, jnp.zeros_like(own, bool))
    both = [jnp.concatenate(each) for each in zip(written, rows, strict=True)]
    kind = jnp.concatenate([jnp.ones_like(own, bool), jnp.zeros(rows[0].shape, bool)])
    order = jnp.argsort(both[0])
    return tuple(each[order] for each in (*both, kind))


def _with_acknowledgements(
    world: World, profile: Profile, payload: int, state: tuple[Reader, _Writer], row: tuple[Array, ...]
) -> tuple[tuple[Reader, _Writer], Repairs]:
    """A step where the writer's heartbeats hang on what has been acknowledged."""
    reader, writer = state
    now, first, last, alone, written = row
    count = reader.count
    reader, asked = ask(world, profile, payload, reader, reader.timer < now)
    writer = _told(writer, asked, count, reader.count > count, now)
    carries = written & jnp.isfinite(now) & _full(world, profile, writer, now, last)
    known = jnp.where(written, carries, writer.carries[last])
    writer = replace(writer, carries=writer.carries.at[last].set(known))
    heard = jnp.where(~written & (alone | known), now, jnp.inf)
    reader, _ = hear(profile, reader, heard, first, last)
    carrying = jnp.where(carries, now, jnp.inf)
    return (reader, writer), Repairs(
        asked.sent, asked.answered, asked.samples, asked.packets, asked.confirms, heard, first, carrying
    )


def _told(writer: _Writer, asked: Asked, count: Array, sent: Array, now: Array) -> _Writer:
    """Takes down an ACKNACK that is sent, in the place of the oldest."""
    place = count % _IN_FLIGHT
    arrives = writer.arrives.at[place].set(jnp.where(sent, asked.arrives, writer.arrives[place]))
    base = writer.base.at[place].set(jnp.where(sent, asked.base, writer.base[place]))
    return _Writer(arrives, base, writer.acknowledged(now), writer.carries)


def _full(world: World, profile: Profile, writer: _Writer, now: Array, number: Array) -> Array:
    """Whether the history holds as many unacknowledged samples as it takes, sample `number` being the newest."""
    if profile.depth is None:
        return jnp.zeros((), bool)
    oldest = number - profile.depth + 1
    return (oldest >= writer.acknowledged(now)) & (world.gone[jnp.maximum(oldest, 0)] > now)
