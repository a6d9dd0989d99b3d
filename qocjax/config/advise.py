"""Configuration of `python -m qocjax.advise`."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from qocjax import _checks
from qocjax.advice.shortlist import Effort
from qocjax.advice.slack import Asked
from qocjax.advice.target import KINDS, Target
from qocjax.config.bounds import Bounds, built_bounds
from qocjax.config.kept import KeptConfig
from qocjax.config.part import Part
from qocjax.config.scale import given_scale
from qocjax.config.simulation import SimulationConfig
from qocjax.config.trace import TraceConfig
from qocjax.network import Network
from qocjax.quality import QocScale
from qocjax.scenario import Design

__all__ = ["AdviseConfig"]


class TargetConfig(Part):
    """What the margins keep; at most one of these."""

    share_of_best: float | None
    auc_s: float | None
    time_to_goal_s: float | None
    closest_m: float | None

    def build(self) -> Target | None:
        """The target; None where the usual one is asked for.

        Raises:
            ValueError: More than one, or a bad number.
        """
        given = {name: value for name, value in self.model_dump().items() if value is not None}
        if len(given) > 1:
            raise ValueError(f"advise.margins.target: got {' and '.join(given)}, expected one of {', '.join(KINDS)}")
        return Target(*next(iter(given.items()))) if given else None


class MarginsConfig(Part):
    """Which margins are asked for."""

    target: TargetConfig
    reliability: float | None
    delay_ms: float | None
    delays: int
    plane_seeds: int
    seeds: int
    points: int


class AdviseOptions(Part):
    """What is asked, and how much is simulated for the answer."""

    deadline_ms: float | None
    longest_deadline_ms: float
    max_collision_share: float
    objective: str
    tau_ms: list[float]
    bounds: Bounds
    slowest: float | None
    points: int
    rounds: list[int]
    finalists: int
    choice_seeds: int | None
    fresh_seeds: int
    beside_seeds: int | None
    deadlines: int | None
    scale: str | None
    margins: MarginsConfig


class AdviseConfig(SimulationConfig, KeptConfig):
    """Everything that `python -m qocjax.advise` reads."""

    path: str | None
    nav2: str | None
    advise: AdviseOptions
    figures: bool

    usual_discipline: ClassVar[str] = "skip"  # what is free, a search spends
    free: ClassVar[tuple[str, ...]] = ("figures", "resume")  # nav2 comes back with what is advised

    def sizes(self) -> dict[str, float]:
        """Of the runs of a round, of a judgement and of a margin."""
        part, margins = self.advise, self.advise.margins
        return {
            "advise.points": self.runs_size(part.points, max(part.rounds, default=1)),
            "advise.rounds": self.runs_size(part.finalists, max(part.rounds, default=1)),
            "advise.finalists": self.runs_size(part.finalists, max(part.rounds, default=1)),
            "advise.choice_seeds": self.runs_size(part.finalists, part.choice_seeds),
            "advise.fresh_seeds": self.runs_size(1, part.fresh_seeds),
            "advise.beside_seeds": self.runs_size(1, part.beside_seeds),
            "advise.margins.plane_seeds": self.runs_size(margins.delays**2, margins.plane_seeds),
            "advise.margins.delays": self.runs_size(margins.delays**2, margins.plane_seeds),
            "advise.margins.points": self.runs_size(margins.points, margins.seeds),
            "advise.margins.seeds": self.runs_size(margins.points, margins.seeds),
        }

    def log(self) -> TraceConfig | None:
        """The file whose content says itself what it is, where the network is one."""
        if self.path is not None:
            return TraceConfig(kind="trace", path=self.path)
        own = isinstance(self.network, TraceConfig) and self.network.column is None
        return self.network if own else None  # type: ignore[return-value]

    def build_network(self) -> Network:
        """Where loop times come from."""
        return super().build_network() if self.path is None else TraceConfig(kind="trace", path=self.path).build()

    def current(self) -> Design:
        """The design in use: the configured gains at the configured deadline, or the default one."""
        given, own = self.advise.deadline_ms, self.baseline_with(self.bounds())
        return own if given is None else replace(own, deadline=given / 1e3)

    def bounds(self) -> dict[str, tuple[float, float]]:
        """Parameters that may change; speed caps stay within the robot's.

        Raises:
            ValueError: Not two numbers, or more than the robot can do.
        """
        found, slowest = built_bounds("advise.bounds", self.advise.bounds, self, limited=False), self.advise.slowest
        if slowest is not None:
            _checks.bounded("advise.slowest", slowest, above=0, most=1)
            if "v_max" not in found and slowest < 1:
                found["v_max"] = (slowest * self.robot.v_max, self.robot.v_max)
        for name, cap in (("v_max", self.robot.v_max), ("omega_max", self.robot.omega_max)):
            if name in found and found[name][1] > cap * (1 + 1e-9):
                raise ValueError(f"advise.bounds.{name}: got {found[name][1]:g}, expected at most the robot's {cap:g}")
        return found

    def scale(self) -> QocScale | None:
        """J_med and J_max of an earlier study, where one is named."""
        return given_scale("advise", None, None, self.advise.scale, self.build_scenario())

    def asked(self) -> Asked:
        """Which margins are asked for."""
        part = self.advise.margins
        delay = None if part.delay_ms is None else part.delay_ms / 1e3
        sizes = {name: getattr(part, name) for name in ("delays", "plane_seeds", "seeds", "points")}
        return Asked(part.target.build(), part.reliability, delay, **sizes)

    def effort(self) -> Effort:
        """How much to simulate."""
        options = self.advise
        names = ("points", "finalists", "choice_seeds", "fresh_seeds", "beside_seeds", "deadlines")
        return Effort(rounds=tuple(options.rounds), **{name: getattr(options, name) for name in names})
