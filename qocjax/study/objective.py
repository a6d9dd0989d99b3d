"""What a search maximises: QoC of designs over seeds, on one scale, with the simulations counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from qocjax.batch import evaluate
from qocjax.network.interface import Network
from qocjax.network.schedule import Rules
from qocjax.quality import QocScale
from qocjax.scenario import Design, Scenario
from qocjax.study.sweep import qoc_by_seed

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

    def runs(self, designs: Design, seeds: Sequence[int]) -> xr.Dataset:
        """All metrics over (design, seed), counted."""
        runs = evaluate(self.scenario, designs, self.network, seeds, rules=self.rules, key=self.key)
        self.simulations += runs.sizes["design"] * runs.sizes["seed"]
        return runs

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
) -> QocScale:
    """J_med and J_max of the baseline over a deadline axis: a scale fixed before any search begins.

    A search that made its own scale would move it while it searches.

    Args:
        scenario: Robots and yardstick.
        network: Where loop times come from.
        baseline: Numbers; its deadline is not read.
        deadlines: The axis (s).
        seeds: Monte Carlo seeds.
        rules: Actuation and hold.
        key: Root of all random numbers.
    """
    designs = replace(baseline, deadline=np.asarray(deadlines, float))
    runs = evaluate(scenario, designs, network, seeds, rules=rules, key=key)
    return QocScale.of(runs["auc"].values)
