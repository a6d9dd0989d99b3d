"""Loops of one network under several QoS profiles and channels, on common random numbers (model, section 8).

Delays are drawn once, for all profiles and channels; a channel changes the loss probabilities alone. So a program is
compiled for each profile, not for each channel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax import _checks
from qocjax._pieces import Arrays, kept
from qocjax.network import Edge
from qocjax.network.dds import DdsNetwork, Topic, Traffic, per_second
from qocjax.network.dds.dds_network import Draws, Loops
from qocjax.network.dds.delivery import missed_periods
from qocjax.network.dds.statistics import loop_statistics
from qocjax.network.demand import Carrier
from qocjax.network.interface import LossProcess
from qocjax.network.loss import GilbertElliott, IndependentLoss

__all__ = ["Sent", "bursty_loss", "run_transport", "traffic_row", "transport_row"]


def bursty_loss(probability: float, burst: float) -> LossProcess:
    """A loss process of a given share of lost messages and mean length of a burst in sampling periods; 1: independent.

    Raises:
        ValueError: Out of range, or a share that bursts of that length cannot have.
    """
    _checks.bounded("loss", probability, least=0.0, most=0.99, shape=())
    _checks.bounded("burst", burst, least=1.0, shape=())
    if burst == 1.0 or probability == 0.0:
        return IndependentLoss(probability)
    begin = probability / (1.0 - probability) / burst
    if begin > 1.0:
        raise ValueError(
            f"loss: got {probability:g} with bursts of {burst:g}, expected at most {burst / (1 + burst):.3g}"
        )
    return GilbertElliott(begin, 1.0 / burst)


_WAYS = ("uplink", "downlink")


@dataclass(frozen=True)
class Sent:
    """Loop times of all seeds, and what was sent in each second by all robots."""

    loop_times: np.ndarray  # [S, P, N] s
    uplink: dict[str, np.ndarray]  # messages by kind, and bytes by direction, each [S, seconds]
    downlink: dict[str, np.ndarray]
    missed_periods: np.ndarray  # [S, N] of the commands' DEADLINE

    def arrays(self) -> Arrays:
        """All of it under names of its own."""
        found = {"loop_times": self.loop_times, "missed_periods": self.missed_periods}
        return found | {f"{way}.{name}": values for way in _WAYS for name, values in getattr(self, way).items()}

    @staticmethod
    def of_arrays(arrays: Arrays) -> Sent:
        """What `arrays` gave."""
        up, down = ({name.removeprefix(f"{way}."): values for name, values in arrays.items()
                     if name.startswith(f"{way}.")} for way in _WAYS)  # fmt: skip
        return Sent(arrays["loop_times"], up, down, arrays["missed_periods"])


def run_transport(
    network: DdsNetwork,
    loss: LossProcess,
    keys: Array,
    num_ticks: int,
    num_robots: int,
    tau: float,
    edge: Edge | None = None,
) -> Sent:
    """Simulates the loops of a network, its losses replaced on both directions.

    Args:
        network: Laws of delay, topics and their QoS.
        loss: Of both directions.
        keys: [S] of the Monte Carlo seeds.
        num_ticks: P.
        num_robots: N.
        tau: s.
        edge: The workers, by default one for each sample; it gives nothing up.
    """
    values = network, loss, keys, num_ticks, num_robots, tau, edge or Edge()
    return Sent.of_arrays(kept(("transport", *values), lambda: _simulated(*values).arrays()))


def _simulated(
    network: DdsNetwork, loss: LossProcess, keys: Array, num_ticks: int, num_robots: int, tau: float, edge: Edge
) -> Sent:
    clear = _with_loss(network, IndependentLoss())
    shape = (num_ticks, num_robots, tau)
    plain = clear.with_qos(reliability="best_effort", depth=1, reader_depth=None, lifespan=np.inf, deadline=np.inf)
    drawn = _draws(plain, keys, *shape)
    up, down = _channels(_with_loss(plain, loss), keys, *shape)
    drawn = replace(drawn, uplink=replace(drawn.uplink, link=up), downlink=replace(drawn.downlink, link=down))
    found = jax.tree.map(np.asarray, _loops(clear, drawn, tau, edge))
    return Sent(*found)


def _with_loss(network: DdsNetwork, loss: LossProcess) -> DdsNetwork:
    return replace(network, uplink=replace(network.uplink, loss=loss), downlink=replace(network.downlink, loss=loss))


@partial(jax.jit, static_argnums=(0, 2, 3, 4))
def _draws(network: DdsNetwork, keys: Array, num_ticks: int, num_robots: int, tau: float) -> Draws:
    return jax.vmap(lambda key: network.draws(key, num_ticks, num_robots, tau))(keys)


@partial(jax.jit, static_argnums=(0, 2, 3, 4))
def _channels(network: DdsNetwork, keys: Array, num_ticks: int, num_robots: int, tau: float) -> tuple:
    return jax.vmap(lambda key: network.channels(key, num_ticks, num_robots, tau))(keys)


@partial(jax.jit, static_argnums=(0, 2, 3))
def _loops(network: DdsNetwork, draws: Draws, tau: float, edge: Edge) -> tuple:
    return jax.vmap(lambda one: _one_seed(network, one, tau, edge))(draws)


def _one_seed(network: DdsNetwork, draws: Draws, tau: float, edge: Edge) -> tuple:
    loops: Loops = network.loops_from(draws, tau, edge)
    ticks = loops.ended.shape[0]
    seconds = max(int(ticks * tau + 1e-6), 1)

    def counted(topic: Topic, traffic: Traffic) -> dict[str, Array]:
        each = jax.vmap(lambda one: per_second(topic, one, seconds))(traffic)
        return jax.tree.map(lambda a: jnp.sum(a, axis=0), each)

    landed = loops.loop_time + jnp.arange(ticks, dtype=loops.ended.dtype)[:, None] * tau
    period = network.downlink.profile.deadline
    missed = jax.vmap(lambda handed: missed_periods(handed, period, ticks * tau), in_axes=1)(landed)
    return (
        loops.loop_time, counted(network.uplink, loops.uplink_traffic),
        counted(network.downlink, loops.downlink_traffic), missed,
    )  # fmt: skip


def transport_row(sent: Sent, tau: float) -> dict[str, float]:
    """Losses and percentiles of the loops that end within the run, ages, missed periods of the DEADLINE per second."""
    times = np.moveaxis(sent.loop_times, 1, -1)
    settled = max(times.shape[-1] - int(np.ceil(1.0 / tau)), 1)  # what is lost at the very end may only be late
    found = loop_statistics(times[..., :settled], tau)
    seconds = times.shape[-1] * tau
    return found | {"periods_missed_per_s": float(sent.missed_periods.mean()) / seconds}


def traffic_row(sent: Sent, carrier: Carrier) -> dict[str, float]:
    """Messages and bytes per second of all robots, over seeds and seconds, and resource blocks.

    The blocks that carry the 99th percentile of a second are what a network must set aside; the mean is what it serves.
    """
    up, down = sent.uplink, sent.downlink
    found: dict[str, float] = {}
    ways = {"uplink": (up["forward_bytes"] + down["backward_bytes"]),
            "downlink": (down["forward_bytes"] + up["backward_bytes"])}  # fmt: skip
    for way, count in ways.items():
        bits = 8.0 * count
        found |= {
            f"{way}_kbit_s": bits.mean() / 1e3, f"{way}_kbit_s_sd": bits.std() / 1e3,
            f"{way}_blocks": bits.mean() / carrier.rate_per_block(way),
            f"{way}_blocks_p99": np.quantile(bits, 0.99) / carrier.rate_per_block(way),
        }  # fmt: skip
    both = 8.0 * (ways["uplink"] + ways["downlink"])
    found |= {"kbit_s": both.mean() / 1e3, "kbit_s_sd": both.std() / 1e3}
    for kind in ("data", "repairs", "heartbeats", "acknacks"):
        found[f"{kind}_per_s"] = up[kind].mean() + down[kind].mean()
    packets = np.sum([t[k] for t in (up, down) for k in ("data", "repair_packets", "heartbeats", "acknacks")], axis=0)
    found |= {"packets_per_s": packets.mean(), "packets_per_s_sd": packets.std()}
    return {name: float(value) for name, value in found.items()}
