"""Configuration of `python -m qocjax.codesign`."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from qocjax.config.bounds import Bounds, built_bounds
from qocjax.config.kept import KeptConfig
from qocjax.config.part import Part
from qocjax.config.swept import SweptConfig
from qocjax.network.demand import Carrier, Traffic
from qocjax.search import Limits, Measure, Space

__all__ = ["CodesignConfig"]


class SearchConfig(Part):
    """Where a search moves, and with what."""

    bounds: Bounds
    tau: list[float]
    deadline_ms: list[float] | None
    methods: list[str]
    budget: int
    repetitions: int
    block: int
    choice_seeds: int
    finalists: int
    curve_seeds: int | None
    measure: str
    tail: float


class LimitsConfig(Part):
    """What is asked of a design; null asks nothing."""

    collision_share: float | None
    reliability: float | None
    loops_per_s: float | None
    uplink_kbit_s: float | None
    downlink_kbit_s: float | None
    uplink_blocks: float | None
    downlink_blocks: float | None
    carrier_share: float | None
    workers: float | None

    def build(self) -> Limits:
        """The limits."""
        return Limits(**self.model_dump())


class CarrierConfig(Part):
    """The 5G carrier."""

    bandwidth_mhz: int
    numerology: int
    mcs_uplink: int
    mcs_downlink: int
    layers_uplink: int
    layers_downlink: int
    uplink_share: float
    downlink_share: float


class TrafficConfig(Part):
    """The messages of a loop and their carrier."""

    uplink_bytes: float
    downlink_bytes: float
    carrier: CarrierConfig

    def build(self, plan_bytes: int = 0) -> Traffic:
        """The traffic, its downlink messages larger by the further commands of a plan."""
        return Traffic(self.uplink_bytes, self.downlink_bytes + plan_bytes, Carrier(**self.carrier.model_dump()))


class FrontConfig(Part):
    """The front of QoC against demand."""

    method: str
    budget: int
    against: str
    workers: list[int]


class CodesignConfig(SweptConfig, KeptConfig):
    """Everything that `python -m qocjax.codesign` reads."""

    search: SearchConfig
    limits: LimitsConfig
    traffic: TrafficConfig
    front: FrontConfig | None

    usual_discipline: ClassVar[str] = "skip"  # what is free, a search spends

    def sizes(self) -> dict[str, float]:
        """Of the runs of a look, of a choice and of a judgement, and of what is known of each look and search."""
        part, searches = self.search, len(self.search.methods) * self.search.repetitions
        return {
            "search.block": self.runs_size(1, part.block),
            "search.finalists": self.runs_size(part.finalists, part.block),
            "search.choice_seeds": self.runs_size(part.finalists, part.choice_seeds),
            "search.curve_seeds": self.runs_size(1, part.curve_seeds),
            "search.repetitions": 1000.0 * searches,
            "search.budget": 100.0 * part.budget / max(part.block, 1),
            "sweep.evaluation_seeds": self.runs_size(1, self.sweep.evaluation_seeds),
        }

    def build_space(self) -> Space:
        """Where the search moves.

        Raises:
            ValueError: Bad bounds, or an empty list.
        """
        axis = self.search.deadline_ms is None
        milliseconds = self.sweep.deadline_ms if self.search.deadline_ms is None else self.search.deadline_ms
        if not axis and len(milliseconds) != 2:
            raise ValueError(f"search.deadline_ms: got {milliseconds}, expected [low, high], or null for the axis")
        bounds = built_bounds("search.bounds", self.search.bounds, self)
        baseline = replace(self.baseline_with(bounds), deadline=milliseconds[0] / 1e3)
        return Space(bounds, self.search.tau, [ms / 1e3 for ms in milliseconds], axis, baseline)

    def build_measure(self) -> Measure:
        """What is maximised."""
        return Measure(self.search.measure, self.search.tail)
