"""Configuration of `python -m qocjax.sweep`."""

from __future__ import annotations

from qocjax.config.part import Part
from qocjax.config.simulation import SimulationConfig
from qocjax.quality import QocScale
from qocjax.study.grid import Grid, one_at_a_time

__all__ = ["StudyConfig"]


class SweepConfig(Part):
    """What a study sweeps, and on which seeds."""

    grids: dict[str, list[float]]
    deadline_ms: list[float]
    seeds: int
    evaluation_seeds: int
    min_reliability: float
    j_med: float | None
    j_max: float | None


class StudyConfig(SimulationConfig):
    """Everything that `python -m qocjax.sweep` reads."""

    sweep: SweepConfig
    figures: bool

    def build_grid(self) -> Grid:
        """The designs of the study."""
        return one_at_a_time(self.baseline(), self.sweep.grids, [ms / 1000 for ms in self.sweep.deadline_ms])

    def seeds(self) -> tuple[range, range]:
        """Selection and evaluation seeds: consecutive, so never in both."""
        for name in ("seeds", "evaluation_seeds"):
            if getattr(self.sweep, name) < 2:
                raise ValueError(f"sweep.{name}: got {getattr(self.sweep, name)}, expected at least 2")
        first = self.sweep.seeds
        return range(first), range(first, first + self.sweep.evaluation_seeds)

    def scale(self) -> QocScale | None:
        """J_med and J_max where both are given.

        Raises:
            ValueError: Only one is.
        """
        given = (self.sweep.j_med, self.sweep.j_max)
        if (given[0] is None) != (given[1] is None):
            raise ValueError(f"sweep.j_med, sweep.j_max: got {given[0]} and {given[1]}, expected both or neither")
        return None if given[0] is None or given[1] is None else QocScale(given[0], given[1])
