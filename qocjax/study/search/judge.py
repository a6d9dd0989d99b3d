"""Designs judged on fresh seeds: scores with intervals, paired differences, limits, demand, and who ties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields

import numpy as np
import pandas as pd
from scipy import stats

from qocjax.scenario import Design
from qocjax.study.search.trial import Problem

__all__ = ["Judged", "judge", "stacked", "tie_set"]


@dataclass(frozen=True)
class Judged:
    """Designs with what fresh seeds say of them."""

    table: pd.DataFrame  # one row per design
    scores: np.ndarray  # [G, S] QoC


def stacked(designs: Sequence[Design]) -> Design:
    """Several sets of designs as one."""
    parts = [np.concatenate([np.atleast_1d(getattr(design, item.name)) for design in designs])
             for item in fields(Design)]  # fmt: skip
    return Design(*parts)


def judge(problem: Problem, designs: Design, seeds: range, reference: np.ndarray | None = None) -> Judged:
    """Simulates designs on seeds that nothing was chosen on.

    Args:
        problem: Objective, limits, traffic and measure.
        designs: Values [G].
        seeds: [S].
        reference: [S] QoC of a design on the same seeds, that the differences are taken to.

    Returns:
        The table holds the design; `score` (the measure) with its 95 % interval; `qoc` (the mean); the collision share
        with its Clopper-Pearson interval; F(Delta); the demand; `excess` and `feasible`; and with a reference
        `difference` with its paired interval.
    """
    scores, collided = problem.simulate(designs, seeds)
    demand = problem.demand(np.asarray(designs.tau))
    table = pd.DataFrame({item.name: np.asarray(getattr(designs, item.name), float) for item in fields(Design)})
    intervals = [problem.measure.interval(row) for row in scores]
    table["score"] = [found.mean for found in intervals]
    table["score_low"] = [found.low for found in intervals]
    table["score_high"] = [found.high for found in intervals]
    table["qoc"] = scores.mean(axis=1)
    shares = [stats.binomtest(int(row.sum()), row.size).proportion_ci() for row in collided]
    table["collision_share"] = collided.mean(axis=1)
    table["collision_low"], table["collision_high"] = [s.low for s in shares], [s.high for s in shares]
    table["reliability"], table["reliability_se"] = problem.objective.reliability(table["deadline"], table["tau"])
    for name, values in asdict(demand).items():
        table[name] = values
    table["excess"] = problem.excess(designs, collided)
    table["feasible"] = table["excess"] == 0
    if reference is not None:
        gaps = [problem.measure.difference(row, reference) for row in scores]
        table["difference"] = [gap.mean for gap in gaps]
        table["difference_low"], table["difference_high"] = [g.low for g in gaps], [g.high for g in gaps]
    return Judged(table, scores)


def tie_set(problem: Problem, judged: Judged, chosen: int) -> np.ndarray:
    """Which designs [G] the seeds cannot tell from the chosen one; it is itself one of them.

    All intervals hold at once with 95 % (Bonferroni): a design is left out only where it is surely told apart. Designs
    that break the limits are no ties.
    """
    others = len(judged.scores) - 1
    confidence = 1 - 0.05 / max(others, 1)
    ties = []
    for row, scores in enumerate(judged.scores):
        gap = problem.measure.difference(scores, judged.scores[chosen], confidence)
        ties.append(row == chosen or (gap.high >= 0 and bool(judged.table["feasible"].iloc[row])))
    return np.array(ties)
