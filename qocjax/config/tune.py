"""Configuration of `python -m qocjax.tune`."""

from __future__ import annotations

from typing import Literal

import numpy as np
import optax

from qocjax import _checks, tuning
from qocjax.config.bounds import Bounds, built_bounds
from qocjax.config.kept import KeptConfig
from qocjax.config.part import Part
from qocjax.config.scale import given_scale
from qocjax.config.simulation import SimulationConfig
from qocjax.controllers import Controller
from qocjax.quality import QocScale
from qocjax.tunables import CONTINUOUS, design_name
from qocjax.tuning import Search, Smoothed, make_estimator

__all__ = ["TuneConfig"]

SCHEDULES = ("constant", "cosine", "exponential")


class _Rule(Part):
    """What all optimisers have: a rate, and how it falls."""

    rate: float
    schedule: str
    last_rate: float

    def rates(self, steps: int) -> optax.Schedule:
        """The rate by step."""
        _checks.choice("optimiser.schedule", self.schedule, SCHEDULES)
        _checks.bounded("optimiser.rate", self.rate, above=0)
        _checks.bounded("optimiser.last_rate", self.last_rate, above=0)
        share = self.last_rate / self.rate
        if self.schedule == "cosine":
            return optax.cosine_decay_schedule(self.rate, steps, share)
        if self.schedule == "exponential":
            return optax.exponential_decay(self.rate, steps, share)
        return optax.constant_schedule(self.rate)


class AdamConfig(_Rule):
    """Adam."""

    method: Literal["adam"]
    b1: float
    b2: float

    def build(self, steps: int) -> optax.GradientTransformation:
        """The rule with its schedule."""
        for name in ("b1", "b2"):
            _checks.bounded(f"optimiser.{name}", 1.0 - getattr(self, name), above=0, most=1)
        return optax.adam(self.rates(steps), b1=self.b1, b2=self.b2)


class SgdConfig(_Rule):
    """Gradient ascent with momentum."""

    method: Literal["sgd"]
    momentum: float

    def build(self, steps: int) -> optax.GradientTransformation:
        """The rule with its schedule."""
        _checks.bounded("optimiser.momentum", self.momentum, least=0, most=1)
        return optax.sgd(self.rates(steps), momentum=self.momentum)


class TuningConfig(Part):
    """What is tuned, how, and on which seeds."""

    wrt: list[str]
    bounds: Bounds
    deadline_ms: list[float]
    estimator: str
    starts: int
    from_baseline: bool
    steps: int
    step_seeds: int
    width: float
    last_width: float
    average: float
    patience: int
    tolerance: float
    seeds: int
    evaluation_seeds: int
    landscape: int
    j_med: float | None
    j_max: float | None
    scale: str | None


class TuneConfig(SimulationConfig, KeptConfig):
    """Everything that `python -m qocjax.tune` reads."""

    optimiser: AdamConfig | SgdConfig
    tune: TuningConfig
    figures: bool

    def sizes(self) -> dict[str, float]:
        """Of the runs of a step, of a part of the study, of the map of gains, and of what each step is told by."""
        part, axis = self.tune, len(self.tune.deadline_ms)
        return {
            "tune.seeds": self.runs_size(axis, part.seeds),
            "tune.evaluation_seeds": self.runs_size(1, part.evaluation_seeds),
            "tune.step_seeds": self.runs_size(axis, part.step_seeds),
            "tune.starts": self.runs_size(axis * part.starts, part.step_seeds),
            "tune.steps": 8.0 * axis * part.starts * part.steps,
            "tune.landscape": self.runs_size(part.landscape**2, part.seeds) if self.figures else 0.0,
        }

    def build_bounds(self) -> tuning.Bounds:
        """What is tuned, and between what.

        Raises:
            ValueError: Other bounds than the default ones of a parameter that is not tuned, none of one that is, or
                what `Bounds` raises.
        """
        given = {design_name(name): pair for name, pair in self.tune.bounds.items() if pair is not None}
        names = [design_name(name) for name in self.tune.wrt]
        listed = ", ".join(self.tune.wrt)
        for name in set(names) & set(self.robot.unread):
            raise ValueError(f"tune.wrt: got {name}, which a {self.robot.kind().__name__} does not read")
        for name, pair in given.items():
            if name not in names and tuple(pair) != tuning.DEFAULT_BOUNDS.get(name, ()):
                raise ValueError(f"tune.bounds.{name}: got {pair}, but tune.wrt is [{listed}]: {name} is not tuned")
        beside = [name for name in names if name not in CONTINUOUS]
        known = [name for name, each in self.tunables().items() if beside and each.array and "." in name]
        for name in beside:
            if name not in known:
                raise ValueError(f"tune.wrt: got {name}, expected one of {', '.join([*CONTINUOUS, *known])}")
            if name not in given:
                raise ValueError(f"tune.wrt: got {name} without bounds, expected tune.bounds.{name}=[low,high]")
        built = built_bounds("tune.bounds", {name: given[name] for name in names if name in given}, self)
        return tuning.Bounds(names, built)

    def build_controller(self) -> Controller:
        """The law whose values are tuned.

        Raises:
            ValueError: Its commands take too long, it does not read what is tuned, or slopes are asked for that it has
                not; or what there is to say of it anyway.
        """
        law = super().build_controller()
        for name in self.tune.wrt:
            if name in law.unread:
                raise ValueError(
                    f"tune.wrt: got {name}, which {self.controller.law} does not read, expected what it reads"
                )
        if not (law.smooth or isinstance(make_estimator(self.tune.estimator), Smoothed)):
            raise ValueError(f"tune.estimator: got {self.tune.estimator}, but {self.controller.law} does not say that "
                             "it is smooth, expected smoothed, which needs no derivatives")  # fmt: skip
        return law

    def build_search(self) -> Search:
        """How to search."""
        part = self.tune
        _checks.count("tune.steps", part.steps)
        return Search(
            self.optimiser.build(part.steps), make_estimator(part.estimator), part.steps, part.step_seeds,
            part.width, part.last_width, part.average, part.patience, part.tolerance, random=self.key % 2**32,
        )  # fmt: skip

    def deadlines(self) -> np.ndarray:
        """The deadline axis (s).

        Raises:
            ValueError: No deadline, or one twice.
        """
        axis = self.tune.deadline_ms
        if not axis or len(set(axis)) != len(axis):
            raise ValueError(f"tune.deadline_ms: got {axis}, expected at least one deadline, each once")
        return np.asarray(_checks.bounded("tune.deadline_ms", axis, least=0), np.float64) / 1e3

    def seeds(self) -> tuple[range, range]:
        """Selection and evaluation seeds: consecutive, so never in both."""
        for name in ("seeds", "evaluation_seeds"):
            _checks.count(f"tune.{name}", getattr(self.tune, name), least=2)
        first = self.tune.seeds
        return range(first), range(first, first + self.tune.evaluation_seeds)

    def scale(self) -> QocScale | None:
        """J_med and J_max where they are given, or named by an earlier study.

        Raises:
            ValueError: Only one is given, or the file holds no scale of this yardstick.
        """
        options = self.tune
        return given_scale("tune", options.j_med, options.j_max, options.scale, self.build_scenario())
