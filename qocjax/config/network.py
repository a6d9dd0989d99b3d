"""Configuration of networks: one model for each kind."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from qocjax.config.cell import CellConfig
from qocjax.config.delay import Delay, EdgeConfig, LegConfig
from qocjax.config.part import Part
from qocjax.config.trace import TraceConfig
from qocjax.network import LoopNetwork, Network, kth_5g_network, with_edge
from qocjax.network.dds import DdsNetwork, Profile, Topic

__all__ = ["DdsConfig", "NetworkConfig"]


class LoopNetworkConfig(Part):
    """Uplink, compute and downlink from a law each."""

    kind: Literal["loop"]
    name: str
    uplink: LegConfig
    compute: Delay
    downlink: LegConfig
    edge: EdgeConfig

    def build(self) -> Network:
        """The network."""
        path = LoopNetwork(
            uplink=self.uplink.build(), compute=self.compute.build(), downlink=self.downlink.build(), name=self.name
        )
        return with_edge(path, self.edge.build())


class Kth5gConfig(Part):
    """Measured private 5G one-way delays around the paper's compute time."""

    kind: Literal["kth_5g"]
    compute_mean: float
    compute_std: float
    uplink_loss: float
    downlink_loss: float
    edge: EdgeConfig

    def build(self) -> Network:
        """The network."""
        path = kth_5g_network(self.compute_mean, self.compute_std, self.uplink_loss, self.downlink_loss)
        return with_edge(path, self.edge.build())


class ProfileConfig(Part):
    """QoS of a ROS 2 topic with the protocol's timers."""

    reliability: str
    depth: int | None
    reader_depth: int | None
    lifespan: float
    lifespan_from: str
    deadline: float
    heartbeat_period: float
    piggyback: str
    acknack_delay: float
    nack_period: float
    repair_delay: float
    repair_packet: int

    def build(self) -> Profile:
        """The profile."""
        return Profile(**self.model_dump())


class TopicConfig(LegConfig):
    """One direction of ROS 2 topics."""

    profile: ProfileConfig
    payload: int
    in_order: bool

    def build(self) -> Topic:
        """The topic."""
        return Topic(self.delay.build(), self.loss.build(), self.profile.build(), self.payload, self.in_order)


class DdsConfig(Part):
    """ROS 2 topics up and down, BEST_EFFORT or RELIABLE."""

    kind: Literal["dds"]
    name: str
    uplink: TopicConfig
    compute: Delay
    downlink: TopicConfig
    edge: EdgeConfig

    def build(self) -> Network:
        """The network."""
        path = DdsNetwork(
            uplink=self.uplink.build(), compute=self.compute.build(), downlink=self.downlink.build(), name=self.name
        )
        return with_edge(path, self.edge.build())


NetworkConfig = Annotated[
    LoopNetworkConfig | Kth5gConfig | TraceConfig | DdsConfig | CellConfig, Field(discriminator="kind")
]
