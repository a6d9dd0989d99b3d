"""What a search maximises: QoC of designs over seeds, on one scale, with the simulations counted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from qocjax.batch import evaluate
from qocjax.controllers import Controller
from qocjax.network.computing import computations_at_once
from qocjax.network.interface import Network, Reliability
from qocjax.network.schedule import Rules
from qocjax.quality import QocScale
from qocjax.scenario import Design, Scenario
from qocjax.statistics.scales import StudyScale, scale_of_runs
from qocjax.statistics.scores import Scores
from qocjax.statistics.units import units_of
from qocjax.study.reliability import load_of, reliability_of
from qocjax.study.sweep import qoc_by_seed

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Objective", "pilot_scale"]


@dataclass
class Objective:
    """QoC of any designs in one setting; common random numbers make designs comparable by seed."""

    scenario: Scenario
    network: Network
    scale: QocScale
    rules: Rules = field(default_factory=Rules)
    key: int = 0
    simulations: int = 0  # runs spent so far
    controller: Controller | None = None  # None for the surrogate law
    told: Callable[[int], None] | None = None  # called with the runs of each call of `runs`, after it

    def runs(self, designs: Design, seeds: Sequence[int]) -> xr.Dataset:
        """All metrics over (design, seed), counted."""
        runs = evaluate(self.scenario, designs, self.network, seeds, rules=self.rules, key=self.key,
                        controller=self.controller)  # fmt: skip
        spent = runs.sizes["design"] * runs.sizes["seed"]
        self.simulations += spent
        if self.told is not None:
            self.told(spent)
        return runs

    def reliability(self, deadline: ArrayLike, tau: ArrayLike) -> Reliability:
        """F(deadline) of designs with its standard error; both in s, of a shape that broadcasts."""
        return reliability_of(self.network, self.scenario, deadline, tau)

    def workers(self, tau: ArrayLike) -> np.ndarray:
        """Workers of the edge that are busy in the mean at sampling periods (s), of all robots together.

        NaN where the network does not tell its computations apart, as a trace.
        """
        periods, place = np.unique(np.asarray(tau, np.float64), return_inverse=True)
        found = [computations_at_once(self.network, load_of(self.scenario, each)) for each in periods]
        return np.array([np.nan if each is None else each.mean for each in found])[place].reshape(np.shape(tau))

    def units(self, seeds: Sequence[int], tau: ArrayLike) -> np.ndarray:
        """Labels of seeds, [S], equal where runs with such sampling periods (s) share a stretch of a measured trace."""
        return units_of(self.network, seeds, self.key, self.scenario.horizon, tau)

    def judged(self, runs: xr.Dataset) -> Scores:
        """QoC of runs with what its two intervals need."""
        return Scores.of(runs["auc"].values, self.scale, self.units(runs["seed"].values.tolist(), runs["tau"].values))

    def scores(self, designs: Design, seeds: Sequence[int]) -> np.ndarray:
        """QoC of each design and seed, [G, S], mean over robots."""
        return qoc_by_seed(self.runs(designs, seeds), self.scale)


def pilot_scale(
    scenario: Scenario,
    network: Network,
    baseline: Design,
    deadlines: Sequence[float],
    seeds: Sequence[int],
    *,
    rules: Rules | None = None,
    key: int = 0,
    controller: Controller | None = None,
) -> StudyScale:
    """J_med of the baseline over a deadline axis, and J_max: a scale fixed before any search begins.

    A search that made its own scale would move it while it searches.

    Args:
        scenario: Robots and yardstick.
        network: Where loop times come from.
        baseline: Numbers; its deadline is not read.
        deadlines: The axis (s).
        seeds: Monte Carlo seeds.
        rules: Actuation and hold.
        key: Root of all random numbers.
        controller: What computes the commands, by default the surrogate law.
    """
    designs = replace(baseline, deadline=np.asarray(deadlines, float))
    runs = evaluate(scenario, designs, network, seeds, rules=rules, key=key, controller=controller)
    return scale_of_runs(
        runs["auc"].values, scenario, units=units_of(network, seeds, key, scenario.horizon, baseline.tau)
    )
