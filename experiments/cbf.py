"""Barrier against potential field over the deadline, under delay and loss, on the same seeds: python experiments/cbf.py

Both laws have the same goal gains and the same safety distance, which grows alike with the age of what is known. Their
own gain (eta, alpha) is chosen for each deadline on seeds of its own: the largest QoC among those whose collisions keep
the limit, else the fewest collisions. Five minutes on two cores.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import xarray as xr
from hydra import compose, initialize_config_dir
from matplotlib.figure import Figure

from qocjax import QocScale, Scenario, evaluate
from qocjax.config import conf_dir, load
from qocjax.config.show import ShowConfig
from qocjax.controllers import Apf, Cbf
from qocjax.figures.save import save
from qocjax.figures.style import DOUBLE_COLUMN, GREY, OKABE_ITO, paper_style
from qocjax.network import Network
from qocjax.quality import qoc
from qocjax.statistics.estimates import estimate, paired, share

RESULTS = Path(__file__).parent / "results"
CHOOSING, FRESH = range(128), range(1000, 1256)
DEADLINES = np.array([0.1, 0.125, 0.15, 0.175, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7, 0.8])
GAINS = {"potential field": (0.15, 0.3, 0.6, 1.2, 2.4), "barrier": (0.5, 1.0, 2.0, 4.0, 8.0)}
DEFAULTS = {"potential field": 0.6, "barrier": 2.0}
LIMIT = 0.05  # of collisions
_BURSTS = ["loss@network.uplink.loss=gilbert_elliott", "network.uplink.loss.p_good_to_bad=0.0125",
           "network.uplink.loss.p_bad_to_good=0.05"]  # fmt: skip
CASES = {
    "two robots, one goal": ["scenario=paper"],
    "the same, 20 % lost in bursts of 0.2 s": ["scenario=paper", *_BURSTS],
    "eight robots across a circle": ["scenario=circle8"],
}
_COLOURS = dict(zip(GAINS, OKABE_ITO, strict=False))

Runs = Callable[[str, float, np.ndarray, range], xr.Dataset]


def runs_of(options: list[str]) -> Runs:
    """Evaluates a law with a gain at deadlines on seeds, in one of the cases."""
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        config = load(ShowConfig, compose("show", options))
    scenario: Scenario = config.build_scenario()
    network: Network = config.build_network()

    def run(law: str, gain: float, deadlines: np.ndarray, seeds: range) -> xr.Dataset:
        design = replace(config.baseline(), deadline=deadlines)
        field = law == "potential field"
        design = replace(design, eta=gain) if field else design
        return evaluate(scenario, design, network, seeds, controller=Apf() if field else Cbf(gain))

    return run


def chosen(run: Runs, law: str, scale: QocScale) -> np.ndarray:
    """The gain for each deadline [D]."""
    score, close = [], []
    for gain in GAINS[law]:
        found = run(law, gain, DEADLINES, CHOOSING)
        score.append(np.asarray(qoc(found["auc"].values, scale)).mean(axis=(1, 2)))
        close.append(found["collided"].values.mean(axis=1))
    kept = np.array(close) <= LIMIT
    best = np.where(kept, np.array(score), -np.inf).argmax(axis=0)
    return np.array(GAINS[law])[np.where(kept.any(axis=0), best, np.argmin(close, axis=0))]


def judged(run: Runs, law: str, gains: np.ndarray) -> dict[str, np.ndarray]:
    """AUC [D, S, N], smallest distance and collision [D, S] on the fresh seeds, with a gain for each deadline."""
    parts = [run(law, float(gain), DEADLINES[[k]], FRESH) for k, gain in enumerate(gains)]
    return {name: np.concatenate([part[name].values for part in parts]) for name in ("auc", "min_distance", "collided")}


def table_of(case: str, options: list[str]) -> pd.DataFrame:
    """Both laws at every deadline: as given, and each with its chosen gain."""
    run, rows = runs_of(options), []
    given = {law: judged(run, law, np.full(DEADLINES.size, DEFAULTS[law])) for law in GAINS}
    scale = QocScale.of(np.concatenate([each["auc"].ravel() for each in given.values()]))
    picked = {law: chosen(run, law, scale) for law in GAINS}
    tuned = {law: judged(run, law, picked[law]) for law in GAINS}
    for kind, results in (("as given", given), ("chosen", tuned)):
        score = {law: np.asarray(qoc(found["auc"], scale)).mean(axis=-1) for law, found in results.items()}
        for law, found in results.items():
            gains = picked[law] if kind == "chosen" else np.full(DEADLINES.size, DEFAULTS[law])
            for k, deadline in enumerate(DEADLINES):
                mean, hits = estimate(score[law][k]), share(found["collided"][k])
                more = paired(score[law][k], score["potential field"][k])
                apart = found["min_distance"][k]
                rows.append({
                    "case": case, "gains": kind, "law": law, "deadline_ms": round(1e3 * float(deadline)),
                    "gain": gains[k], "auc": found["auc"][k].mean(), "qoc": mean.mean, "qoc_low": mean.low,
                    "qoc_high": mean.high, "more": more.mean, "more_low": more.low, "more_high": more.high,
                    "closest_mean": apart.mean(), "closest_5": np.quantile(apart, 0.05), "collided": hits.mean,
                    "collided_low": hits.low, "collided_high": hits.high,
                })  # fmt: skip
    return pd.DataFrame(rows)


def draw(table: pd.DataFrame) -> Figure:
    """QoC, smallest distance and collisions over the deadline, a column for each case."""
    quantities = (("qoc", "QoC"), ("closest_mean", "smallest distance (m)"), ("collided", "runs with a collision"))
    with paper_style():
        figure, axes = plt.subplots(3, len(CASES), figsize=(DOUBLE_COLUMN, 5.6), sharex=True, layout="constrained")
        for row, (_, label) in zip(axes, quantities, strict=True):
            row[0].set_ylabel(label)
        for column, case in zip(axes.T, CASES, strict=True):
            for axis, (name, _) in zip(column, quantities, strict=True):
                for (law, kind), rows in table[table["case"] == case].groupby(["law", "gains"], sort=False):
                    style = {"color": _COLOURS[law], "ls": "-" if kind == "chosen" else "--"}
                    axis.plot(rows["deadline_ms"], rows[name], label=f"{law}, {kind}", **style)
                    if name == "closest_mean":
                        continue
                    axis.fill_between(rows["deadline_ms"], rows[f"{name}_low"], rows[f"{name}_high"],
                                      color=_COLOURS[law], alpha=0.2, lw=0)  # fmt: skip
            column[0].set_title(case)
            column[1].axhline(2 * float(np.asarray(Scenario().robot_radius)), color=GREY, lw=0.6)
            column[2].axhline(LIMIT, color=GREY, lw=0.6)
            column[2].set(ylim=(-0.03, 1.03), xlabel="deadline Δ (ms)")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
        plt.close(figure)
    return figure


def main() -> None:
    """All cases."""
    table = pd.concat([table_of(case, options) for case, options in CASES.items()])
    table.to_csv(RESULTS / "cbf.csv", index=False, float_format="%.4g")
    save(draw(table), RESULTS / "cbf")
    shown = table.pivot(index=["case", "gains", "deadline_ms"], columns="law", values=["qoc", "collided", "closest_5"])
    print(shown.round(3).to_string())


if __name__ == "__main__":
    main()
