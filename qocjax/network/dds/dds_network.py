"""The network `dds`: uplink topic, compute, downlink topic (model, section 8)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from qocjax.network.dds.link import Channel
from qocjax.network.dds.transport import Topic, TopicDraws, Traffic, carry, draw_channels, draw_topics
from qocjax.network.edge import Edge
from qocjax.network.estimate import simulated
from qocjax.network.interface import DelayLaw, Load, Reliability, Serve
from qocjax.network.parametric import Constant

__all__ = ["DdsNetwork", "Draws", "Loops"]

_F_TICKS = 2048  # loops of each run behind F(deadline)


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
    ended: Array  # [P, N] s from sampling until the computation ends, inf for never
    downlink: Array  # [P, N] s from the end of the computation until the robot has the command, inf for never
    uplink_traffic: Traffic  # each [N, ...]
    downlink_traffic: Traffic  # each [N, ...]

    @property
    def loop_time(self) -> Array:
        """T_net [P, N] s, inf where a message of the loop is never handed over."""
        return self.ended + self.downlink


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

    def __post_init__(self) -> None:
        for leg in ("uplink", "downlink"):
            if not isinstance(getattr(self, leg), Topic):
                raise TypeError(f"DdsNetwork.{leg}: got {getattr(self, leg)!r}, expected a Topic")
        if not isinstance(self.compute, DelayLaw):
            raise TypeError(f"DdsNetwork.compute: got {self.compute!r}, expected a delay law")

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

    def loops_from(self, draws: Draws, tau: Array | float, edge: Edge | None = None) -> Loops:
        """Works out the loops of one seed from what was drawn; no law of delay or loss is read here.

        Args:
            draws: From `draws`.
            tau: s.
            edge: The workers, by default one for each sample; it gives nothing up.
        """
        there, up_traffic = self._up(draws, tau)
        served = (edge or Edge()).serve(there, draws.compute.T, tau, 0.0)
        back, down_traffic = self._down(draws, served.ended, tau)
        return Loops(there, served.ended, back, up_traffic, down_traffic)

    @property
    def alike(self) -> bool:
        """Whether all samples that are handed over at the edge take the same time to: not told here."""
        return False

    def draw_parts(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Draws:
        """Draws what chance decides, before any edge; arguments as for `draw`."""
        return self.draws(key, num_ticks, num_robots, tau)

    def through(self, parts: Draws, serve: Serve, tau: Array | float) -> Array:
        """Loop times [D, S, P, N] s of loops that are served by an edge (see `Path` in `edge_network`)."""
        there, _ = jax.vmap(lambda draws: self._up(draws, tau))(parts)
        ended = serve(there, jnp.swapaxes(parts.compute, -1, -2))

        def back(draws: Draws, at: Array) -> Array:
            return at + self._down(draws, at, tau)[0]

        return jax.vmap(jax.vmap(back), (None, 0))(parts, ended)

    def _up(self, draws: Draws, tau: Array | float) -> tuple[Array, Traffic]:
        """Time from sampling until the edge has each sample, [P, N] s, and the traffic, each [N, ...]."""
        there, traffic = jax.vmap(lambda up, back: carry(_sampled(draws, tau), up, back, self.uplink))(
            draws.uplink, draws.downlink.link
        )
        return there.T, traffic

    def _down(self, draws: Draws, ended: Array, tau: Array | float) -> tuple[Array, Traffic]:
        """Time from the end of each computation, [P, N] s since sampling, until the robot has the command."""

        def one_robot(at: Array, down: TopicDraws, back: Channel) -> tuple[Array, Traffic]:
            ready = _sampled(draws, tau) + at
            order = jnp.argsort(ready)
            down = replace(down, data=jax.tree.map(lambda a: a[order], down.data))
            taken, traffic = carry(ready[order], down, back, self.downlink)
            return jnp.zeros_like(taken).at[order].set(taken), traffic

        back, traffic = jax.vmap(one_robot)(ended.T, draws.downlink, draws.uplink.link)
        return back.T, traffic

    def loops(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Loops:
        """Simulates the loops of one Monte Carlo seed; arguments as for `draw`."""
        return self.loops_from(self.draws(key, num_ticks, num_robots, tau), tau)

    def draw(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Array:
        """Draws the loop times of one Monte Carlo seed, [P, N] s, inf where lost."""
        return self.loops(key, num_ticks, num_robots, tau).loop_time

    def reliability(self, deadline: Any, load: Load) -> Reliability:
        """Estimates F(deadline) at the load's sampling period from 65536 simulated loops of one robot.

        It says how many loops complete, not how they come: repairs stall loops, then deliver them in bursts.

        Raises:
            ValueError: A deadline is NaN.
        """
        return simulated(self, deadline, Load(_F_TICKS, 1, load.tau))

    def describe(self) -> dict[str, Any]:
        """Returns the network as plain values."""
        legs = {
            leg: topic.describe()
            | {"profile": topic.profile.describe(), "payload": topic.payload, "in_order": topic.in_order}
            for leg, topic in (("uplink", self.uplink), ("downlink", self.downlink))
        }
        return {"kind": type(self).__name__, "name": self.name} | legs | {
            "compute": self.compute.describe()
        }  # fmt: skip


def _sampled(draws: Draws, tau: Array | float) -> Array:
    """Sampling instants [P] s."""
    return jnp.arange(draws.compute.shape[1], dtype=draws.compute.dtype) * tau
