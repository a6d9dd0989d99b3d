"""One search: what it asks, what it has spent, and the best that it knows."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from qocjax.batch import gradient
from qocjax.network.demand import Demand, Traffic
from qocjax.quality import qoc_slope
from qocjax.scenario import Design
from qocjax.search.limits import Limits
from qocjax.search.measure import Measure
from qocjax.search.objective import Objective
from qocjax.search.space import Space
from qocjax.statistics.scores import Scores
from qocjax.study.sweep import qoc_by_seed

__all__ = ["BudgetSpentError", "Known", "Problem", "Trial", "take"]

_RANKED = 64  # points of the greatest merit that are considered
_NEAR = 0.15  # distance in the cube up to which the collisions of a point speak for another


class BudgetSpentError(Exception):
    """The search asks for more simulations than are left to it."""


@dataclass(frozen=True)
class Problem:
    """What is to be found: the best design of a space under limits."""

    objective: Objective
    space: Space
    limits: Limits = Limits()
    traffic: Traffic = Traffic()
    measure: Measure = Measure()

    def simulate(self, designs: Design, seeds: range) -> tuple[np.ndarray, np.ndarray]:
        """QoC and whether robots collided, each [G, S]."""
        runs = self.objective.runs(designs, seeds)
        return qoc_by_seed(runs, self.objective.scale), runs["collided"].values.astype(bool)

    def judged(self, designs: Design, seeds: range) -> tuple[Scores, np.ndarray]:
        """As `simulate`, with what the intervals of the scores need."""
        runs = self.objective.runs(designs, seeds)
        return self.objective.judged(runs), runs["collided"].values.astype(bool)

    def demand(self, tau: np.ndarray) -> Demand:
        """What sampling periods (s) ask of network and edge."""
        return self.traffic.of(tau, self.objective.scenario.num_robots, self.objective.workers(tau))

    def excess(self, designs: Design, collided: np.ndarray, *, cautious: bool = False) -> np.ndarray:
        """By how much designs break the limits, [G]."""
        known = self.limits.of_network(designs, self.objective.reliability, self.demand(np.asarray(designs.tau)))
        return known + self.limits.of_runs(collided, cautious=cautious)

    def fitness(self, scores: np.ndarray, excess: np.ndarray) -> np.ndarray:
        """The measure of designs that keep the limits; the others lie below all of these, by their excess."""
        return np.where(excess > 0, -excess, np.maximum(self.measure(scores), 0.0))


@dataclass
class Known:
    """All that a search has seen of one point."""

    unit: np.ndarray  # [D]
    scores: np.ndarray  # [S]
    collided: np.ndarray  # [S]
    merit: float = 0.0  # its fitness less a standard error: what has been seen little of is not trusted


@dataclass
class Trial:
    """A budget of simulations and the archive of what they showed.

    A method asks for points and gets their fitness; it never sees the seeds that designs are judged on.
    """

    problem: Problem
    budget: int
    first_seed: int
    rng: np.random.Generator
    block: int = 8  # seeds of one look at a point
    spent: int = 0
    stop: int = 0  # spending at which the present method ends
    archive: dict[bytes, Known] = field(default_factory=dict)
    history: list[tuple[int, np.ndarray]] = field(default_factory=list)  # (spent, best point known then)
    _used: int = 0

    def __post_init__(self) -> None:
        self.stop = self.budget

    @property
    def left(self) -> int:
        """Simulations that are left."""
        return self.stop - self.spent

    def fresh_seeds(self, blocks: int = 1) -> range:
        """Seeds that this search has not used yet."""
        first = self.first_seed + self._used
        self._used += blocks * self.block
        return range(first, self.first_seed + self._used)

    def evaluate(self, units: np.ndarray, seeds: range) -> np.ndarray:
        """Fitness of points [G, D] on these seeds alone, [G], to be maximised; below 0 where limits are broken.

        Raises:
            BudgetSpentError: That many simulations are not left; nothing was simulated.
        """
        points = self.problem.space.snapped(units)
        self._charge(len(points) * len(seeds))
        designs = self.problem.space.designs(points)
        scores, collided = self.problem.simulate(designs, seeds)
        for row, point in enumerate(points):
            self._remember(point, scores[row], collided[row])
        self.history.append((self.spent, self.finalists(1)[0].unit))
        return self.problem.fitness(scores, self.problem.excess(designs, collided))

    def slopes(self, units: np.ndarray, seeds: range) -> np.ndarray:
        """Derivative of each run's QoC in the continuous coordinates but the deadline, [G, S, number of bounds].

        Forward mode carries a tangent per value along, so a run counts as one more simulation for each.
        The QoC is that of the robots' mean AUC.

        Raises:
            BudgetSpentError: As for `evaluate`.
        """
        names = tuple(self.problem.space.bounds)
        self._charge(len(units) * len(seeds) * (1 + len(names)))
        goal = self.problem.objective
        designs = self.problem.space.designs(units)
        found = gradient(goal.scenario, designs, goal.network, seeds, names, mode="forward", rules=goal.rules,
                         key=goal.key, controller=goal.controller)  # fmt: skip
        auc = found["auc"].values.astype(np.float64)
        by_value = np.stack([found[f"d_auc_{name}"].values.astype(np.float64) for name in names], axis=-1)
        return qoc_slope(auc, goal.scale)[..., None] * by_value * self.problem.space.slopes(units)[:, None, :]

    def best(self, count: int) -> list[Known]:
        """The points of the greatest merit, best first."""
        return sorted(self.archive.values(), key=lambda known: -known.merit)[:count]

    def finalists(self, count: int) -> list[Known]:
        """The best points to go on with: of the greatest merit, those first around which few runs collided.

        A few seeds of one point say little of a small share of collisions; its neighbours know more. Without a limit
        on collisions these are the points of the greatest merit.
        """
        ranked = self.best(_RANKED)
        limit = self.problem.limits.collision_share
        if limit is None:
            return ranked[:count]
        known = list(self.archive.values())
        units = np.array([one.unit for one in known])
        hits = np.array([one.collided.sum() for one in known])
        seeds = np.array([one.collided.size for one in known])

        def crowded(one: Known) -> bool:
            near = ((units - one.unit) ** 2).sum(axis=1) <= _NEAR**2
            return bool(hits[near].sum() > limit * seeds[near].sum())

        return sorted(ranked, key=crowded)[:count]  # stable: by merit within both

    def _charge(self, simulations: int) -> None:
        if simulations > self.left:
            raise BudgetSpentError
        self.spent += simulations

    def _remember(self, point: np.ndarray, scores: np.ndarray, collided: np.ndarray) -> None:
        known = self.archive.get(point.tobytes())
        if known is None:
            known = self.archive[point.tobytes()] = Known(point, scores, collided)
        else:
            known.scores = np.concatenate([known.scores, scores])
            known.collided = np.concatenate([known.collided, collided])
        excess = self.problem.excess(self.problem.space.designs(point), known.collided[None])[0]
        if excess > 0:
            known.merit = -float(excess)
        else:
            known.merit = max(float(self.problem.measure(known.scores) - self.problem.measure.error(known.scores)), 0.0)


def take(designs: Design, rows: list[int] | np.ndarray) -> Design:
    """Some designs of several."""
    return designs.at(rows)
