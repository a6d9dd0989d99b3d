"""Configuration of what is swept: which designs a command considers, and on which seeds."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import BeforeValidator

from qocjax import _checks
from qocjax.config.options import flat
from qocjax.config.part import Part
from qocjax.config.scale import given_scale
from qocjax.config.simulation import SimulationConfig
from qocjax.quality import QocScale
from qocjax.scenario import Design
from qocjax.study.grid import Grid, full_grid, one_at_a_time
from qocjax.tunables import DESIGN, design_name

__all__ = ["SweptConfig"]


class SweepConfig(Part):
    """What a study sweeps, and on which seeds."""

    grids: Annotated[dict[str, list[float]], BeforeValidator(flat)]
    axes: list[str] | None = None
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
        grids = self.grids()
        deadlines = [ms / 1000 for ms in self.sweep.deadline_ms]
        if self.sweep.axes is None:
            return one_at_a_time(self.swept_baseline(), grids, deadlines)
        axes = [design_name(name) for name in self.sweep.axes]
        if len(axes) < 2 or len(set(axes)) < len(axes):
            raise ValueError(f"sweep.axes: got {self.sweep.axes}, expected two or more parameters, each once")
        for name in axes:
            _checks.choice("sweep.axes", name, grids)
        return full_grid(self.swept_baseline(), {name: grids[name] for name in axes}, deadlines)

    def grids(self) -> dict[str, list[float]]:
        """Values by name in a design; of each what the robot can do."""
        found: dict[str, list[float]] = {}
        for given, values in self.sweep.grids.items():
            name, option = design_name(given), f"sweep.grids.{given}"
            if name in found:
                raise ValueError(f"{option}: got {given} and {name}, expected one grid of a parameter")
            if name not in self.robot.unread:
                found[name] = self.robot.within(option, name, values)
        if self.sweep.grids and not found:
            raise ValueError(f"sweep.grids: got {', '.join(self.sweep.grids)}, which a {self.robot.kind().__name__} "
                             "does not read, expected something that it reads")  # fmt: skip
        return found

    def swept_baseline(self) -> Design:
        """The baseline with the options that are swept beside the model's own parameters.

        Raises:
            ValueError: One is no number of the configuration, or a value is none that it takes.
        """
        beside = {name: values for name, values in self.grids().items() if name not in DESIGN}
        if missing := next((name for name in beside if "." not in name), None):
            known = ", ".join(own for own in DESIGN if own != "deadline")
            raise ValueError(f"sweep.grids: got {missing}, expected one of {known}, or an option by its full name, "
                             "such as loop.hold_timeout")  # fmt: skip
        self.baseline()  # refused first, as no grid is to blame for what is wrong with it
        try:
            baseline = self.baseline_with(beside)
        except ValueError as error:
            raise ValueError(f"sweep.grids.{error}") from None
        declared = self.tunables() if beside else {}
        for name, values in beside.items():
            self._check_read(name)
            if name in declared:
                declared[name].check(np.asarray(values, float))
        return baseline

    def _check_read(self, name: str) -> None:
        """Refuses what is swept but not read.

        Raises:
            ValueError: The options are such that nothing reads it.
        """
        edge = getattr(self.network, "edge", None)
        readers = {
            "loop.hold_timeout": ("loop.hold", self.loop.hold, ("timeout",)),
            "loop.hold_decay": ("loop.hold", self.loop.hold, ("decay",)),
            "loop.plan_length": ("loop.hold", self.loop.hold, ("buffer",)),
            "loop.command_bytes": ("loop.hold", self.loop.hold, ("buffer",)) if self.loop.hold != "buffer" else
                                  ("network", self.network.kind, ("cell", "dds")),
            "network.edge.workers": ("network.edge.discipline", (edge and edge.discipline) or self.usual_discipline,
                                     ("skip", "latest", "fifo")),
        }  # fmt: skip
        option, got, wanted = readers.get(name, ("", "", ("",)))
        if got not in wanted:
            raise ValueError(f"sweep.grids.{name}: got it with {option}={got}, which does not read it, expected "
                             f"{option}={' or '.join(wanted)}")  # fmt: skip

    def apart(self) -> tuple[str, ...]:
        """Names of what is swept that a compiled program does not take as an array."""
        swept = [name for name in self.grids() if name not in DESIGN]
        declared = self.tunables() if swept else {}
        return tuple(name for name in swept if name not in declared or not declared[name].array)

    def beyond(self) -> list[str]:
        """What of the grids is left out because the robot cannot do it or does not read it, a sentence each."""
        found = []
        for name, values in self.sweep.grids.items():
            name = design_name(name)
            if name in self.robot.unread:
                found.append(f"sweep.grids.{name}: left out, a {self.robot.kind().__name__} does not read it")
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
