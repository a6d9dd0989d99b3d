"""Which of many good designs to recommend: safe, close to the best, and the best where the network becomes worse.

The best deadline on a network lies now and then on a cliff: with a longer one all is nearly as good, on a slower
network all is lost. So among designs that the mean hardly tells apart the one is taken whose worst mean QoC over
stated changes is the largest; and of its gains each that makes no difference goes back to what the user has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qocjax import _checks
from qocjax.scenario import Design
from qocjax.study.objective import Objective
from qocjax.study.scores import Scores
from qocjax.study.search import stacked, take
from qocjax.study.shortlist import along_deadlines, row
from qocjax.study.statistics import share
from qocjax.study.stress import on_network, worse

__all__ = ["OBJECTIVES", "Chosen", "choose"]

OBJECTIVES = ("robust", "mean")
_CLOSE = 0.01  # of the best QoC: what a recommendation may cost on the network as it is
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

    Raises:
        ValueError: An unknown objective.
    """
    _checks.choice("advise.objective", how, OBJECTIVES)
    gains = [name for name in names if name != "tau"]
    pool = stacked([part for each in finalists
                    for part in (_with_longer(each, longest), *_given_back(each, current, gains))])  # fmt: skip
    scores, upper, close = _measured(objective, pool, seeds)
    # Where none is shown to be safe, those that seem to be; the verdict says so.
    safe = next(each for each in (upper <= limit, close <= limit, upper <= upper.min()) if each.any())
    means = np.where(safe, scores.values.mean(axis=1), -np.inf)
    top = int(means.argmax())
    near = np.flatnonzero([safe[k] and _close(scores[k], scores[top]) for k in range(means.size)])
    if how == "mean":
        best = row(pool, top)
    else:
        best = row(pool, int(near[_worst(objective, take(pool, near), seeds).argmax()]))
    others = take(pool, near)
    if how == "robust":
        best = _least_change(objective, best, current, names, limit, seeds)
    kept = tuple(name for name in names if float(getattr(best, name)) == float(getattr(current, name)))
    return Chosen(best, row(pool, top), bool(upper.min() <= limit), kept, others)


def _close(scores: Scores, best: Scores) -> bool:
    """Whether a mean lies within a hundredth of the best, or cannot be told from it."""
    gap = (scores - best).mean().given
    return gap.mean >= -_CLOSE * float(best.values.mean()) or gap.high >= 0.0


def _measured(objective: Objective, designs: Design, seeds: Sequence[int]) -> tuple[Scores, np.ndarray, np.ndarray]:
    """Scores, and the upper end of each collision share, and the share."""
    runs = objective.runs(designs, seeds)
    scores, collided = objective.judged(runs), runs["collided"].values
    usual = scores.values.mean(axis=0)  # of all designs, so that luck with one does not make it the only safe one
    found = [share(hits, scores.units, like=usual) for hits in collided]
    return scores, np.array([each.high for each in found]), np.array([each.mean for each in found])


def _worst(objective: Objective, designs: Design, seeds: Sequence[int]) -> np.ndarray:
    """The smallest mean QoC of each design over the changes."""
    changed = worse(objective, float(np.asarray(designs.tau)[0])).values()
    return np.min([on_network(objective, other, designs, seeds)[1].values.mean(axis=1) for other in changed], axis=0)


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
    return [replace(first, **{name: np.full(count, float(getattr(current, name)))}) for name in names]


def _least_change(
    objective: Objective, best: Design, current: Design, names: Sequence[str], limit: float, seeds: Sequence[int]
) -> Design:
    """Gives gains back, one at a time, as long as neither mean nor worst QoC nor safety are told to suffer."""
    first, (scores, upper, _) = best, _measured(objective, stacked([best] * (len(names) + 1)), seeds)
    base, allowed = scores[0], max(limit, float(upper[0]))
    floor = float(_worst(objective, stacked([best]), seeds)[0]) * (1.0 - _CLOSE)
    while left := [name for name in names if float(getattr(best, name)) != float(getattr(current, name))]:
        trials = [replace(best, **{name: float(getattr(current, name))}) for name in left]
        trials += [first] * (len(names) + 1 - len(trials))  # of one size: one program
        scores, upper, _ = _measured(objective, stacked(trials), seeds)
        lowest = _worst(objective, stacked(trials), seeds)
        fine = [
            k for k in range(len(left))
            if (scores[k] - base).mean().given.high >= 0.0 and upper[k] <= allowed and lowest[k] >= floor
        ]  # fmt: skip
        if not fine:
            break
        best = trials[max(fine, key=lambda k: lowest[k])]
    return best
