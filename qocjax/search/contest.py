"""Methods against each other and against one-at-a-time sweeps: equal budgets, several repetitions, fresh seeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from qocjax import _checks
from qocjax.scenario import Design
from qocjax.search.find import CHOICE_SEEDS, FINALISTS, FIRST, Found, find
from qocjax.search.judge import Judged, better_than, judge, stacked, tie_set
from qocjax.search.policies import policy_designs
from qocjax.search.trial import Problem
from qocjax.statistics.scores import Scores
from qocjax.study.grid import Grid

__all__ = ["Contest", "compete"]

_LOOKS = 8  # points of a curve


@dataclass(frozen=True)
class Contest:
    """What a comparison found. All scores are of fresh seeds."""

    chosen: pd.Series  # the best design, chosen on the choice seeds; the least violated one where nothing is feasible
    finals: pd.DataFrame  # one row per method and repetition
    curve: pd.DataFrame  # best design known against simulations spent, per method and repetition
    policies: pd.DataFrame  # the best one-at-a-time design of each policy; empty where no design keeps the limits
    ties: pd.DataFrame  # designs that the seeds cannot tell from the chosen one


def compete(
    problem: Problem,
    methods: Sequence[str],
    budget: int,
    repetitions: int,
    grid: Grid,
    num_sweep_seeds: int,
    num_judge_seeds: int,
    *,
    min_reliability: float,
    key: int = 0,
    block: int = 8,
    choice_seeds: int = CHOICE_SEEDS,
    finalists: int = FINALISTS,
    num_curve_seeds: int | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Contest:
    """Runs every method with the same budget, chooses the best design, and judges all on fresh seeds.

    Args:
        problem: What is to be found.
        methods: Names of `METHODS`.
        budget: Simulations of each search.
        repetitions: Searches of each method, with other random numbers and seeds.
        grid: One-at-a-time designs, for the paper's policies.
        num_sweep_seeds: Seeds on which the policies choose.
        num_judge_seeds: Seeds on which all is judged.
        min_reliability: What MinDelay asks of F(Delta).
        key: Root of the random numbers of the methods.
        block: Seeds of one look at a point.
        choice_seeds: Seeds on which each search chooses among its last points.
        finalists: How many points those are.
        num_curve_seeds: Seeds on which what each search knew on its way is judged; None for half of those that judge.
        progress: Called with a line before each part.

    Raises:
        ValueError: No method or an unknown one, or too small a budget.
    """
    if not methods or len(set(methods)) != len(methods):
        raise ValueError(f"methods: got {list(methods)}, expected at least one, each once")
    seeds = range(FIRST["judge"], FIRST["judge"] + _checks.count("judge_seeds", num_judge_seeds, least=2))
    found: list[Found] = []
    for repetition in range(_checks.count("repetitions", repetitions)):
        for method in methods:
            progress(f"{method}, repetition {repetition + 1} of {repetitions}")
            found.append(find(problem, method, budget, repetition=repetition, key=key, block=block,
                              choice_seeds=choice_seeds, finalists=finalists))  # fmt: skip
    progress("one-at-a-time sweeps")
    picks = policy_designs(
        problem, grid, range(FIRST["sweep"], FIRST["sweep"] + num_sweep_seeds), min_reliability
    )  # fmt: skip
    progress("judging on fresh seeds")
    policies, reference = _judge_policies(problem, picks, seeds)
    finals = _judge_finals(problem, found, seeds, reference)
    place = int(np.argmax([one.fitness for one in found]))
    few = num_curve_seeds or max(2, len(seeds) // 2)
    curve = _judge_curve(problem, found, seeds[:few])
    return Contest(finals.iloc[place], finals, curve, policies, _ties(problem, found, place, seeds))


def _judge_policies(problem: Problem, picks: pd.DataFrame, seeds: range) -> tuple[pd.DataFrame, Scores | None]:
    """The policies' designs on fresh seeds, and the QoC of the best of them (as chosen) by seed."""
    if picks.empty:
        return picks, None
    designs = Design.of({name: picks[name].to_numpy(float) for name in problem.space.baseline.names})
    judged = judge(problem, designs, seeds)
    return pd.concat([picks[["policy", "sweep", "simulations"]], judged.table], axis=1), judged.scores[0]


def _judge_finals(problem: Problem, found: list[Found], seeds: range, reference: Scores | None) -> pd.DataFrame:
    judged = judge(problem, stacked([one.design for one in found]), seeds, reference)
    head = pd.DataFrame(
        {
            "method": [one.method for one in found],
            "repetition": [one.repetition for one in found],
            "simulations": [one.spent for one in found],
            "kept_at_choice": [one.feasible for one in found],
            "excess_at_choice": [one.excess for one in found],
        }
    )
    return pd.concat([head, judged.table], axis=1)


def _judge_curve(problem: Problem, found: list[Found], seeds: range) -> pd.DataFrame:
    """At some counts of simulations the best design known then."""
    rows, designs = [], []
    for one in found:
        spent = np.array([count for count, _ in one.history])
        wanted = np.geomspace(spent[0], spent[-1], _LOOKS)
        for place in np.unique(np.searchsorted(spent, np.minimum(wanted, spent[-1]), side="right") - 1):
            rows.append({"method": one.method, "repetition": one.repetition, "simulations": int(spent[place]),
                         "final": bool(place == len(spent) - 1)})  # fmt: skip
            designs.append(one.history[place][1])
    names = ["score", "qoc", "collision_share", "excess", "feasible", *problem.space.baseline.names]
    table = _judge_distinct(problem, stacked(designs), seeds)
    return pd.concat([pd.DataFrame(rows), table[names]], axis=1)


def _judge_distinct(problem: Problem, designs: Design, seeds: range) -> pd.DataFrame:
    """`judge`, with equal designs simulated once."""
    values = np.stack([np.asarray(value) for value in designs.values().values()], axis=1)
    _, first, inverse = np.unique(values, axis=0, return_index=True, return_inverse=True)
    return judge(problem, designs.at(first), seeds).table.iloc[inverse.ravel()].reset_index(drop=True)


def _ties(problem: Problem, found: list[Found], place: int, seeds: range) -> pd.DataFrame:
    """Among all choices and the chosen search's finalists, those that tie with the chosen design."""
    designs = stacked([found[place].design, *[one.design for one in found], found[place].finalists])
    values = np.stack([np.asarray(value) for value in designs.values().values()], axis=1)
    _, first = np.unique(values, axis=0, return_index=True)
    judged: Judged = judge(problem, designs.at(np.sort(first)), seeds)  # the chosen one stays in front
    table = judged.table.assign(better=better_than(problem, judged, 0))
    return table[tie_set(problem, judged, 0)].reset_index(drop=True)
