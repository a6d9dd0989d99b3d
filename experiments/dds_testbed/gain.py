"""What RELIABLE is worth over BEST_EFFORT: QoC of the measured loops, at any deadline, held or stopped.

    python -m experiments.dds_testbed.gain [--runs folder]

The simulator gives the measured AUC for the measured loop times, so it is asked here what these times are worth under
other deadlines and where a missed loop stops the robot. The folder is that of `compare --measure`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pandas as pd

from experiments.dds_testbed.cases import CHANNELS, PROFILES, ROOT, Case
from experiments.dds_testbed.config import read_config
from qocjax import QocScale, simulate
from qocjax.quality import qoc
from qocjax.study.statistics import paired

__all__ = ["gains", "main"]

DEADLINES = np.array([0.04, 0.06, 0.08, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0])  # s
HOLDS = ("hold", "zero")


def _loop_times(case: Case, folder: Path) -> dict[int, np.ndarray]:
    """T_net [P, N] s of each run that the folder holds."""
    found = {}
    for place in sorted((folder / case.name).glob("*")):
        robots = [pd.read_csv(file)["loop_time"].to_numpy() for file in sorted(place.glob("loops_*.csv"))]
        found[int(place.name)] = np.stack(robots, axis=1)
    return found


def _auc(case: Case, times: np.ndarray, hold: str) -> np.ndarray:
    """AUC [D, R, N] s of runs [R, P, N] at each deadline; late commands take effect when they come."""
    config = read_config(case.options())
    scenario, plan = config.build_scenario(), config.build_plan(False, Path())
    rules = plan.rules | {"hold": hold}

    def one(deadline: jax.Array, loops: jax.Array) -> jax.Array:
        return simulate(scenario, replace(plan.as_design(), deadline=deadline), loops, **rules).auc

    return np.asarray(jax.vmap(jax.vmap(one, (None, 0)), (0, None))(DEADLINES, times))


def gains(folder: Path) -> Iterator[dict[str, object]]:
    """A row for each RELIABLE profile, channel and hold: the deadline at which it gains most, and each at its best."""
    for middleware, profiles in PROFILES.items():
        base, *others = profiles
        for loss, bursty in CHANNELS:
            plain = _loop_times(Case(middleware, base, loss, bursty), folder)
            for profile in others:
                repaired = _loop_times(Case(middleware, profile, loss, bursty), folder)
                both = sorted(plain.keys() & repaired.keys())
                if len(both) > 1:
                    case = Case(middleware, profile, loss, bursty)
                    pair = [np.stack([runs[k] for k in both]) for runs in (plain, repaired)]
                    yield from (vars(case) | {"hold": hold} | _row(case, pair, hold) for hold in HOLDS)


def _row(case: Case, pair: list[np.ndarray], hold: str) -> dict[str, float]:
    auc = np.stack([_auc(case, times, hold) for times in pair])  # [2, D, R, N]
    score = np.asarray(qoc(auc, QocScale.of(auc.ravel()))).mean(axis=-1)
    mean = score.mean(axis=-1)
    at = int(np.argmax(mean[1] / mean[0]))
    best = np.argmax(mean, axis=1)
    own = paired(score[1, best[1]], score[0, best[0]])
    here = paired(score[1, at], score[0, at])
    return {
        "deadline": float(DEADLINES[at]), "gain": float(mean[1, at] / mean[0, at] - 1.0),
        "difference": float(here.mean), "half_width": float(here.half_width),
        "best_gain": float(mean[1, best[1]] / mean[0, best[0]] - 1.0), "best_difference": float(own.mean),
        "best_half_width": float(own.half_width),
    }  # fmt: skip


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=Path, default=Path("results/middlewares"), help="folder of the runs")
    jax.config.update("jax_enable_x64", True)
    table = pd.DataFrame(gains(parser.parse_args().runs))
    if table.empty:
        raise SystemExit("error: --runs: no two runs of a case there, expected those of compare --measure")
    table.to_csv(ROOT / "experiments" / "results" / "middlewares_gain.csv", index=False, float_format="%.4g")
    print(table.sort_values("gain", ascending=False).to_string(index=False, float_format="%.3g"))


if __name__ == "__main__":
    main()
