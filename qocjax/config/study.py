"""Configuration of `python -m qocjax.sweep`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from qocjax.config.engine import EngineConfig
from qocjax.config.part import Part
from qocjax.config.scale import given_scale
from qocjax.config.simulation import SimulationConfig
from qocjax.quality import QocScale
from qocjax.store.identity import content_digest
from qocjax.study.chunks import Problem
from qocjax.study.grid import Grid, one_at_a_time

__all__ = ["FREE", "StudyConfig", "SweptConfig", "build_problem", "data_of"]

# Options that change nothing in the results, so that a study may go on with others.
FREE = ("engine", "figures", "report", "arrays", "resume", "nav2")


class SweepConfig(Part):
    """What a study sweeps, and on which seeds."""

    grids: dict[str, list[float]]
    deadline_ms: list[float]
    seeds: int
    evaluation_seeds: int
    min_reliability: float
    j_med: float | None
    j_max: float | None
    j_max_of: str
    scale: str | None


class SweptConfig(SimulationConfig):
    """Which designs a command considers, and on which seeds."""

    sweep: SweepConfig
    figures: bool

    def build_grid(self) -> Grid:
        """The designs of the study; of each grid what the robot can do."""
        grids = {name: self.robot.within(f"sweep.grids.{name}", name, values)
                 for name, values in self.sweep.grids.items()}  # fmt: skip
        return one_at_a_time(self.baseline(), grids, [ms / 1000 for ms in self.sweep.deadline_ms])

    def beyond(self) -> list[str]:
        """What of the grids is left out because the robot cannot do it, a sentence each."""
        found = []
        for name, values in self.sweep.grids.items():
            most = self.robot.limit(name)
            if most is not None and (out := [value for value in values if value > most]):
                listed = ", ".join(f"{value:g}" for value in out)
                found.append(f"sweep.grids.{name}: {listed} left out, more than the robot's {most:g}")
        return found

    def seeds(self) -> tuple[range, range]:
        """Selection and evaluation seeds: consecutive, so never in both."""
        for name in ("seeds", "evaluation_seeds"):
            if getattr(self.sweep, name) < 2:
                raise ValueError(f"sweep.{name}: got {getattr(self.sweep, name)}, expected at least 2")
        first = self.sweep.seeds
        return range(first), range(first, first + self.sweep.evaluation_seeds)

    def scale(self) -> QocScale | None:
        """J_med and J_max where they are given, or named by an earlier study; None for those of the study itself.

        Raises:
            ValueError: Only one is given, or the file holds no scale of this yardstick.
        """
        return given_scale("sweep", self.sweep.j_med, self.sweep.j_max, self.sweep.scale, self.build_scenario())


class StudyConfig(SweptConfig):
    """Everything that `python -m qocjax.sweep` reads."""

    nav2: str | None
    max_collision_share: Annotated[float, Field(ge=0, le=1)] | None
    report: bool
    arrays: bool
    chunk_steps: Annotated[float, Field(gt=0)]
    resume: str | None
    engine: EngineConfig

    def build_problem(self) -> Problem:
        """What is simulated, with these options to build it again elsewhere."""
        return Problem(
            self.build_scenario(), self.build_grid().designs, self.build_network(), self.loop.build(), self.key,
            self.build_controller(), self.model_dump(),
        )  # fmt: skip

    def identity(self) -> dict[str, Any]:
        """The options that results depend on."""
        return self.model_dump(exclude=set(FREE))


def build_problem(configuration: Mapping[str, Any]) -> Problem:
    """Builds the problem of a study again from its resolved options.

    Raises:
        ValueError: They are no configuration of a study, or a file that they name is missing.
    """
    return StudyConfig.model_validate(configuration).build_problem()


def data_of(problem: Problem) -> str:
    """Digest of what the problem holds beside its options: measured delays, maps."""
    return content_digest((problem.network, problem.controller))
