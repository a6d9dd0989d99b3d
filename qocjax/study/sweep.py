"""The paper's study: sweeps on some seeds, policies chosen there, and judged on others (model, section 6)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from qocjax import _checks
from qocjax.batch.evaluate import evaluate
from qocjax.network.interface import Network
from qocjax.network.schedule import Rules
from qocjax.quality import QocScale, qoc
from qocjax.scenario import Design, Scenario
from qocjax.study.grid import Grid
from qocjax.study.policies import MIN_RELIABILITY, POLICIES, min_delay
from qocjax.study.statistics import estimate, paired, standard_error

__all__ = ["Study", "qoc_by_seed", "results_table", "run_study"]

# Metrics of a run that are averaged over robots and seeds and reported with their standard error.
_AVERAGED = ("auc", "min_distance", "path_length", "effort", "completed_share", "age_mean", "age_peak")


@dataclass(frozen=True)
class Study:
    """What a study found: tables for people, and the runs behind them."""

    results: pd.DataFrame  # one row per (sweep, value, deadline), on the selection seeds
    policies: pd.DataFrame  # one row per (sweep, policy), judged on the evaluation seeds
    scale: QocScale
    runs: xr.Dataset  # metrics over (design, seed, robot), selection seeds
    evaluation: xr.Dataset  # metrics of the chosen designs on the evaluation seeds


def run_study(
    scenario: Scenario,
    grid: Grid,
    network: Network,
    selection_seeds: Sequence[int],
    evaluation_seeds: Sequence[int],
    *,
    rules: Rules | None = None,
    key: int = 0,
    min_reliability: float = MIN_RELIABILITY,
    scale: QocScale | None = None,
    progress: Callable[[int], None] | None = None,
) -> Study:
    """Sweeps the grid, lets each policy choose, and judges the choices on fresh seeds.

    Args:
        scenario: Robots and yardstick.
        grid: Designs, from `one_at_a_time`.
        network: Where loop times come from.
        selection_seeds: Seeds on which designs are chosen.
        evaluation_seeds: Other seeds, on which the chosen are judged.
        rules: Actuation and hold.
        key: Root of all random numbers.
        min_reliability: What MinDelay asks of F(Delta).
        scale: J_med and J_max, where given; else of all selection runs.
        progress: Called with robot-steps done.

    Raises:
        ValueError: Seeds in both sets, fewer than two in one, or what `evaluate` raises.
    """
    _check_seeds(selection_seeds, evaluation_seeds)
    _checks.bounded("min_reliability", min_reliability, least=0, most=1)
    reliability = network.reliability(np.unique(grid.deadline))
    min_delay(np.zeros((1, reliability.size)), reliability, min_reliability)  # raises before anything is simulated
    options: dict[str, Any] = {"rules": rules, "key": key, "progress": progress}
    runs = evaluate(scenario, grid.designs, network, selection_seeds, **options)
    scale = scale or QocScale.of(runs["auc"].values)
    results = results_table(runs, grid, network, scale)
    chosen = _choose(results, grid, min_reliability)
    places, inverse = np.unique(grid.design[[row for _, _, row in chosen]], return_inverse=True)
    picked = Design(**{item.name: getattr(grid.designs, item.name)[places] for item in fields(Design)})
    evaluation = evaluate(scenario, picked, network, evaluation_seeds, **options)
    policies = _judge(results, chosen, evaluation, inverse, scale)
    return Study(results, policies, scale, runs, evaluation)


def qoc_by_seed(runs: xr.Dataset, scale: QocScale) -> np.ndarray:
    """QoC of each design and seed, [G, S]: mean over robots; a diverged run counts as the largest AUC."""
    auc = runs["auc"].values.astype(np.float64)
    return np.asarray(qoc(np.where(np.isnan(auc), np.inf, auc), scale)).mean(axis=-1)


def results_table(runs: xr.Dataset, grid: Grid, network: Network, scale: QocScale) -> pd.DataFrame:
    """One row per (sweep, value, deadline) with every metric and its standard error over seeds (SI units)."""
    designs = pd.DataFrame({item.name: runs[item.name].values for item in fields(Design)})
    designs["reliability"] = network.reliability(designs["deadline"].to_numpy())
    scores = qoc_by_seed(runs, scale)
    designs["qoc"], designs["qoc_se"] = scores.mean(axis=1), standard_error(scores)
    for name in _AVERAGED:
        values = runs[name].values.astype(np.float64)
        by_seed = values.mean(axis=-1) if values.ndim == 3 else values
        designs[name], designs[f"{name}_se"] = by_seed.mean(axis=1), standard_error(by_seed)
    designs["collision_share"] = runs["collided"].values.mean(axis=1)
    designs["diverged_share"] = np.any(~np.isfinite(runs["auc"].values), axis=2).mean(axis=1)
    _add_arrivals(designs, runs["arrival_time"].values)
    designs["seeds"] = runs.sizes["seed"]
    rows = designs.iloc[grid.design].reset_index(drop=True)
    return pd.concat([pd.DataFrame({"sweep": grid.sweep, "value": grid.value}), rows], axis=1)


def _add_arrivals(designs: pd.DataFrame, arrival: np.ndarray) -> None:
    """Arrival time of a run is that of its last robot; mean over the runs in which all arrive, and their share."""
    last = arrival.max(axis=-1)
    arrived = np.isfinite(last)
    times = np.ma.masked_array(last, ~arrived)
    designs["arrived_share"] = arrived.mean(axis=1)
    designs["arrival_time"] = times.mean(axis=1).filled(np.inf)
    counts = np.maximum(arrived.sum(axis=1), 2)
    designs["arrival_time_se"] = np.where(
        arrived.sum(axis=1) > 1, times.std(axis=1, ddof=1).filled(0), np.inf
    ) / np.sqrt(counts)


def _choose(results: pd.DataFrame, grid: Grid, min_reliability: float) -> list[tuple[str, str, int]]:
    """(sweep, policy, row of the results) of each choice."""
    chosen = []
    for sweep in dict.fromkeys(grid.sweep):
        rows = grid.rows(sweep)
        scores = results["qoc"].to_numpy()[rows]
        reliability = results["reliability"].to_numpy()[rows[0]]
        for name, policy in POLICIES.items():
            value, deadline = policy(scores, reliability, min_reliability)
            chosen.append((sweep, name, int(rows[value, deadline])))
    return chosen


def _judge(
    results: pd.DataFrame,
    chosen: list[tuple[str, str, int]],
    evaluation: xr.Dataset,
    place: np.ndarray,
    scale: QocScale,
) -> pd.DataFrame:
    """Scores of the choices on the evaluation seeds, and the paired difference of each policy to Co-design."""
    scores = qoc_by_seed(evaluation, scale)
    costs = evaluation["auc"].values.astype(np.float64).mean(axis=-1)
    own = {(sweep, policy): scores[k] for (sweep, policy, _), k in zip(chosen, place, strict=True)}
    table = []
    for (sweep, policy, row), k in zip(chosen, place, strict=True):
        point = results.loc[row]
        score, cost = estimate(scores[k]), estimate(costs[k])
        gap = paired(own[sweep, policy], own[sweep, "Co-design"])
        table.append(
            {
                "sweep": sweep, "policy": policy, "value": point["value"], "deadline": point["deadline"],
                "reliability": point["reliability"], "qoc_selection": point["qoc"],
                "qoc": score.mean, "qoc_se": score.se, "qoc_low": score.low, "qoc_high": score.high,
                "auc": cost.mean, "auc_se": cost.se,
                "difference": gap.mean, "difference_se": gap.se,
                "difference_low": gap.low, "difference_high": gap.high,
                "collision_share": float(evaluation["collided"].values[k].mean()), "seeds": scores.shape[1],
            }
        )  # fmt: skip
    return pd.DataFrame(table)


def _check_seeds(selection: Sequence[int], evaluation: Sequence[int]) -> None:
    for name, seeds in (("selection_seeds", selection), ("evaluation_seeds", evaluation)):
        _checks.counts(name, seeds)
        if len(seeds) < 2 or len(set(seeds)) != len(seeds):
            raise ValueError(
                f"{name}: got {len(seeds)} seeds, {len(set(seeds))} distinct, expected at least 2, all distinct"
            )
    if common := sorted(set(selection) & set(evaluation)):
        raise ValueError(f"evaluation_seeds: got {common[0]} in both sets, expected fresh seeds")
