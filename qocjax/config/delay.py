"""Configuration of what happens to one message: delay laws, loss processes, and the edge that computes on it."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from qocjax.config.part import Part
from qocjax.network import (
    Constant,
    Edge,
    Empirical,
    GilbertElliott,
    IndependentLoss,
    Leg,
    QuantileTable,
    ShiftedGamma,
    ShiftedLogNormal,
    TruncatedNormal,
    read_histogram,
    read_samples,
)

__all__ = ["Computing", "Delay", "EdgeConfig", "LegConfig"]


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


def _law(value: Any) -> Any:
    """A number for a law that always takes that long."""
    if value is None or isinstance(value, (dict, Part)):
        return value
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not 0 <= value < math.inf:
        raise PydanticCustomError("computing", "a finite number of s >= 0, such as 0.02, or a law")
    return {"law": "constant", "value": float(value)}


Computing = Annotated[Delay | None, BeforeValidator(_law)]
"""Law of a computing time, or a number of s for a constant one; None where nothing says it."""


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


class EdgeConfig(Part):
    """Workers of the edge; a discipline of null is what the command takes for granted."""

    workers: int
    per_robot: bool
    discipline: str | None
    abort: bool

    @classmethod
    def usual(cls) -> EdgeConfig:
        """Where nothing is said of it, as `conf/edge/default.yaml` has it."""
        return cls(workers=1, per_robot=True, discipline=None, abort=False)

    def build(self) -> Edge:
        """The edge."""
        return Edge(**self.model_dump() | {"discipline": self.discipline or "unlimited"})
