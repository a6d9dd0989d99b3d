"""Designs judged on fresh seeds: scores with intervals, paired differences, limits, demand, and who ties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd

from qocjax.scenario import Design
from qocjax.search.trial import Problem
from qocjax.statistics.collisions import collision_share
from qocjax.statistics.estimates import Estimate
from qocjax.statistics.scores import Scores

__all__ = ["Judged", "better_than", "judge", "stacked", "tie_set"]


@dataclass(frozen=True)
class Judged:
    """Designs with what fresh seeds say of them."""

    table: pd.DataFrame  # one row per design
    scores: Scores  # [G, S]


def stacked(designs: Sequence[Design]) -> Design:
    """Several sets of designs as one."""
    values = [design.values() for design in designs]
    return Design.of({name: np.concatenate([np.atleast_1d(each[name]) for each in values]) for name in values[0]})


def judge(problem: Problem, designs: Design, seeds: range, reference: Scores | None = None) -> Judged:
    """Simulates designs on seeds that nothing was chosen on.

    Args:
        problem: Objective, limits, traffic and measure.
        designs: Values [G].
        seeds: [S].
        reference: [S] QoC of a design on the same seeds, that the differences are taken to.

    Returns:
        The table holds the design; `score` (the measure) with both 95 % intervals (`_whole_` with the error of J_med in
        it); `qoc` (the mean); the collision share with its Clopper-Pearson interval; F(Delta); the demand; `excess` and
        `feasible`; `at_edge`, the bounds of the search that it lies at; and with a reference `difference` with its
        paired intervals. `within_limit`: feasible, and even the upper end of the collision share keeps its limit.
    """
    scores, collided = problem.judged(designs, seeds)
    table = pd.DataFrame({name: np.asarray(value, float) for name, value in designs.values().items()})
    count, measure = len(table), problem.measure
    found = [measure.interval(scores[k]).columns("score") for k in range(count)]
    table = pd.concat([table, pd.DataFrame(found)], axis=1)
    table["qoc"] = scores.values.mean(axis=1)
    robots = problem.objective.scenario.num_robots
    shares = [collision_share(row, robots, scores.units, like)
              for row, like in zip(collided, scores.values, strict=True)]  # fmt: skip
    table["collision_share"] = collided.mean(axis=1)
    table["collision_low"], table["collision_high"] = [s.low for s in shares], [s.high for s in shares]
    table["reliability"], table["reliability_se"] = problem.objective.reliability(table["deadline"], table["tau"])
    for name, values in asdict(problem.demand(np.asarray(designs.tau))).items():
        table[name] = values
    table["excess"] = problem.excess(designs, collided)
    table["feasible"] = table["excess"] == 0
    most = problem.limits.collision_share
    table["within_limit"] = table["feasible"] & ((most is None) | (table["collision_high"] <= (most or 0.0)))
    table["at_edge"] = [problem.space.at_bounds(row) for row in table.to_dict("records")]
    if reference is not None:
        gaps = [measure.difference(scores[k], reference).columns("difference") for k in range(count)]
        table = pd.concat([table, pd.DataFrame(gaps)], axis=1)
    return Judged(table, scores)


def tie_set(problem: Problem, judged: Judged, chosen: int) -> np.ndarray:
    """Which designs [G] the seeds cannot tell from the chosen one; it is itself one of them.

    All intervals hold at once with 95 % (Bonferroni): a design is left out only where it is surely told apart. Designs
    that break the limits are no ties.
    """
    gaps = _gaps(problem, judged, chosen)
    kept = judged.table["feasible"].to_numpy(bool)
    return np.array([row == chosen or (gap.high >= 0 and kept[row]) for row, gap in enumerate(gaps)])


def better_than(problem: Problem, judged: Judged, chosen: int) -> np.ndarray:
    """Which designs [G] the seeds show to be better than the chosen one; all intervals hold at once with 95 %."""
    return np.array([row != chosen and gap.low > 0 for row, gap in enumerate(_gaps(problem, judged, chosen))])


def _gaps(problem: Problem, judged: Judged, chosen: int) -> list[Estimate]:
    """Differences of each design to the chosen one, with intervals that hold together."""
    confidence = 1 - 0.05 / max(len(judged.table) - 1, 1)
    scores, measure = judged.scores, problem.measure
    return [measure.difference(scores[row], scores[chosen], confidence).given for row in range(len(judged.table))]
