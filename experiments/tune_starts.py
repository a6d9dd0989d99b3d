"""Tuning from random starts against a fine grid: does the gradient find the best, and at what cost?

    python experiments/tune_starts.py

At three deadlines, 8 random starts of kappa and gamma with the settings of conf/tune.yaml, beside a 24 x 24 grid
between the same bounds on 512 seeds. Where the starts end and the grid's best are compared on 512 fresh seeds, paired.
All of it three times, with other random numbers throughout. Writes experiments/results/tune_starts.csv, and a figure of
the paths on the first grid. About 2 minutes on one core.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from hydra import compose, initialize_config_dir

from qocjax._xla import request_whole_loop
from qocjax.commands.tune import landscape
from qocjax.config import conf_dir, load
from qocjax.config.tune import TuneConfig
from qocjax.figures.save import save
from qocjax.figures.tuning import tuning_map
from qocjax.scenario import Design
from qocjax.search.objective import Objective, pilot_scale
from qocjax.statistics.estimates import estimate, paired
from qocjax.tuning import Tuning, tune

RESULTS = Path(__file__).resolve().parent / "results"
DEADLINES = np.array([0.1, 0.2, 0.4])  # s
STARTS, SIDE = 8, 24
GRID_SEEDS, FRESH_SEEDS = range(512), range(10_000, 10_512)
PILOT_SEEDS = range(32)
KEYS = (2000, 2001, 2002)  # none under which the settings of conf/tune.yaml were tried out


def tuned(config: TuneConfig) -> Tuning:
    """Tunes from the random starts at all deadlines at once."""
    scenario, network, baseline = config.build_scenario(), config.build_network(), config.baseline()
    scale = pilot_scale(scenario, network, baseline, np.arange(0, 801, 20) / 1e3, PILOT_SEEDS, key=config.key)
    objective = Objective(scenario, network, scale, config.loop.build(), config.key)
    return tune(
        objective, baseline, config.build_bounds(), DEADLINES, config.build_search(),
        starts=STARTS, from_baseline=False, selection_seeds=PILOT_SEEDS, evaluation_seeds=FRESH_SEEDS,
    )  # fmt: skip


def compare(tuning: Tuning, grid: pd.DataFrame, deadline: float, grid_runs: int) -> list[dict]:
    """One row per start: its end against the best of the grid, on fresh seeds."""
    problem = tuning.problem
    at = grid[grid["deadline"] == deadline]
    best = at.loc[at["qoc"].idxmax()]
    ends = tuning.designs[tuning.designs["deadline"] == deadline]
    kappa, gamma = (np.append(ends[name], best[name]) for name in ("kappa", "gamma"))
    scores = problem.objective.scores(Design(kappa=kappa, gamma=gamma, deadline=deadline), FRESH_SEEDS)
    target = estimate(scores[-1])
    spent = tuning.simulations["search"] // len(DEADLINES)
    rows = []
    for k, (_, end) in enumerate(ends.iterrows()):
        gap = paired(scores[k], scores[-1])
        rows.append(
            {
                "deadline": deadline, "start": k, "kappa": end["kappa"], "gamma": end["gamma"],
                "qoc": scores[k].mean(), "grid_kappa": best["kappa"], "grid_gamma": best["gamma"],
                "grid_qoc": target.mean, "grid_qoc_se": target.se,
                "difference": gap.mean, "difference_low": gap.low, "difference_high": gap.high,
                "within_one_se": gap.mean >= -target.se, "simulations_of_start": spent // STARTS,
                "simulations_of_all_starts": spent, "simulations_of_grid": grid_runs,
            }
        )  # fmt: skip
    return rows


def main() -> None:
    """Runs both under every key, and keeps the table, and a figure of the first."""
    request_whole_loop()
    table: list[dict] = []
    for key in KEYS:
        with initialize_config_dir(str(conf_dir()), version_base="1.3"):
            config = load(TuneConfig, compose("tune", overrides=[f"key={key}"]))
        tuning = tuned(config)
        grid = landscape(tuning, DEADLINES, SIDE, GRID_SEEDS)
        for deadline in DEADLINES:
            table += [{"key": key} | row for row in compare(tuning, grid, deadline, SIDE**2 * len(GRID_SEEDS))]
        if key == KEYS[0]:
            save(tuning_map(grid, tuning.trace, tuning.designs), RESULTS / "tune_starts")
    results = pd.DataFrame(table)
    results.to_csv(RESULTS / "tune_starts.csv", index=False, float_format="%.5g")
    for (key, deadline), rows in results.groupby(["key", "deadline"]):
        first = rows.iloc[0]
        share = first["simulations_of_all_starts"] / first["simulations_of_grid"]
        print(
            f"key {key}, {1e3 * deadline:g} ms: {rows['within_one_se'].sum()} of {STARTS} starts end within one "
            f"standard error of the grid's best (QoC {first['grid_qoc']:.4f} ± {first['grid_qoc_se']:.4f}); all "
            f"of them took {100 * share:.1f} % of its simulations"
        )


if __name__ == "__main__":
    main()
