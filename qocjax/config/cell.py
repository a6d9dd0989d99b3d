"""Configuration of a cell that all robots share."""

from __future__ import annotations

from typing import Literal

from qocjax._checks import count
from qocjax.config.delay import Delay, EdgeConfig
from qocjax.config.part import Part
from qocjax.network.cell import Access, CellNetwork, Direction, Frame, OtherTraffic
from qocjax.network.demand import Carrier

__all__ = ["CellConfig"]


class OtherTrafficConfig(Part):
    """What others take of a direction."""

    share: float
    burst_share: float
    burst_length: float
    burst_time: float

    def build(self) -> OtherTraffic:
        """The traffic."""
        return OtherTraffic(**self.model_dump())


class DirectionConfig(Part):
    """Messages of one direction and what the air does to them."""

    message_bytes: float
    mcs: int
    layers: int
    bler: float
    other: OtherTrafficConfig

    def build(self, slot_bits: float) -> Direction:
        """The direction, of which a slot carries that many bits."""
        return Direction(self.message_bytes, slot_bits, self.bler, self.other.build())


class AccessConfig(Part):
    """How a robot comes to send."""

    request_period: float
    grant: float

    def build(self) -> Access:
        """The access."""
        return Access(**self.model_dump())


class CellConfig(Part):
    """One 5G cell for all robots."""

    kind: Literal["cell"]
    name: str
    bandwidth_mhz: int
    numerology: int
    prbs: int | None
    pattern: str
    uplink: DirectionConfig
    downlink: DirectionConfig
    access: AccessConfig
    stagger: bool
    harq_rtt: float
    harq_max: int
    core: float
    compute: Delay
    edge: EdgeConfig

    def carrier(self) -> Carrier:
        """The bandwidth part, at the rates of 3GPP TS 38.306; which slot serves what is the pattern's affair."""
        up, down = self.uplink, self.downlink
        return Carrier(self.bandwidth_mhz, self.numerology, up.mcs, down.mcs, up.layers, down.layers)

    def build(self) -> CellNetwork:
        """The network."""
        carrier = self.carrier()
        blocks = carrier.resource_blocks if self.prbs is None else count("network.prbs", self.prbs)
        if blocks > carrier.resource_blocks:
            raise ValueError(
                f"prbs: got {blocks}, expected at most {carrier.resource_blocks}, all of {self.bandwidth_mhz} MHz"
            )
        slot = 1e-3 / 2**self.numerology
        ways = {
            way: Direction(
                part.message_bytes, blocks * carrier.rate_per_block(way) * slot, part.bler, part.other.build()
            )
            for way, part in (("uplink", self.uplink), ("downlink", self.downlink))
        }
        return CellNetwork(
            **ways, compute=self.compute.build(), frame=Frame(self.pattern, slot), access=self.access.build(),
            stagger=self.stagger, harq_rtt=self.harq_rtt, harq_max=self.harq_max, core=self.core,
            edge=self.edge.build(), name=self.name,
        )  # fmt: skip
