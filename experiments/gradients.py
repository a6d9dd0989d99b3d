"""Which estimator of the gradient can be trusted: bias and spread of each against finite differences.

    python experiments/gradients.py

The truth is the central difference of the mean QoC over many seeds (common random numbers, step 0.1 in free
coordinates) at four points of (kappa, gamma); every estimate comes from 32 other seeds, 64 times over. Writes
experiments/results/gradients.csv and the figure beside it. About 2 minutes on one core.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from qocjax import Design, Scenario, paper_network
from qocjax._xla import request_whole_loop
from qocjax.figures.gradients import gradient_errors
from qocjax.figures.save import save
from qocjax.search.objective import Objective, pilot_scale
from qocjax.statistics.estimates import standard_error
from qocjax.tuning import ESTIMATORS, Bounds, Problem

RESULTS = Path(__file__).resolve().parent / "results"
DEADLINES = (0.1, 0.2, 0.4)  # s
HORIZONS = (5.0, 15.0, 30.0)  # s
POINTS = [[2.0, 2.0], [1.0, 5.0], [0.6, 2.0], [4.0, 4.0]]  # kappa, gamma: the baseline, and around the best
STEP = 0.1
TRUTH_SEEDS = range(2_000_000, 2_032_768)
SEEDS, REPEATS, FIRST_SEED = 32, 64, 100_000

# Label, estimator, width of its perturbations (not read by those that perturb nothing): those of the default search
# at its end, halfway and at its start.
CASES = [
    ("pathwise", "pathwise", 0.2),
    ("clipped", "clipped", 0.2),
    ("median of means", "median_of_means", 0.2),
    ("smoothed, width 0.2", "smoothed", 0.2),
    ("smoothed, width 0.6", "smoothed", 0.6),
    ("smoothed, width 2", "smoothed", 2.0),
    ("blend, width 0.2", "blend", 0.2),
]


@dataclass(frozen=True)
class Remembering(Problem):
    """Simulates what several estimators ask for once, and counts it for each of them."""

    known: dict[tuple, tuple[Any, int]] = field(default_factory=dict)

    def scores(self, free: np.ndarray, seeds: range) -> np.ndarray:
        return self._recall(("scores", free.tobytes(), seeds), lambda: Problem.scores(self, free, seeds), 1)

    def pathwise(self, free: np.ndarray, seeds: range) -> tuple[np.ndarray, np.ndarray]:
        every = range(FIRST_SEED, FIRST_SEED + REPEATS * SEEDS)
        share = len(seeds) / len(every)
        scores, slopes = self._recall(("pathwise",), lambda: Problem.pathwise(self, free, every), share)
        at = slice(seeds.start - FIRST_SEED, seeds.stop - FIRST_SEED)
        return scores[:, at], slopes[:, at]

    def _recall(self, key: tuple, simulate: Callable[[], Any], share: float) -> Any:
        """The result, of whose cost `share` is counted."""
        objective, before = self.objective, self.objective.simulations
        if key not in self.known:
            result = simulate()
            self.known[key] = result, objective.simulations - before
        result, cost = self.known[key]
        objective.simulations = before + round(share * cost)
        return result


def truth(problem: Problem, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Finite differences of the mean QoC, [G, d], and their standard errors."""
    offsets = STEP * np.eye(free.shape[1])
    scores = problem.scores(free[:, None, :] + np.concatenate([offsets, -offsets]), TRUTH_SEEDS)
    upper, lower = np.split(scores, 2, axis=1)
    by_seed = (upper - lower) / (2 * STEP)
    return by_seed.mean(axis=-1), standard_error(by_seed)


def estimates(problem: Problem, free: np.ndarray, name: str, width: float) -> np.ndarray:
    """Independent estimates, [repeats, G, d]."""
    rng = np.random.default_rng(0)
    firsts = range(FIRST_SEED, FIRST_SEED + REPEATS * SEEDS, SEEDS)
    return np.stack([ESTIMATORS[name](problem, free, range(k, k + SEEDS), rng, width).gradient for k in firsts])


def rows(horizon: float, deadlines: np.ndarray, names: tuple[str, ...], case: tuple[str, int],
         exact: tuple[np.ndarray, np.ndarray], found: np.ndarray) -> list[dict]:  # fmt: skip
    """Errors of one estimator by deadline and parameter; root mean squares over the points."""
    rms = lambda a: float(np.sqrt(np.mean(np.square(a))))  # noqa: E731
    table = []
    for deadline in DEADLINES:
        at = deadlines == deadline
        for k, parameter in enumerate(names):
            true, error, values = exact[0][at, k], exact[1][at, k], found[:, at, k]
            sure = np.abs(true) > 2 * error  # whose sign the finite differences tell
            same = np.sign(values[:, sure]) == np.sign(true[sure])
            spread = values.std(axis=0, ddof=1)
            table.append(
                {
                    "horizon": horizon, "deadline": deadline, "parameter": parameter, "estimator": case[0],
                    "truth": rms(true), "truth_se": rms(error), "bias": rms(values.mean(axis=0) - true),
                    "bias_se": rms(spread) / np.sqrt(REPEATS), "spread": rms(spread), "rmse": rms(values - true),
                    "sign_agreement": float(same.mean()) if sure.any() else np.nan, "signs_known": int(sure.sum()),
                    "simulations": case[1],
                }
            )  # fmt: skip
    return table


def main() -> None:
    """Measures all cases, and keeps table and figure."""
    request_whole_loop()
    network, bounds, table = paper_network(), Bounds(("kappa", "gamma")), []
    free = np.tile(bounds.free(np.array(POINTS)), (len(DEADLINES), 1))
    deadlines = np.repeat(DEADLINES, len(POINTS))
    for horizon in HORIZONS:
        scenario = Scenario(horizon=horizon)
        scale = pilot_scale(scenario, network, Design(), np.arange(0, 801, 20) / 1e3, range(32))
        objective = Objective(scenario, network, scale)
        problem = Remembering(objective, Design(), bounds, deadlines)
        exact = truth(problem, free)
        for label, name, width in CASES:
            before = objective.simulations
            found = estimates(problem, free, name, width)
            spent = (objective.simulations - before) // (REPEATS * len(deadlines))  # of one estimate
            table += rows(horizon, deadlines, bounds.names, (label, spent), exact, found)
            print(f"horizon {horizon:g} s, {label}: done", flush=True)
    results = pd.DataFrame(table)
    results.to_csv(RESULTS / "gradients.csv", index=False, float_format="%.4g")
    save(gradient_errors(results), RESULTS / "gradients")
    print(results.groupby(["deadline", "horizon", "estimator"], sort=False)[["truth", "rmse", "sign_agreement"]].mean())


if __name__ == "__main__":
    main()
