"""CMA-ES with margin, from the package `cmaes` (Hansen, 2016; Hamano et al., 2022, for values from a list)."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from qocjax.search.trial import Trial

__all__ = ["cma_es"]

_SIGMA = 0.3  # of the unit cube
_POPULATION = 16


def cma_es(trial: Trial) -> None:
    """Generations on a new block of seeds each, common to their members; starts anew where one has converged.

    The mean of the search distribution is looked at with each generation: it is less noisy than its members.

    Raises:
        BudgetSpentError: As every method ends.
        ValueError: The package `cmaes` is not installed.
    """
    package = _cmaes()
    start = np.full(trial.problem.space.dim, 0.5)
    while True:
        _one_start(trial, package, start)
        start = trial.rng.random(trial.problem.space.dim)


def _one_start(trial: Trial, package: ModuleType, start: np.ndarray) -> None:
    choices = np.array(trial.problem.space.choices())
    free = choices != 1  # a list of one leaves nothing to search
    steps = np.array([1 / (count - 1) if count else 0.0 for count in choices[free]])
    optimiser = package.CMAwM(
        mean=start[free], sigma=_SIGMA, bounds=np.tile([0.0, 1.0], (free.sum(), 1)), steps=steps,
        population_size=_POPULATION, seed=int(trial.rng.integers(2**31)),
    )  # fmt: skip

    def units(x: np.ndarray) -> np.ndarray:
        """Points of the cube; the k-th of n values lies at k / (n - 1) here and at (k + 1/2) / n there."""
        points = np.full((len(x), len(choices)), 0.5)
        points[:, free] = x
        for axis in np.flatnonzero(choices > 1):
            points[:, axis] = (np.round(points[:, axis] * (choices[axis] - 1)) + 0.5) / choices[axis]
        return points

    while not optimiser.should_stop():
        asked: list[tuple[Any, Any]] = [optimiser.ask() for _ in range(_POPULATION)]
        points = units(np.array([*(x for x, _ in asked), np.clip(optimiser.mean, 0.0, 1.0)]))
        fitness = trial.evaluate(points, trial.fresh_seeds())
        optimiser.tell([(told, -float(value)) for (_, told), value in zip(asked, fitness[:-1], strict=True)])


def _cmaes() -> ModuleType:
    try:
        import cmaes
    except ImportError:
        raise ValueError(
            "methods: got cma_es without the package cmaes, expected it installed (pip install 'qocjax[search]'), or "
            "other methods"
        ) from None
    return cmaes
