"""Configuration of networks: one model for each delay law, loss process and kind of network."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from qocjax.config.part import Part
from qocjax.network import (
    Constant,
    Empirical,
    GilbertElliott,
    IndependentLoss,
    Leg,
    LoopNetwork,
    QuantileTable,
    ShiftedGamma,
    ShiftedLogNormal,
    Trace,
    TruncatedNormal,
    kth_5g_network,
    read_histogram,
    read_samples,
    read_trace,
)
from qocjax.network.dds import DdsNetwork, Profile, Topic
from qocjax.recorded.as_trace import read_file, trace_of
from qocjax.recorded.formats import FORMATS, found_format
from qocjax.recorded.run import RecordedRun

__all__ = ["NetworkConfig"]


class ConstantDelay(Part):
    """The same delay for every message."""

    law: Literal["constant"]
    value: float

    def build(self) -> Constant:
        """The law."""
        return Constant(self.value)


class TruncatedNormalDelay(Part):
    """Normal, cut at `low` and `high`."""

    law: Literal["truncated_normal"]
    mean: float
    std: float
    low: float = 0.0
    high: float = float("inf")

    def build(self) -> TruncatedNormal:
        """The law."""
        return TruncatedNormal(self.mean, self.std, self.low, self.high)


class GammaDelay(Part):
    """Gamma above a shift."""

    law: Literal["gamma"]
    shift: float
    shape: float
    scale: float

    def build(self) -> ShiftedGamma:
        """The law."""
        return ShiftedGamma(self.shift, self.shape, self.scale)


class LogNormalDelay(Part):
    """Log-normal above a shift."""

    law: Literal["log_normal"]
    shift: float
    median: float
    sigma: float

    def build(self) -> ShiftedLogNormal:
        """The law."""
        return ShiftedLogNormal(self.shift, self.median, self.sigma)


class SamplesDelay(Part):
    """A column of measured delays."""

    law: Literal["samples"]
    path: str
    column: str
    unit: str | None = None
    separator: str | None = None

    def build(self) -> Empirical:
        """The law."""
        return read_samples(self.path, self.column, self.unit, separator=self.separator)


class HistogramDelay(Part):
    """A measured histogram (XML, bins in ms)."""

    law: Literal["histogram"]
    path: str

    def build(self) -> QuantileTable:
        """The law."""
        return read_histogram(self.path)


Delay = Annotated[
    ConstantDelay | TruncatedNormalDelay | GammaDelay | LogNormalDelay | SamplesDelay | HistogramDelay,
    Field(discriminator="law"),
]


class IndependentLossConfig(Part):
    """Each message lost with the same probability."""

    process: Literal["independent"]
    probability: float

    def build(self) -> IndependentLoss:
        """The process."""
        return IndependentLoss(self.probability)


class GilbertElliottConfig(Part):
    """Losses in bursts."""

    process: Literal["gilbert_elliott"]
    p_good_to_bad: float
    p_bad_to_good: float
    loss_good: float = 0.0
    loss_bad: float = 1.0

    def build(self) -> GilbertElliott:
        """The process."""
        return GilbertElliott(self.p_good_to_bad, self.p_bad_to_good, self.loss_good, self.loss_bad)


class LegConfig(Part):
    """One direction."""

    delay: Delay
    loss: Annotated[IndependentLossConfig | GilbertElliottConfig, Field(discriminator="process")]

    def build(self) -> Leg:
        """The leg."""
        return Leg(self.delay.build(), self.loss.build())


class LoopNetworkConfig(Part):
    """Uplink, compute and downlink from a law each."""

    kind: Literal["loop"]
    name: str
    uplink: LegConfig
    compute: Delay
    downlink: LegConfig

    def build(self) -> LoopNetwork:
        """The network."""
        return LoopNetwork(
            uplink=self.uplink.build(), compute=self.compute.build(), downlink=self.downlink.build(), name=self.name
        )


class Kth5gConfig(Part):
    """Measured private 5G one-way delays around the paper's compute time."""

    kind: Literal["kth_5g"]
    compute_mean: float
    compute_std: float
    uplink_loss: float
    downlink_loss: float

    def build(self) -> LoopNetwork:
        """The network."""
        return kth_5g_network(self.compute_mean, self.compute_std, self.uplink_loss, self.downlink_loss)


class TraceConfig(Part):
    """A measured trace, replayed in order."""

    kind: Literal["trace"]
    path: str
    column: str | None = None
    unit: str | None = None
    sequence: str | None = None
    gaps_are_lost: bool = False
    separator: str | None = None
    period: float | None = None
    stamp: str | None = None
    stamp_unit: str | None = None
    faster_than_measured: bool = False  # whether `SimulationConfig.check_rate` lets it pass

    def build(self) -> Trace:
        """The network; without a column, what is in the file."""
        if self.column is None:
            given = [name for name in ("sequence", "separator", "stamp") if getattr(self, name) is not None]
            if given:
                raise ValueError(f"network.column: got nothing with {given[0]}, expected the name of the loop times'")
            return trace_of(self.read(), self.path, self.period)
        try:
            return self._table()
        except ValueError as error:
            kind = found_format(Path(self.path)) if "has no column" in str(error) else None
            if kind is None:
                raise
            raise ValueError(f"{error}; without network.column it is read as {FORMATS[kind].TITLE}") from None

    def _table(self) -> Trace:
        assert self.column is not None
        return read_trace(
            self.path,
            self.column,
            self.unit,
            sequence=self.sequence,
            gaps_are_lost=self.gaps_are_lost,
            separator=self.separator,
            period=self.period,
            stamp=self.stamp,
            stamp_unit=self.stamp_unit,
        )

    def read(self) -> RecordedRun:
        """What is in the file."""
        return read_file(self.path, self.unit, self.gaps_are_lost)


class ProfileConfig(Part):
    """QoS of a ROS 2 topic with the protocol's timers."""

    reliability: str
    depth: int | None
    reader_depth: int | None
    lifespan: float
    deadline: float
    heartbeat_period: float
    piggyback: bool
    acknack_delay: float
    nack_period: float
    repair_delay: float

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

    def build(self) -> DdsNetwork:
        """The network."""
        return DdsNetwork(
            uplink=self.uplink.build(), compute=self.compute.build(), downlink=self.downlink.build(), name=self.name
        )


NetworkConfig = Annotated[LoopNetworkConfig | Kth5gConfig | TraceConfig | DdsConfig, Field(discriminator="kind")]
