"""Configuration of `python -m qocjax.sweep`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from qocjax.config.engine import EngineConfig
from qocjax.config.kept import KeptConfig
from qocjax.config.options import with_numbers
from qocjax.config.swept import SweptConfig
from qocjax.study.problem import Problem, Setup

__all__ = ["StudyConfig", "build_problem"]


class StudyConfig(SweptConfig, KeptConfig):
    """Everything that `python -m qocjax.sweep` reads."""

    nav2: str | None
    max_collision_share: Annotated[float, Field(ge=0, le=1)] | None
    report: bool
    arrays: bool
    chunk_steps: Annotated[float, Field(gt=0)]
    engine: EngineConfig

    def build_problem(self) -> Problem:
        """What is simulated, with these options to build it again elsewhere.

        Raises:
            ValueError: A value of the configuration, or of what is swept, is out of range.
        """
        designs, apart = self.build_grid().designs, self.apart()
        own = self.build_setup()
        columns = np.stack([np.asarray(designs.others[name]) for name in apart], axis=1) if apart else np.zeros((0, 0))
        setups = {tuple(values.tolist()): self._setup_with(dict(zip(apart, values.tolist(), strict=True)), own)
                  for values in np.unique(columns, axis=0)}  # fmt: skip
        return Problem(own.scenario, designs, own.network, own.rules, self.key, own.controller, self.model_dump(),
                       build_problem, setups, apart)  # fmt: skip

    def build_setup(self) -> Setup:
        """What programs are made for."""
        return Setup(self.build_scenario(), self.build_network(), self.loop.build(), self.build_controller())

    def _setup_with(self, values: Mapping[str, float], own: Setup) -> Setup:
        """The set-up with some options changed."""
        try:
            setup = with_numbers(self, values).build_setup()
        except (TypeError, ValueError) as error:
            listed = ", ".join(f"{name}={value:g}" for name, value in values.items())
            raise ValueError(f"sweep.grids: got {listed}: {error}") from None
        if setup.scenario.num_robots != own.scenario.num_robots:
            raise ValueError("sweep.grids: got values that change the number of robots, expected one number (fleet)")
        return setup


def build_problem(configuration: Mapping[str, Any]) -> Problem:
    """Builds the problem of a study again from its resolved options.

    Raises:
        ValueError: They are no configuration of a study, or a file that they name is missing.
    """
    return StudyConfig.model_validate(configuration).build_problem()
