"""The C++ kernel with all that qocjax computes of a run, so that both do the same."""

from __future__ import annotations

import numpy as np

from experiments.bench.baselines.cpp_kernel import run
from experiments.bench.baselines.work import Work

__all__ = ["evaluate", "metrics"]

ROBOT_RADIUS = 0.105  # m


def evaluate(work: Work) -> np.ndarray:
    """AUC of each lane and robot, [L, N] float32, with all other metrics on the way."""
    return metrics(work)["auc"]


def metrics(work: Work) -> dict[str, np.ndarray]:
    """All metrics by their names in qocjax, of each lane [L], or of each lane and robot [L, N]."""
    found = run(work, metrics=True)
    closest, loops = np.sqrt(found["closest"]), work.num_ticks * work.num_robots
    away = found["last_away"]
    arrival = np.minimum((away + 1) * np.float32(work.tau), np.float32(work.horizon))
    return {
        "auc": found["auc"],
        "path_length": found["path_length"],
        "effort": found["effort"] / np.float32(work.tau),
        "arrival_time": np.where(away < work.num_ticks, arrival, np.float32(np.inf)),
        "min_distance": closest,
        "collided": closest < 2 * ROBOT_RADIUS,
        "completed_share": found["completed"].sum(axis=1) / loops,
        "age_mean": found["age_sum"].sum(axis=1) * np.float32(work.tau) / loops,
        "age_peak": found["age_peak"].max(axis=1) * np.float32(work.tau),
    }
