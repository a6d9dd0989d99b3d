"""What a fleet of one size does on one network: QoC by seed at the best deadline, policies, load (model, section 6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from qocjax.network.estimate import usage
from qocjax.statistics.collisions import collision_share
from qocjax.statistics.scores import Scores, seed_scores
from qocjax.statistics.units import units_in
from qocjax.study.capacity import offered_load
from qocjax.study.chosen import design_at, place_of
from qocjax.study.problem import Problem
from qocjax.study.reliability import load_of, reliability_of
from qocjax.study.study import Study

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["BEST", "Point", "point_of"]

BEST = "tau"  # sweep of one value, the baseline's: its Co-design is the baseline at its best deadline


@dataclass(frozen=True)
class Point:
    """A fleet at the best deadline of the baseline; chosen on some seeds, judged on the others."""

    robots: int
    deadline: float  # s
    selection: np.ndarray  # [S'] QoC by selection seed: to choose on
    scores: np.ndarray  # [S] QoC by evaluation seed
    collided: np.ndarray  # [S] whether two robots came closer than two radii
    units: np.ndarray  # [S] labels of the seeds, see `units_of`
    row: dict[str, Any]  # all of it as plain values, SI units


def point_of(study: Study, problem: Problem) -> Point:
    """Reads a point from a study whose grid has the sweep `BEST`."""
    best = study.policies[(study.policies["sweep"] == BEST) & (study.policies["policy"] == "Co-design")].iloc[0]
    deadline, robots = float(best["deadline"]), problem.scenario.num_robots
    at = study.results[(study.results["sweep"] == BEST) & (study.results["deadline"] == deadline)].iloc[0]
    design = design_at(at)
    k = place_of(study.evaluation, design)
    units = units_in(study.evaluation)
    judged = Scores.of(study.evaluation["auc"].values[k], study.scale, units)
    selection = seed_scores(study.runs["auc"].values[place_of(study.runs, design)], study.scale)
    collided = study.evaluation["collided"].values[k].astype(bool)
    load = load_of(problem.scenario, float(np.asarray(design.tau)))
    share, error = reliability_of(problem.network, problem.scenario, deadline, design.tau)
    hits = collision_share(collided, robots, units, judged.values)
    row: dict[str, Any] = {
        "robots": robots, "tau": float(np.asarray(design.tau)), "deadline": deadline,
        **judged.mean().columns("qoc"),
        "auc": float(best["auc"]), "auc_se": float(best["auc_se"]),
        "reliability": float(share), "reliability_se": float(error),
        "collision_share": float(collided.mean()), "collision_low": hits.low, "collision_high": hits.high,
    }  # fmt: skip
    for name, (used, spread) in usage(problem.network, deadline, load).items():
        row |= {f"{name}_usage": used, f"{name}_usage_se": spread}
    row |= {f"{name}_offered": share for name, share in offered_load(problem.network, load).items()}
    row |= _policies(study.policies) | {"seeds": collided.size}
    return Point(robots, deadline, selection, judged.values, collided, units, row)


def _policies(policies: pd.DataFrame) -> dict[str, Any]:
    """QoC and deadline of each policy over what the fleet tunes: the best of its sweeps as chosen."""
    found: dict[str, Any] = {}
    for policy, rows in policies.groupby("policy", sort=False):
        best = rows.loc[rows["qoc_selection"].idxmax()]
        name = str(policy).lower().replace("-", "_")
        found |= {f"{name}_sweep": best["sweep"], f"{name}_value": float(best["value"])}
        found |= {f"{name}_{part}": float(best[part]) for part in ("deadline", "qoc", "qoc_se", "qoc_low", "qoc_high")}
    return found
