"""Tuning from end to end: search, choose on selection seeds, judge on fresh ones (model, section 6)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from qocjax import _checks
from qocjax.scenario import Design
from qocjax.search.objective import Objective
from qocjax.tuning.bounds import Bounds
from qocjax.tuning.estimators import Slopes
from qocjax.tuning.problem import Problem, spread_starts
from qocjax.tuning.search import Search, Trail, search

__all__ = ["Tuning", "judge", "tune"]


@dataclass(frozen=True)
class Tuning:
    """What tuning found."""

    designs: pd.DataFrame  # one row per deadline and start, judged; `chosen` marks Co-design, `tied` its tie set
    trace: pd.DataFrame  # one row per step, deadline and start
    problem: Problem
    dropped: int  # derivatives of single runs that were not finite, left out
    stopped_early: bool
    simulations: dict[str, int]  # spent on the search, the choice and the judgement

    @property
    def chosen(self) -> pd.Series:
        """The row of Co-design."""
        return self.designs[self.designs["chosen"]].iloc[0]


def tune(
    objective: Objective,
    baseline: Design,
    bounds: Bounds,
    deadlines: Sequence[float] | np.ndarray,
    settings: Search,
    *,
    starts: int = 4,
    from_baseline: bool = True,
    selection_seeds: Sequence[int],
    evaluation_seeds: Sequence[int],
    progress: Callable[[Slopes], None] | None = None,
) -> Tuning:
    """Tunes the parameters at every deadline of the axis from several starts, as one batch of designs per step.

    Args:
        objective: The setting and its scale of QoC.
        baseline: Numbers; what is not tuned stays at them. Its deadline is not read.
        bounds: Which parameters are tuned, and between what.
        deadlines: The deadline axis (s).
        settings: How to search.
        starts: Starts at each deadline, the same ones at all.
        from_baseline: Whether the first start is the baseline, moved within the bounds; the others are random.
        selection_seeds: On which Co-design is chosen among what the searches found.
        evaluation_seeds: Fresh ones, on which it is judged. The search itself takes the seeds after both.
        progress: Called after each step.

    Raises:
        ValueError: No deadline or one twice, common seeds, or derivatives that are not finite.
    """
    axis = _axis(deadlines)
    _check_seeds(selection_seeds, evaluation_seeds)
    count = _checks.count("starts", starts)
    points = spread_starts(count, bounds, np.random.default_rng([settings.random, 1]))
    if from_baseline:
        points[0] = bounds.nearest(np.array([float(np.asarray(baseline.values()[name])) for name in bounds.names]))
    problem = Problem(objective, baseline, bounds, np.repeat(axis, count))
    before = objective.simulations
    first_seed = 1 + max(max(selection_seeds), max(evaluation_seeds))
    trail = search(problem, np.tile(points, (len(axis), 1)), settings, first_seed, progress)
    searched = objective.simulations
    selection = problem.scores(trail.result, selection_seeds)
    chosen_at = objective.simulations
    designs = judge(problem, trail.result, selection, evaluation_seeds)
    designs.insert(1, "start", np.tile(np.arange(count), len(axis)))
    spent = {"search": searched - before, "selection": chosen_at - searched}
    spent["evaluation"] = objective.simulations - chosen_at
    trace = _with_starts(trail, count)
    return Tuning(designs, trace, problem, trail.dropped, trail.stopped_early, spent)


def judge(problem: Problem, free: np.ndarray, selection: np.ndarray, evaluation_seeds: Sequence[int]) -> pd.DataFrame:
    """Chooses the best point on the selection scores, and judges all on fresh seeds.

    Args:
        problem: The deadlines and the setting.
        free: [G, d] points.
        selection: [G, S] their QoC on the selection seeds.
        evaluation_seeds: Fresh seeds.

    Returns:
        One row per point: QoC on fresh seeds, the paired difference to the chosen one, and the paired gain over the
        baseline at the same deadline, each with both 95 % intervals (`_whole_` with the error of J_med in it); `tied`
        where the difference cannot be told from zero and `better` where it lies above, all points at once; and at
        which bounds of the search it lies.
    """
    best = int(selection.mean(axis=1).argmax())
    scores, untuned = problem.judged(free, evaluation_seeds)
    values = problem.bounds.values(free)
    rows = []
    for k, deadline in enumerate(problem.deadlines):
        gap = (scores[k] - scores[best]).mean()
        told = (scores[k] - scores[best]).mean(1.0 - 0.05 / max(len(values) - 1, 1)).given  # all at once (Bonferroni)
        rows.append(
            {"deadline": deadline}
            | dict(zip(problem.bounds.names, values[k], strict=True))
            | {"qoc_selection": selection[k].mean()}
            | scores[k].mean().columns("qoc")
            | gap.columns("difference")
            | (scores[k] - untuned[k]).mean().columns("gain")
            | {
                "chosen": k == best, "tied": k == best or told.low <= 0.0 <= told.high,
                "better": k != best and told.low > 0.0,
                "seeds": scores.values.shape[1], "at_edge": problem.at_bounds(deadline, values[k]),
            }
        )  # fmt: skip
    table = pd.DataFrame(rows)
    share, error = problem.objective.reliability(problem.deadlines, problem.baseline.tau)
    table.insert(1, "reliability", share)
    table.insert(2, "reliability_se", error)
    return table


def _with_starts(trail: Trail, count: int) -> pd.DataFrame:
    """The trace with the number of the start in place of that of the point."""
    start = trail.table["point"].to_numpy() % count
    table = trail.table.drop(columns="point")
    table.insert(2, "start", start)
    return table


def _axis(deadlines: Sequence[float] | np.ndarray) -> np.ndarray:
    axis = np.sort(np.atleast_1d(np.asarray(_checks.bounded("deadline", deadlines, least=0), np.float64)))
    if axis.size == 0 or np.unique(axis).size != axis.size:
        raise ValueError(f"deadline: got {axis.tolist()}, expected at least one deadline, each once")
    return axis


def _check_seeds(selection: Sequence[int], evaluation: Sequence[int]) -> None:
    for name, seeds in (("selection_seeds", selection), ("evaluation_seeds", evaluation)):
        distinct = len(set(seeds))
        if distinct < 2 or distinct != len(seeds):
            raise ValueError(f"{name}: got {len(seeds)} seeds, {distinct} distinct, expected at least 2, all distinct")
    if common := sorted(set(selection) & set(evaluation)):
        raise ValueError(f"evaluation_seeds: got {common[0]} in both sets, expected fresh seeds")
