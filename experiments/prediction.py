"""What it gains the navigation stack to start its rollouts from the pose predicted through the commands under way.

    python experiments/prediction.py

Both stacks run the two robots of the hall, and the two of the crossing, at 20 Hz with the paper's network, over the
same seeds: starts, loop times and samples are common, so the differences are paired. Writes
experiments/results/prediction.csv (a row per scenario, deadline and metric: both means and the difference with its 95 %
interval) and the figure beside it. About 6 minutes on two cores.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from hydra import compose, initialize_config_dir

from qocjax import evaluate
from qocjax._xla import request_whole_loop
from qocjax.config import conf_dir, load
from qocjax.config.show import ShowConfig
from qocjax.config.simulation import SimulationConfig
from qocjax.figures.prediction import prediction_gain
from qocjax.figures.save import save
from qocjax.statistics.estimates import estimate, paired
from qocjax.store import write_json
from qocjax.store.provenance import provenance

RESULTS = Path(__file__).resolve().parent / "results"
SCENARIOS = ("hall", "crossing")
DEADLINES = np.array([0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.65, 0.8])  # s
SEEDS = range(7000, 7016)
METRICS = ("auc", "path_length", "effort", "min_distance", "collided", "blocked_share")


def configured(scenario: str) -> SimulationConfig:
    """The configuration of the stack in a scenario, at 20 Hz."""
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        chosen = compose("show", [f"scenario={scenario}", "controller=navigation", "loop.tau=0.05"])
    return load(ShowConfig, chosen)


def by_seed(runs: xr.Dataset, metric: str) -> np.ndarray:
    """[deadlines, seeds], mean over robots where there is one value for each."""
    values = runs[metric].astype(float)
    return (values.mean("robot") if "robot" in values.dims else values).values


def rows(scenario: str) -> Iterator[dict[str, object]]:
    """Both stacks on the same seeds."""
    config = configured(scenario)
    stack, network = config.build_controller(), config.build_network()
    design = replace(config.baseline(), deadline=DEADLINES)
    plain, predicted = (
        evaluate(config.build_scenario(), design, network, SEEDS, controller=replace(stack, predict=predict))  # type: ignore[type-var]
        for predict in (False, True)
    )
    reliability = network.reliability(DEADLINES).share
    for metric in METRICS:
        for g, deadline in enumerate(DEADLINES):
            a, b = by_seed(plain, metric)[g], by_seed(predicted, metric)[g]
            first, second, gap = estimate(a), estimate(b), paired(b, a)
            yield {
                "scenario": scenario, "deadline": deadline, "reliability": reliability[g], "metric": metric,
                "sampled": first.mean, "sampled_se": first.se, "predicted": second.mean, "predicted_se": second.se,
                "difference": gap.mean, "difference_low": gap.low, "difference_high": gap.high, "seeds": len(SEEDS),
            }  # fmt: skip


def main() -> None:
    request_whole_loop()
    table = pd.DataFrame([row for scenario in SCENARIOS for row in rows(scenario)])
    table.to_csv(RESULTS / "prediction.csv", index=False, float_format="%.5g")
    write_json(RESULTS / "prediction.json", {"seeds": [SEEDS.start, SEEDS.stop]} | provenance())
    save(prediction_gain(table), RESULTS / "prediction")
    print(table[table["metric"] == "auc"].to_string(index=False))


if __name__ == "__main__":
    main()
