"""Random search: the floor that a method has to beat."""

from __future__ import annotations

from qocjax.search.trial import Trial

__all__ = ["random_points"]

_AT_ONCE = 32


def random_points(trial: Trial) -> None:
    """Uniform points of the cube, one block of seeds each.

    Raises:
        BudgetSpentError: As every method ends.
    """
    seeds = trial.fresh_seeds()  # the same for all points, which are then compared in pairs
    while True:
        count = max(1, min(_AT_ONCE, trial.left // len(seeds)))
        trial.evaluate(trial.rng.random((count, trial.problem.space.dim)), seeds)
