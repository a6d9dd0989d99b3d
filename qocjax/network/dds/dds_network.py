"""The network `dds`: uplink topic, compute, downlink topic (model, section 8)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax.network._fields import no_nan, store_float
from qocjax.network.completion import latest
from qocjax.network.dds.link import Channel
from qocjax.network.dds.transport import Topic, TopicDraws, Traffic, carry, draw_channels, draw_topics
from qocjax.network.empirical import Empirical
from qocjax.network.interface import DelayLaw, loop_times
from qocjax.network.parametric import Constant

__all__ = ["DdsNetwork", "Draws", "Loops"]

_F_SEEDS, _F_TICKS = 32, 2048  # loops behind F(deadline)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Draws:
    """What chance decides of N robots: both topics and the times of computation [N, P] s."""

    uplink: TopicDraws
    compute: Array
    downlink: TopicDraws


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Loops:
    """The loops of one seed, part by part, and what they put on the links."""

    uplink: Array  # [P, N] s from sampling until the edge has the sample, inf for never
    compute: Array  # [P, N] s
    downlink: Array  # [P, N] s from the end of the computation until the robot has the command, inf for never
    uplink_traffic: Traffic  # each [N, ...]
    downlink_traffic: Traffic  # each [N, ...]

    @property
    def loop_time(self) -> Array:
        """T_net [P, N] s, inf where a message of the loop is never handed over."""
        return self.uplink + self.compute + self.downlink


@dataclass(frozen=True, kw_only=True)
class DdsNetwork:
    """Loops over two ROS 2 topics: state up, a computation, the command down.

    The edge computes each sample when it is handed over, as many at a time as there are, and writes a command when its
    computation ends; sequence numbers of commands follow these times. Robots have topics of their own. What is not a
    sample (heartbeats, ACKNACKs, repairs) takes delays of the same laws, and meets the same channels.
    """

    uplink: Topic = field(default_factory=Topic)
    compute: DelayLaw = field(default_factory=Constant)
    downlink: Topic = field(default_factory=Topic)
    name: str = "dds"
    period: float = 0.01  # s, sampling period that `reliability` is said for

    def __post_init__(self) -> None:
        for leg in ("uplink", "downlink"):
            if not isinstance(getattr(self, leg), Topic):
                raise TypeError(f"DdsNetwork.{leg}: got {getattr(self, leg)!r}, expected a Topic")
        if not isinstance(self.compute, DelayLaw):
            raise TypeError(f"DdsNetwork.compute: got {self.compute!r}, expected a delay law")
        store_float(self, "period", above=0.0)

    def with_qos(self, **changes: Any) -> DdsNetwork:
        """Returns the network with another QoS on both topics, see `Profile`."""
        up, down = (replace(t, profile=replace(t.profile, **changes)) for t in (self.uplink, self.downlink))
        return replace(self, uplink=up, downlink=down)

    def draws(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Draws:
        """Draws all that chance decides; arguments as for `draw`."""
        of_topics, of_compute = jax.random.split(key)
        up, down = draw_topics((self.uplink, self.downlink), of_topics, num_ticks, num_robots, tau)
        return Draws(up, self.compute.sample(of_compute, (num_ticks, num_robots)).T, down)

    def channels(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> tuple[Channel, Channel]:
        """Draws the loss probabilities of both directions alone, those that `draws` has for the same key."""
        of_topics, _ = jax.random.split(key)
        return draw_channels((self.uplink, self.downlink), of_topics, num_ticks, num_robots, tau)

    def loops_from(self, draws: Draws, tau: float) -> Loops:
        """Works out the loops from what was drawn; no law of delay or loss is read here."""
        sampled = jnp.arange(draws.compute.shape[1], dtype=draws.compute.dtype) * tau

        def one_robot(draws: Draws) -> tuple[Array, Array, Traffic, Traffic]:
            up, down = draws.uplink, draws.downlink
            there, up_traffic = carry(sampled, up, down.link, self.uplink)
            ready = sampled + there + draws.compute
            order = jnp.argsort(ready)
            down = replace(down, data=jax.tree.map(lambda a: a[order], down.data))
            back, down_traffic = carry(ready[order], down, up.link, self.downlink)
            return there, jnp.zeros_like(back).at[order].set(back), up_traffic, down_traffic

        there, back, up_traffic, down_traffic = jax.vmap(one_robot)(draws)
        return Loops(there.T, draws.compute.T, back.T, up_traffic, down_traffic)

    def loops(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Loops:
        """Simulates the loops of one Monte Carlo seed; arguments as for `draw`."""
        return self.loops_from(self.draws(key, num_ticks, num_robots, tau), tau)

    def draw(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Array:
        """Draws the loop times of one Monte Carlo seed, [P, N] s, inf where lost."""
        return self.loops(key, num_ticks, num_robots, tau).loop_time

    def reliability(self, deadline: Any) -> np.ndarray:
        """Returns F(deadline) at the sampling period `period`, from 65536 simulated loops, float64, same shape.

        It says how many loops complete, not how they come: repairs stall loops, then deliver them in bursts.

        Raises:
            ValueError: A deadline is NaN.
        """
        return self._law.cdf(latest(no_nan("deadline", deadline)))

    def describe(self) -> dict[str, Any]:
        """Returns the network as plain values."""
        legs = {
            leg: topic.describe()
            | {"profile": topic.profile.describe(), "payload": topic.payload, "in_order": topic.in_order}
            for leg, topic in (("uplink", self.uplink), ("downlink", self.downlink))
        }
        return {"kind": type(self).__name__, "name": self.name, "period": self.period} | legs | {
            "compute": self.compute.describe()
        }  # fmt: skip

    @cached_property
    def _law(self) -> Empirical:
        keys = jax.random.split(jax.random.key(0), _F_SEEDS)
        return Empirical(np.asarray(loop_times(self, keys, _F_TICKS, 1, self.period), np.float64).ravel())
