"""Scrambled Sobol points with successive halving over seeds (Sobol, 1967; Owen, 1998; Jamieson and Talwalkar, 2016)."""

from __future__ import annotations

import numpy as np

from qocjax._lazy import stats
from qocjax.search.trial import Trial

__all__ = ["sobol_halving"]

_RUNGS = 4
_KEPT = 3  # one point in so many goes on to the next rung, with twice the seeds added
_AT_ONCE = 32


def sobol_halving(trial: Trial) -> None:
    """Many points on few seeds; the better third goes on, with more seeds, until few points have many.

    Rounds of that kind, each with new points, until the budget is spent; the first takes most of it.

    Raises:
        BudgetSpentError: As every method ends.
    """
    while True:
        each = sum((2 / _KEPT) ** rung for rung in range(_RUNGS)) * trial.block
        count = max(1, int(trial.left / each))
        sampler = stats().qmc.Sobol(trial.problem.space.dim, scramble=True, seed=trial.rng)
        points = sampler.random_base2(int(np.ceil(np.log2(count))))[:count]
        _halve(trial, points)


def _halve(trial: Trial, points: np.ndarray) -> None:
    points = trial.problem.space.snapped(points)
    for rung in range(_RUNGS):
        seeds = trial.fresh_seeds(2**rung)
        for first in range(0, len(points), _AT_ONCE):
            trial.evaluate(points[first : first + _AT_ONCE], seeds)
        if len(points) <= 1:
            return
        merits = [-trial.archive[point.tobytes()].merit for point in points]
        points = points[np.argsort(merits, kind="stable")[: max(1, len(points) // _KEPT)]]
