"""QoC against network demand: which designs nothing beats in both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from qocjax import _checks
from qocjax.network.edge import Edge
from qocjax.scenario import Design
from qocjax.search import CHOICE_SEEDS, FIRST, Problem, find, judge, stacked, take
from qocjax.search.limits import DEMANDS

__all__ = ["demand_front", "on_front", "worker_front"]


def on_front(demand: ArrayLike, score: ArrayLike) -> np.ndarray:
    """Which points [G] no other beats: none asks as little and scores more, or asks less and scores as much.

    Raises:
        ValueError: Different lengths, or a number that is not finite.
    """
    asks, scores = np.asarray(demand, float), np.asarray(score, float)
    if asks.shape != scores.shape or asks.ndim != 1:
        raise ValueError(f"score: got shape {scores.shape}, expected that of the demand {asks.shape}, one per point")
    if not (np.isfinite(asks).all() and np.isfinite(scores).all()):
        raise ValueError("demand, score: got a number that is not finite, expected finite ones")
    no_worse = (asks[None, :] <= asks[:, None]) & (scores[None, :] >= scores[:, None])
    better = (asks[None, :] < asks[:, None]) | (scores[None, :] > scores[:, None])
    return ~np.any(no_worse & better, axis=1)


def demand_front(
    problem: Problem,
    method: str,
    budget: int,
    seeds: range,
    also: Design | None = None,
    *,
    against: str = "loops_per_s",
    key: int = 0,
) -> pd.DataFrame:
    """The best design of each sampling period, which alone sets the demand, judged on fresh seeds.

    Each sampling period has its own search. What they find is then tried at every sampling period, on the choice
    seeds: what is good at one is often good at its neighbours. Whether the network slows down under the load of a
    sampling period is the network's affair: one with a finite edge or a shared cell does.

    Args:
        problem: What is to be found; its space names the sampling periods.
        method: That searches for each of them.
        budget: Simulations of each search.
        seeds: To judge on.
        also: Further designs to try at every sampling period.
        against: What the front trades the score for, of `DEMANDS`.
        key: Root of the random numbers of the method.

    Returns:
        The table of `judge` with `front`: on the front of score against that demand, among those that keep the
        limits, on collisions by the upper end of their share.

    Raises:
        ValueError: An unknown demand, or one that the network does not tell.
    """
    _checks.choice("front.against", against, DEMANDS)
    candidates = [] if also is None else [also]
    for place, tau in enumerate(problem.space.tau):
        only = replace(problem, space=replace(problem.space, tau=(tau,)))
        candidates.append(find(only, method, budget, repetition=_FIRST + place, key=key).finalists)
    table = judge(problem, _best_of_each_tau(problem, stacked(candidates)), seeds).table
    return _with_front(table, against)


def worker_front(
    problem: Problem, method: str, budget: int, workers: Sequence[int], seeds: range, *, key: int = 0
) -> pd.DataFrame:
    """The best design for each number of workers of the edge, judged on fresh seeds: what is scarce as an objective.

    Args:
        problem: What is to be found, on a network with a finite edge.
        method: That searches for each number.
        budget: Simulations of each search.
        workers: Numbers of workers, of each robot or of all as the edge says.
        seeds: To judge on.
        key: Root of the random numbers of the method.

    Returns:
        The table of `judge` with `edge_workers` and `front`.

    Raises:
        ValueError: The network has no finite edge.
    """
    network: Any = problem.objective.network
    if not getattr(getattr(network, "edge", None), "finite", False):
        raise ValueError(f"front.workers: got {list(workers)} on {network.name!r} without a finite edge, expected []")
    rows = []
    for place, count in enumerate(workers):
        given = replace(network, edge=Edge(count, network.edge.per_robot, network.edge.discipline, network.edge.abort))
        here = replace(problem, objective=replace(problem.objective, network=given, simulations=0))
        found = find(here, method, budget, repetition=_FIRST + _APART + place, key=key)
        rows.append(judge(here, found.design, seeds).table.assign(edge_workers=count))
        problem.objective.simulations += here.objective.simulations
    return _with_front(pd.concat(rows, ignore_index=True), "edge_workers")


def _with_front(table: pd.DataFrame, against: str) -> pd.DataFrame:
    if table[against].isna().any():
        raise ValueError(f"front.against: got {against}, which the network does not tell, expected another demand")
    kept = table["within_limit"].to_numpy()
    table["front"] = False
    table.loc[kept, "front"] = on_front(table.loc[kept, against], table.loc[kept, "score"])
    return table


def _best_of_each_tau(problem: Problem, candidates: Design) -> Design:
    """The best of the candidates at each sampling period: all on some of the choice seeds, the better ones on all."""
    count, chosen = len(np.asarray(candidates.tau)), []
    for tau in problem.space.tau:
        here, number = replace(candidates, tau=np.full(count, tau)), count
        for share in (8, 1):
            seeds = range(FIRST["choice"], FIRST["choice"] + CHOICE_SEEDS // share)
            scores, collided = problem.simulate(here, seeds)
            fitness = problem.fitness(scores, problem.excess(here, collided, cautious=share == 1))
            number = min(_KEPT, number) if share > 1 else 1
            here = take(here, np.argsort(-fitness, kind="stable")[:number])
        chosen.append(here)
    return stacked(chosen)


_FIRST, _APART = 100, 100  # the numbers below are those of the repetitions of a comparison
_KEPT = 12
