"""One topic between one writer and one reader: samples in, samples out, and what went over the link."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from qocjax import _checks
from qocjax.network.dds.delivery import best_effort, in_sequence, queued
from qocjax.network.dds.heartbeats import alone_count, arriving, gone_times, released
from qocjax.network.dds.link import Channel, Fates, channel, lost_at, message_fates
from qocjax.network.dds.profile import ACKNACK_BYTES, CARRIED_BYTES, HEARTBEAT_BYTES, Profile
from qocjax.network.dds.reliable import Repairs, repair
from qocjax.network.loop_network import Leg

__all__ = ["Topic", "TopicDraws", "Traffic", "carry", "draw_channels", "draw_topics", "per_second"]


@dataclass(frozen=True)
class Topic(Leg):
    """One direction with its QoS: how long a packet takes, whether it is lost, and the topic that goes over it."""

    profile: Profile = Profile()
    payload: int = 100  # bytes of a serialised sample
    in_order: bool = False  # whether samples cannot overtake each other on the link

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.profile, Profile):
            raise TypeError(f"Topic.profile: got {self.profile!r}, expected a Profile")
        if not isinstance(self.in_order, bool):
            raise TypeError(f"Topic.in_order: got {self.in_order!r}, expected True or False")
        object.__setattr__(self, "payload", _checks.count("Topic.payload", self.payload))
        if not hasattr(self.loss, "chance"):
            raise TypeError(f"Topic.loss: got {self.loss!r}, expected a loss process with a chance over time")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class TopicDraws:
    """All random numbers of one direction for N robots."""

    link: Channel  # chance [N, P], tau [N]
    data: Fates  # [N, P], by loop
    heartbeats: Fates  # [N, M]
    acknacks: Fates  # [N, K], they go the other way
    packets: Fates  # [N, K, C]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Traffic:
    """When messages of one topic are sent (s, inf for none) and what they weigh."""

    data: Array  # [P] s
    carrying: Array  # [P or J] s, samples that carry a heartbeat
    heartbeats: Array  # [M] s
    repairs: Array  # [J] s, when the writer answers an ACKNACK
    repair_samples: Array  # [J]
    repair_packets: Array  # [J]
    acknacks: Array  # [2J] s, from reader to writer


def draw_topics(
    topics: tuple[Topic, Topic], key: Array, num_ticks: int, num_robots: int, tau: float
) -> tuple[TopicDraws, TopicDraws]:
    """Draws all that chance decides of two opposite directions; the same whatever reliability and depth.

    Args:
        topics: The two directions.
        key: Random key.
        num_ticks: P.
        num_robots: N.
        tau: s.
    """
    counts = [alone_count(topic.profile, num_ticks, tau) for topic in topics]
    laws = (topics[0].delay, topics[1].delay)
    up, down = message_fates(laws, _keys(key)[:, 1], num_ticks, num_robots, (counts[0], counts[1]))
    links = draw_channels(topics, key, num_ticks, num_robots, tau)
    return (
        TopicDraws(links[0], up.data, up.heartbeats, down.acknacks, up.packets),
        TopicDraws(links[1], down.data, down.heartbeats, up.acknacks, down.packets),
    )


def draw_channels(
    topics: tuple[Topic, Topic], key: Array, num_ticks: int, num_robots: int, tau: float
) -> tuple[Channel, Channel]:
    """Draws the channels of two opposite directions alone, as `draw_topics` has them for the same key."""
    up, down = (channel(topic, of_link, num_ticks, num_robots, tau)
                for topic, of_link in zip(topics, _keys(key)[:, 0], strict=True))  # fmt: skip
    return up, down


def _keys(key: Array) -> Array:
    """Keys of channel and messages [2] for each direction [2]."""
    return jax.random.split(key, (2, 2))


def carry(write: Array, draws: TopicDraws, back: Channel, topic: Topic) -> tuple[Array, Traffic]:
    """Carries the samples of one robot.

    Args:
        write: [P] s, nondecreasing, inf for samples never written.
        draws: Of this robot, `data` in the order of `write`.
        back: The channel of the other direction.
        topic: QoS and sizes.

    Returns:
        How long each sample took until it was handed over, [P] s, inf for never; and the traffic.
    """
    arrival = jnp.where(lost_at(draws.link, write, draws.data.level), jnp.inf, write + draws.data.delay)
    arrival = queued(arrival) if topic.in_order else arrival
    empty = jnp.zeros((0,), write.dtype)
    if topic.profile.reliable:
        received, gave_up, heard, repairs = _repaired(write, arrival, draws, back, topic)
        handed = in_sequence(write, received, gave_up, topic.profile)
        acknacks = jnp.concatenate([repairs.asked, repairs.confirmed])
        carrying = write if topic.profile.piggyback == "always" else repairs.carrying
        traffic = Traffic(write, carrying, heard, repairs.answered, repairs.samples, repairs.packets, acknacks)
    else:
        handed = best_effort(write, arrival, topic.profile)
        traffic = Traffic(write, empty, empty, empty, empty, empty, empty)
    written = jnp.where(jnp.isfinite(write), write, 0.0)
    # The delay itself where nothing held the sample up: a difference of times would lose its last digits.
    return jnp.where(handed == written + draws.data.delay, draws.data.delay, handed - written), traffic


def _repaired(
    write: Array, arrival: Array, draws: TopicDraws, back: Channel, topic: Topic
) -> tuple[Array, Array, Array, Repairs]:
    gone = gone_times(write, topic.profile)
    heard = arriving(write, arrival, gone, draws.link, draws.heartbeats, topic.profile)
    count, confirms = write.shape[0], topic.profile.confirms
    told = jnp.full_like(write, jnp.inf) if confirms else released(heard.arrival, heard.first, count)
    received, gave_up, repairs = repair(
        write, arrival, gone, told, heard, (draws.link, back), (draws.acknacks, draws.packets), topic.profile,
        topic.payload,
    )  # fmt: skip
    if confirms:  # which heartbeats there were is known only now
        gave_up = jnp.minimum(gave_up, released(repairs.heard, repairs.first, count))
    return received, gave_up, heard.sent_alone, repairs


def per_second(topic: Topic, traffic: Traffic, seconds: int) -> dict[str, Array]:
    """Messages of one robot and topic in each second, and their bytes on the link each way, [seconds] each."""
    packet, sample = topic.profile.repair_bytes(topic.payload)

    def count(times: Array, weight: Array | int = 1) -> Array:
        second = jnp.floor(jnp.where(jnp.isfinite(times), times, seconds)).astype(jnp.int32)
        return jnp.zeros((seconds,), jnp.int32).at[second].add(weight, mode="drop")

    data, heartbeats, acknacks = count(traffic.data), count(traffic.heartbeats), count(traffic.acknacks)
    carried = count(traffic.carrying) * CARRIED_BYTES
    repairs, packets = (count(traffic.repairs, w.astype(jnp.int32))
                        for w in (traffic.repair_samples, traffic.repair_packets))  # fmt: skip
    forward = data * topic.profile.data_bytes(topic.payload) + carried + heartbeats * HEARTBEAT_BYTES
    return {
        "data": data, "heartbeats": heartbeats, "repairs": repairs, "repair_packets": packets, "acknacks": acknacks,
        "forward_bytes": forward + repairs * sample + packets * packet, "backward_bytes": acknacks * ACKNACK_BYTES,
    }  # fmt: skip
