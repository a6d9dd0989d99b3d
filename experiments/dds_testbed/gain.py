"""What RELIABLE is worth over BEST_EFFORT: QoC of the measured loops, at any deadline, under each rule of the robot.

    python -m experiments.dds_testbed.gain [--runs folder]

The simulator gives the measured AUC for the measured loop times, so it is asked here what these times are worth under
other deadlines, where a command waits for its deadline, and where a missed loop stops the robot. The folder is that of
`compare --measure`.
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
from experiments.dds_testbed.plan import Plan
from qocjax import QocScale, Scenario, simulate
from qocjax.quality import qoc
from qocjax.statistics.estimates import paired

__all__ = ["gains", "main"]

DEADLINES = np.array([0.04, 0.06, 0.08, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0])  # s
RULES = tuple(
    {"actuation": actuation, "hold": hold} for actuation in ("arrival", "deadline") for hold in ("hold", "zero")
)


def _loop_times(case: Case, folder: Path) -> dict[int, np.ndarray]:
    """T_net [P, N] s of each run that the folder holds."""
    found = {}
    for place in sorted((folder / case.name).glob("*")):
        robots = [pd.read_csv(file)["loop_time"].to_numpy() for file in sorted(place.glob("loops_*.csv"))]
        found[int(place.name)] = np.stack(robots, axis=1)
    return found


def _auc(scenario: Scenario, plan: Plan, times: np.ndarray, chosen: dict[str, str]) -> np.ndarray:
    """AUC [D, R, N] s of runs [R, P, N] at each deadline."""
    rules = plan.rules | chosen

    def one(deadline: jax.Array, loops: jax.Array) -> jax.Array:
        return simulate(scenario, replace(plan.as_design(), deadline=deadline), loops, **rules).auc

    return np.asarray(jax.vmap(jax.vmap(one, (None, 0)), (0, None))(DEADLINES, times))


def gains(folder: Path) -> Iterator[dict[str, object]]:
    """A row for each RELIABLE profile, channel, actuation and hold, of which the folder has two runs or more.

    `gain` is what RELIABLE is worth, relative to the base profile of its middleware, with one deadline for both, that
    of the largest gain; `best_gain` with each at its own best deadline. For each run deadlines are chosen on the other
    runs. Differences of QoC and their intervals are paired by run; J_med and J_max are those of the two compared.
    """
    for middleware, profiles in PROFILES.items():
        base, *others = profiles
        for loss, bursty in CHANNELS:
            plain = _loop_times(Case(middleware, base, loss, bursty), folder)
            for profile in others:
                case = Case(middleware, profile, loss, bursty)
                repaired = _loop_times(case, folder)
                both = sorted(plain.keys() & repaired.keys())
                if len(both) > 1:
                    pair = [np.stack([runs[k] for k in both]) for runs in (plain, repaired)]
                    config = read_config(case.options())
                    scenario, plan = config.build_scenario(), config.build_plan(False, Path())
                    for rules in RULES:
                        auc = np.stack([_auc(scenario, plan, times, rules) for times in pair])
                        yield vars(case) | rules | _row(auc)


def _row(auc: np.ndarray) -> dict[str, float]:
    """Gains from the AUC [2, D, R, N] s without repairs and with them."""
    score = np.asarray(qoc(auc, QocScale.of(auc.ravel()))).mean(axis=-1)
    at = [int(np.argmax(each[1] / each[0])) for each in _of_the_others(score)]
    row = {"deadline": float(np.median(DEADLINES[at]))} | _judged(score, [(k, k) for k in at], "")
    return row | _judged(score, [tuple(np.argmax(each, axis=1)) for each in _of_the_others(score)], "best_")


def _of_the_others(score: np.ndarray) -> Iterator[np.ndarray]:
    """Mean [2, D] over all runs but one, for each run of [2, D, R]."""
    runs = score.shape[-1]
    return (score[..., np.arange(runs) != run].mean(axis=-1) for run in range(runs))


def _judged(score: np.ndarray, chosen: list[tuple[int, int]], name: str) -> dict[str, float]:
    """Gain and paired difference of each run [2, D, R] at the deadlines that were chosen for it."""
    plain, repaired = (np.array([score[k, each[k], run] for run, each in enumerate(chosen)]) for k in (0, 1))
    found = paired(repaired, plain)
    return {
        f"{name}gain": float(repaired.mean() / plain.mean() - 1.0), f"{name}difference": found.mean,
        f"{name}low": found.low, f"{name}high": found.high,
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
