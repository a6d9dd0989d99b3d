"""One direction as a channel: every random number of a seed, drawn ahead (model, section 8)."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from qocjax import _draws
from qocjax.network.interface import DelayLaw
from qocjax.network.loop_network import Leg

__all__ = ["PACKETS", "Channel", "Fates", "Messages", "channel", "lost_at", "message_fates"]

PACKETS = 8  # packets of repairs that answer one ACKNACK; what does not fit into seven goes into the last
_CYCLE = 256  # ACKNACKs after which their random numbers come round again
_ROUNDING = 1e-3  # of a sampling period, what float32 leaves of a time of some thousand of them


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Fates:
    """Delay of messages, and the level below which the channel's loss probability loses them."""

    delay: Array  # [...] s
    level: Array  # [...] uniform on [0, 1)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Channel:
    """Loss probability of one direction of one robot over time, the same for data and control messages."""

    chance: Array  # [P], of a message sent in [t_p, t_p + tau)
    tau: Array  # s


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Messages:
    """All messages of one direction."""

    data: Fates  # [N, P], by loop
    heartbeats: Fates  # [N, M]
    acknacks: Fates  # [N, K], for the topic of the other direction
    packets: Fates  # [N, K, C], of repairs


def channel(leg: Leg, key: Array, num_ticks: int, num_robots: int, tau: float) -> Channel:
    """Draws the state of the channels of all robots: `chance` [N, P]."""
    chance = leg.loss.chance(key, num_ticks, num_robots).T  # type: ignore[attr-defined]
    return Channel(chance, jnp.full((num_robots,), tau, chance.dtype))


def lost_at(link: Channel, time: Array, level: Array, pieces: Array | None = None) -> Array:
    """Whether messages sent at `time` (s) are lost, with any of their pieces; the channel ends as in the last tick."""
    last = link.chance.shape[0] - 1
    tick = jnp.floor(jnp.where(jnp.isfinite(time), time, 0.0) / link.tau + _ROUNDING)
    chance = link.chance[jnp.clip(tick.astype(jnp.int32), 0, last)]
    return level < (chance if pieces is None else jnp.where(pieces == 1, chance, 1.0 - (1.0 - chance) ** pieces))


def message_fates(
    laws: tuple[DelayLaw, DelayLaw], keys: Array, num_ticks: int, num_robots: int, heartbeats: tuple[int, int]
) -> list[Messages]:
    """Draws what happens to all messages of both directions, in one go since laws take long to compile.

    Args:
        laws: Delays of the two directions.
        keys: Random keys of the two [2].
        num_ticks: P.
        num_robots: N.
        heartbeats: M of the two.
    """

    def draw(law: DelayLaw, key: Array, alone: int) -> Fates:
        of_delay, of_level = jax.random.split(key)
        shape = (num_ticks + alone + _CYCLE * (PACKETS + 1), num_robots)
        return Fates(law.sample(of_delay, shape), _draws.uniform(of_level, shape))

    if laws[0] == laws[1] and heartbeats[0] == heartbeats[1]:
        both = jax.vmap(lambda key: draw(laws[0], key, heartbeats[0]))(keys)
        ways = [jax.tree.map(lambda a, k=k: a[k], both) for k in range(2)]
    else:
        ways = [draw(law, key, alone) for law, key, alone in zip(laws, keys, heartbeats, strict=True)]
    return [_cut(way, num_ticks, alone) for way, alone in zip(ways, heartbeats, strict=True)]


def _cut(fates: Fates, num_ticks: int, heartbeats: int) -> Messages:
    asked, packets = num_ticks + heartbeats, num_ticks + heartbeats + _CYCLE

    def part(begin: int, end: int | None) -> Fates:
        return jax.tree.map(lambda a: a[begin:end].T, fates)

    repairs = jax.tree.map(lambda a: a.reshape(a.shape[0], _CYCLE, PACKETS), part(packets, None))
    return Messages(part(0, num_ticks), part(num_ticks, asked), part(asked, packets), repairs)
