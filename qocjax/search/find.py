"""A search from its budget to its design: the last part of the budget chooses among the best that were met."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from qocjax import _checks
from qocjax.scenario import Design
from qocjax.search.methods import METHODS
from qocjax.search.trial import BudgetSpentError, Problem, Trial, take

__all__ = ["CHOICE_SEEDS", "FINALISTS", "FIRST", "Found", "find"]

# Where the seeds of each purpose begin: searches, choices, judgements and the one-at-a-time sweeps never share one.
FIRST = {"search": 0, "choice": 100_000_000, "judge": 200_000_000, "sweep": 300_000_000, "pilot": 400_000_000}
CHOICE_SEEDS = 64
_APART = 100_000  # seeds between two repetitions
FINALISTS = 12


@dataclass(frozen=True)
class Found:
    """What a search came to."""

    method: str
    repetition: int
    design: Design  # one design, [1]
    fitness: float  # on the choice seeds; below 0 where no finalist keeps the limits
    excess: float  # by how much the limits are broken there; 0 where they are kept
    finalists: Design  # [F]
    history: list[tuple[int, Design]]  # (simulations spent, best design known then)
    spent: int

    @property
    def feasible(self) -> bool:
        """Whether a design that keeps the limits was found."""
        return self.excess == 0


def find(
    problem: Problem,
    method: str,
    budget: int,
    *,
    repetition: int = 0,
    key: int = 0,
    block: int = 8,
    choice_seeds: int = CHOICE_SEEDS,
    finalists: int = FINALISTS,
) -> Found:
    """Searches with a method, then simulates the best points anew on seeds of their own, and takes the best of them.

    Args:
        problem: What is to be found.
        method: One of `METHODS`.
        budget: Simulations, those of the final choice included.
        repetition: Number of this search; each has its own random numbers and seeds.
        key: Root of the random numbers of the method.
        block: Seeds of one look at a point.
        choice_seeds: Seeds of the final choice, on which each of its points is simulated.
        finalists: How many points those are.

    Raises:
        ValueError: An unknown method, or a budget that leaves nothing to search with.
    """
    _checks.choice("method", method, METHODS)
    reserve = _checks.count("finalists", finalists) * _checks.count("choice_seeds", choice_seeds, least=2)
    least = reserve + 32 * _checks.count("block", block, least=2)
    if _checks.count("budget", budget) < least:
        raise ValueError(f"budget: got {budget} simulations, expected at least {least}, of which {reserve} are for the "
                         "final choice")  # fmt: skip
    rng = np.random.default_rng([abs(key), repetition, list(METHODS).index(method)])
    first = FIRST["search"] + _APART * (repetition * len(METHODS) + list(METHODS).index(method))
    narrowed = problem.limits.narrowed(problem.space, problem.objective.reliability, problem.demand)
    trial = Trial(replace(problem, space=narrowed), budget - reserve, first, rng, block)
    try:
        METHODS[method](trial)
    except BudgetSpentError:
        pass
    return _choose(trial, method, repetition, choice_seeds, finalists)


def _choose(trial: Trial, method: str, repetition: int, choice_seeds: int, count: int) -> Found:
    space = trial.problem.space
    finalists = space.designs(np.array([known.unit for known in trial.finalists(count)]))
    seeds = range(FIRST["choice"], FIRST["choice"] + choice_seeds)
    scores, collided = trial.problem.simulate(finalists, seeds)
    excess = trial.problem.excess(finalists, collided, cautious=True)
    fitness = trial.problem.fitness(scores, excess)
    place = int(np.argmax(fitness))
    history: list[tuple[int, Design]] = []
    for spent, unit in trial.history:
        history.append((spent, space.designs(unit)))
    spent = trial.spent + len(excess) * choice_seeds
    chosen = take(finalists, [place])
    history.append((spent, chosen))
    return Found(method, repetition, chosen, float(fitness[place]), float(excess[place]), finalists, history, spent)
