"""Which of many good designs to recommend: safe, close to the best, and the best where the network becomes worse.

The best deadline on a network lies now and then on a cliff: with a longer one all is nearly as good, on a slower
network all is lost. So among designs that the mean hardly tells apart the one is taken whose worst mean QoC over
stated changes is the largest; and of its gains each that makes no difference goes back to what the user has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qocjax import _checks
from qocjax.advice.little import Little
from qocjax.advice.shortlist import along_deadlines, row
from qocjax.advice.stress import on_network, worse
from qocjax.advice.trace_parts import worst_stretch
from qocjax.scenario import Design
from qocjax.search import stacked, take
from qocjax.search.objective import Objective
from qocjax.statistics.collisions import collision_share
from qocjax.statistics.scores import Scores
from qocjax.statistics.units import judged_apart

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["OBJECTIVES", "Chosen", "choose"]

OBJECTIVES = ("robust", "mean")
_CLOSE = 0.01  # of the best QoC: what a recommendation may cost on the network as it is
_PART = 0.2  # of the AUC that does not matter: what it may cost where that is more
_LONGER = (1.0, 1.1, 1.25, 1.5, 2.0)  # times the deadline of a finalist
_GAINS = 6  # finalists of which longer deadlines are tried


@dataclass(frozen=True)
class Chosen:
    """What is recommended."""

    design: Design
    by_mean: Design  # the best mean QoC among those that keep the limit
    safe: bool  # whether it keeps the limit on collisions, by the upper end of their share
    kept: tuple[str, ...]  # gains that are as the user has them
    others: Design  # that keep the limit and cannot be told from it


def choose(
    objective: Objective,
    finalists: Sequence[Design],
    current: Design,
    names: Sequence[str],
    limit: float,
    longest: float,
    seeds: Sequence[int],
    how: str = "robust",
    little: Little | None = None,
) -> Chosen:
    """Chooses among finalists, and their gains at longer deadlines.

    Args:
        objective: The setting.
        finalists: Of one search or several, each best first.
        current: What the user has.
        names: Gains that may differ from it.
        limit: Largest share of runs with a collision, kept by the upper end of its 95 % interval.
        longest: Longest deadline (s).
        seeds: [S] on which is chosen, others than those of the search.
        how: Of `OBJECTIVES`.
        little: AUC that does not matter; a fifth of it may go for standing up to changes, as 1 % of QoC may.

    Raises:
        ValueError: An unknown objective.
    """
    _checks.choice("advise.objective", how, OBJECTIVES)
    gains = [name for name in names if name != "tau"]
    pool = stacked([part for each in finalists
                    for part in (_with_longer(each, longest), *_given_back(each, current, gains))])  # fmt: skip
    runs = objective.runs(pool, seeds)
    scores, close = objective.judged(runs), runs["collided"].values.mean(axis=1)
    bench = _Bench(objective, seeds, scores.values.mean(axis=0))
    upper = bench.upper(runs)
    # Where none is shown to be safe, those that seem to be; the verdict says so.
    safe = next(each for each in (upper <= limit, close <= limit, upper <= upper.min()) if each.any())
    top = int(np.where(safe, scores.values.mean(axis=1), -np.inf).argmax())
    near = np.flatnonzero([safe[k] and _close(scores[k], scores[top], little) for k in range(upper.size)])
    others, best = take(pool, near), row(pool, top)
    if how == "robust":
        worst = bench.worst(others, scores[near])
        k = int(worst.argmax())
        start = _Start(row(others, k), scores[near[k]], max(limit, float(upper[near[k]])), float(worst[k]))
        best = _least_change(bench, start, current, names)
    kept = tuple(name for name in names if float(best.values()[name]) == float(current.values()[name]))
    return Chosen(best, row(pool, top), bool(upper.min() <= limit), kept, others)


@dataclass(frozen=True)
class _Bench:
    """Where designs are held against each other: one set of seeds, and what is usual on them."""

    objective: Objective
    seeds: Sequence[int]
    usual: np.ndarray  # [S] QoC, mean of all designs, so that luck with one does not make it the only safe one

    def upper(self, runs: xr.Dataset) -> np.ndarray:
        """The upper end of the share of runs with a collision of each design."""
        units, robots = self.objective.judged(runs).units, self.objective.scenario.num_robots
        return np.array([collision_share(hits, robots, units, self.usual).high for hits in runs["collided"].values])

    def worst(self, designs: Design, scores: Scores) -> np.ndarray:
        """The smallest mean QoC of each design over the changes; `scores` [G, S] are those without any.

        Of a trace that is judged on other stretches than these, the worst of these is such a change.
        """
        goal = self.objective
        changed = worse(goal, float(np.asarray(designs.tau)[0])).values()
        found = [on_network(goal, other, designs, self.seeds)[1].values.mean(axis=1) for other in changed]
        if judged_apart(goal.network, goal.scenario.horizon, designs.tau):
            found.append(worst_stretch(scores))
        return np.min(found, axis=0)


@dataclass(frozen=True)
class _Start:
    """A design with what it reaches."""

    design: Design
    scores: Scores
    allowed: float  # upper end of the collision share
    worst: float  # mean QoC over the changes


def _close(scores: Scores, best: Scores, little: Little | None) -> bool:
    """Whether a mean lies within a hundredth of the best or loses what hardly matters, or cannot be told from it."""
    gap, most = (scores - best).mean().given, float(best.values.mean())
    cost = _CLOSE if little is None else max(_CLOSE, 1.0 - little.share(most, _PART))
    return gap.mean >= -cost * most or gap.high >= 0.0


def _with_longer(finalists: Design, longest: float) -> Design:
    """The finalists, and the gains of the first at longer deadlines."""
    count = np.size(finalists.deadline)
    parts = [finalists]
    for k in range(min(count, _GAINS)):
        at = float(np.asarray(finalists.deadline)[k])
        step = 1e-3 if at < 0.05 else 5e-3  # numbers that one would set
        axis = np.unique(np.minimum(np.round(np.ceil(np.multiply(at, _LONGER[1:]) / step) * step, 6), longest))
        parts.append(along_deadlines(row(finalists, k), np.resize(axis, len(_LONGER) - 1)))  # of one size: one program
    return stacked(parts)


def _given_back(finalists: Design, current: Design, names: Sequence[str]) -> list[Design]:
    """The first finalists with one of the user's gains each: a search that is blind to them passes them by."""
    count = min(np.size(finalists.deadline), _GAINS)
    first = take(finalists, list(range(count)))
    return [first.having({name: np.full(count, float(current.values()[name]))}) for name in names]


def _least_change(bench: _Bench, start: _Start, current: Design, names: Sequence[str]) -> Design:
    """Gives gains back, one at a time, as long as neither mean nor worst QoC nor safety are told to suffer."""
    best, floor = start.design, start.worst * (1.0 - _CLOSE)
    while left := [name for name in names if float(best.values()[name]) != float(current.values()[name])]:
        trials = [best.having({name: float(current.values()[name])}) for name in left]
        designs = stacked([*trials, *[best] * (len(names) - len(trials))])  # of one size: one program
        runs = bench.objective.runs(designs, bench.seeds)
        scores, upper = bench.objective.judged(runs), bench.upper(runs)
        lowest = bench.worst(designs, scores)
        fine = [
            k for k in range(len(left))
            if (scores[k] - start.scores).mean().given.high >= 0.0 and upper[k] <= start.allowed and lowest[k] >= floor
        ]  # fmt: skip
        if not fine:
            break
        best = trials[max(fine, key=lambda k: lowest[k])]
    return best
