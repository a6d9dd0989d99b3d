"""Configuration of `python -m qocjax.validate`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from qocjax import _checks
from qocjax.config.bounds import Bounds
from qocjax.config.controller import NavigationConfig
from qocjax.config.ingest import ReadingConfig
from qocjax.config.kept import KeptConfig
from qocjax.config.part import Part
from qocjax.config.simulation import SimulationConfig
from qocjax.controllers import Controller
from qocjax.scenario import Design
from qocjax.validation import Curve, Grouping, curve_of_csv

__all__ = ["CsvConfig", "RecordedConfig", "Simulated", "StackConfig", "SurrogateConfig", "ValidateConfig"]


class SurrogateConfig(Part):
    """E from the surrogate law with other gains; null is that of S."""

    kind: Literal["surrogate"]
    kappa: float | None
    eta: float | None
    gamma: float | None
    c_miss: float | None
    d_safe: float | None

    def design(self, baseline: Design) -> Design:
        """The gains of E."""
        return replace(baseline, **self.model_dump(exclude={"kind"}, exclude_none=True))


class StackConfig(Part):
    """E from the navigation stack."""

    kind: Literal["stack"]
    controller: NavigationConfig


class CsvConfig(Part):
    """E from a table."""

    kind: Literal["csv"]
    path: str
    delay: str
    unit: str
    auc: str
    run: str | None
    seed: str | None

    def read(self) -> Curve:
        """The curve."""
        return curve_of_csv(**self.model_dump(exclude={"kind"}))


class RecordedConfig(ReadingConfig):
    """E from recorded runs."""

    kind: Literal["recorded"]
    label: str | None
    quantile: float
    tolerance_ms: float
    bin_ms: float

    def grouping(self, delays: np.ndarray | None) -> Grouping:
        """How runs come to their configured delays (s)."""
        for name in ("tolerance_ms", "bin_ms"):
            _checks.bounded(f"measured.{name}", getattr(self, name), above=0)
        return Grouping(self.label, self.quantile, delays, self.tolerance_ms / 1e3, self.bin_ms / 1e3)

    def place(self) -> Path:
        """Where the runs lie."""
        return Path(self.path)


Simulated = StackConfig | SurrogateConfig  # of what E may be, that which is simulated


class ValidationOptions(Part):
    """At which delays, and on how many seeds."""

    delay_ms: list[float] | None
    seeds: int
    resamples: int
    regime_share: float


class CalibrateConfig(Part):
    """Which gains are fitted, and how."""

    bounds: Bounds
    method: str
    budget: int


class ValidateConfig(SimulationConfig, KeptConfig):
    """Everything that `python -m qocjax.validate` reads."""

    measured: Annotated[StackConfig | SurrogateConfig | CsvConfig | RecordedConfig, Field(discriminator="kind")]
    validation: ValidationOptions
    calibrate: CalibrateConfig | None = None
    nav2: str | None
    figures: bool

    def sizes(self) -> dict[str, float]:
        """Of the runs of a curve, and of the weights of its seeds in bootstrap samples."""
        part = self.validation
        return {
            "validation.seeds": self.runs_size(len(part.delay_ms or ()), part.seeds),
            "validation.resamples": 8.0 * part.resamples * max(part.seeds, len(part.delay_ms or ())),
        }

    def delays(self) -> np.ndarray | None:
        """The configured delays (s), where they are given.

        Raises:
            ValueError: None or fewer than three, one twice, or none although E is simulated.
        """
        given = self.validation.delay_ms
        if given is None:
            if isinstance(self.measured, CsvConfig | RecordedConfig):
                return None
            raise ValueError("validation.delay_ms: got null, expected delays: E is simulated and has none of its own")
        _checks.bounded("validation.delay_ms", given, least=0)
        if len(set(given)) < 3 or len(set(given)) != len(given):
            raise ValueError(f"validation.delay_ms: got {given}, expected three delays or more, each once")
        return np.sort(np.asarray(given, np.float64)) / 1e3

    def seeds(self) -> range:
        """Monte Carlo seeds of S, and of E where it is simulated.

        Raises:
            ValueError: One of the numbers that what is simulated is judged by is out of range, before anything is.
        """
        _checks.count("validation.resamples", self.validation.resamples, least=100)
        if not 0 < (share := self.validation.regime_share) < 1:
            raise ValueError(f"validation.regime_share: got {share:g}, expected a share between 0 and 1")
        return range(_checks.count("validation.seeds", self.validation.seeds, least=2))

    def design_of(self, source: Simulated) -> Design:
        """The design of a simulated E."""
        return source.design(self.baseline()) if isinstance(source, SurrogateConfig) else self.baseline()

    def controller_of(self, source: Simulated) -> Controller | None:
        """The controller of a simulated E; None for the surrogate law."""
        if isinstance(source, SurrogateConfig):
            return None
        scenario = self.scenario
        return source.controller.build(self.build_scenario(), scenario.map, self.robot.omega_max, scenario.map_release)
