"""What the conclusions are put to the test on: a setting, its runs and its six sweeps, on common random numbers."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pandas as pd
import xarray as xr

from qocjax import Design, Network, QocScale, Rules, Scenario, evaluate, one_at_a_time, paper_network, run_study
from qocjax.network import Edge, LoopNetwork, TruncatedNormal, with_edge
from qocjax.network.edge_network import Path
from qocjax.study.chosen import place_of
from qocjax.study.policies import MIN_RELIABILITY
from qocjax.study.reliability import reliability_of
from qocjax.study.study import Study
from qocjax.study.sweep import qoc_by_seed

FIRST_SEED = 10_000  # far from the seeds of the studies
AXIS_MS = np.arange(0, 801, 20)
GRIDS = {
    "v_max": [0.2, 0.4, 0.7, 0.85, 1.0, 1.5],
    "eta": [0.0, 0.2, 0.6, 1.0, 2.0],
    "tau": [0.005, 0.01, 0.02, 0.05, 0.1],
    "kappa": [0.25, 0.5, 1.0, 2.0, 4.0, 8.0],
    "gamma": [0.5, 1.0, 2.0, 4.0, 6.0],
    "c_miss": [0.0, 0.1, 0.2, 0.8, 1.6],
}


@dataclass(frozen=True)
class Setting:
    """What is simulated, and how it is scored."""

    scenario: Scenario = field(default_factory=Scenario)
    rules: Rules = field(default_factory=Rules)
    path: Path = field(default_factory=paper_network)
    edge: Edge = field(default_factory=Edge)
    baseline: Design = field(default_factory=Design)
    min_reliability: float = MIN_RELIABILITY
    scale_of_baseline: bool = False  # J_med and J_max of the baseline's runs alone


class Bench:
    """A setting on common random numbers: half as many seeds to choose on as to judge on."""

    def __init__(self, setting: Setting, seeds: int) -> None:
        self.setting = setting
        self.judging = range(FIRST_SEED, FIRST_SEED + seeds)
        self.choosing = range(2 * FIRST_SEED, 2 * FIRST_SEED + max(2, seeds // 2))
        self.network = with_edge(setting.path, setting.edge)
        quick = LoopNetwork(compute=TruncatedNormal(0.02, 0.005), name="fast")
        self.fast = with_edge(quick, setting.edge)

    def runs(self, seeds: range, network: Network | None = None, **values: float | list[float]) -> xr.Dataset:
        """Runs of the baseline with other values; deadlines in ms as `deadline_ms`."""
        deadline = np.asarray(values.pop("deadline_ms"), float) / 1e3
        designs = replace(self.setting.baseline, deadline=deadline, **values)
        return evaluate(self.setting.scenario, designs, network or self.network, seeds, rules=self.setting.rules)

    def metric(
        self, name: str, *, seeds: range | None = None, network: Network | None = None, **values: float | list[float]
    ) -> np.ndarray:
        """[G, S] a metric of runs, see `numbers`; by default on the judging seeds."""
        return self.numbers(self.runs(seeds or self.judging, network, **values), name)

    def auc(self, **options) -> np.ndarray:
        """[G, S] AUC (s), see `metric`."""
        return self.metric("auc", **options)

    def numbers(self, runs: xr.Dataset, name: str) -> np.ndarray:
        """[G, S] a metric, mean over robots; robots that never arrive do so at the horizon."""
        values = runs[name].values.astype(float)
        if name == "arrival_time":
            values = np.minimum(values, self.setting.scenario.horizon)
        return values if values.ndim == 2 else values.mean(axis=-1)

    @cached_property
    def best(self) -> tuple[float, float]:
        """The baseline's best deadline (ms) and its AUC there, J*, on the choosing seeds."""
        mean = self.auc(seeds=self.choosing, deadline_ms=AXIS_MS.tolist()).mean(axis=1)
        return float(AXIS_MS[mean.argmin()]), float(mean.min())

    @cached_property
    def low(self) -> float:
        """MinDelay's deadline at the baseline's sampling period (ms): the paper's "MinDelay (low reliability)"."""
        return 1e3 * self.chosen("kappa", "MinDelay", "deadline")

    def change(
        self, name: str, low: float, high: float, deadline_ms: float, network: Network | None = None
    ) -> np.ndarray:
        """[S] AUC with the parameter at `high` less AUC with it at `low`, relative to J*."""
        lower, upper = self.auc(network=network, deadline_ms=deadline_ms, **{name: [low, high]})
        return (upper - lower) / self.best[1]

    @cached_property
    def study(self) -> Study:
        """The six sweeps, with the policies' choices."""
        setting = self.setting
        scale = None
        if setting.scale_of_baseline:
            scale = QocScale.of(self.runs(self.choosing, deadline_ms=AXIS_MS.tolist())["auc"].values)
        return run_study(
            setting.scenario, one_at_a_time(setting.baseline, GRIDS, AXIS_MS / 1e3), self.network, self.choosing,
            self.judging, rules=setting.rules, min_reliability=setting.min_reliability, scale=scale,
        )  # fmt: skip

    def best_deadlines(self, name: str) -> list[float]:
        """The deadline (ms) of the best QoC of each value of a sweep, on the choosing seeds."""
        return (1e3 * self._best_rows(name)["deadline"]).tolist()

    def best_scores(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Each value of a sweep at its own best deadline: QoC when chosen [V], and on the judging seeds [V, S]."""
        runs = self.runs(self.judging, deadline_ms=self.best_deadlines(name), **{name: GRIDS[name]})
        return self._best_rows(name)["qoc"].to_numpy(), qoc_by_seed(runs, self.study.scale)

    def _best_rows(self, name: str) -> pd.DataFrame:
        rows = self.study.results[self.study.results["sweep"] == name]
        return rows.loc[rows.groupby("value")["qoc"].idxmax()]

    def completing(self, deadline_ms: float) -> str:
        """Share of loops that complete at the usual sampling period."""
        tau = self.setting.baseline.tau
        return f"{float(reliability_of(self.network, self.setting.scenario, deadline_ms / 1e3, tau).share):.1%}"

    def chosen(self, sweep: str, policy: str, column: str = "value") -> float:
        """What a policy chose in a sweep, a column of the study's table."""
        table = self.study.policies
        return float(table[(table["sweep"] == sweep) & (table["policy"] == policy)].iloc[0][column])

    def place(self, sweep: str, policy: str) -> int:
        """Where a policy's choice lies in the study's runs on the judging seeds."""
        values = {sweep: self.chosen(sweep, policy), "deadline": self.chosen(sweep, policy, "deadline")}
        return place_of(self.study.evaluation, replace(self.setting.baseline, **values))

    def reached(self, name: str, sweep: str, policy: str) -> np.ndarray:
        """[S] a metric of a policy's choice on the judging seeds, or its `qoc`."""
        k, runs = self.place(sweep, policy), self.study.evaluation
        return qoc_by_seed(runs, self.study.scale)[k] if name == "qoc" else self.numbers(runs, name)[k]
