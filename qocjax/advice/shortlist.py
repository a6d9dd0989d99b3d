"""A modest joint search: Sobol points times deadlines, halved over ever more seeds, within a collision limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qocjax import _checks
from qocjax.scenario import Design
from qocjax.search import stacked, take
from qocjax.search.objective import Objective
from qocjax.search.sensitivity import Box
from qocjax.statistics.estimates import share as share_of
from qocjax.study.sweep import qoc_by_seed

__all__ = ["Effort", "along_deadlines", "row", "shortlist"]


@dataclass(frozen=True)
class Effort:
    """How much is simulated: Sobol points times deadlines, halved over ever more seeds; the chosen on fresh ones."""

    points: int = 64
    rounds: tuple[int, ...] = (8, 32, 128)  # seeds of each, the first part of the next
    finalists: int = 32
    fresh_seeds: int = 1024  # to judge: a share of 1 % takes so many
    choice_seeds: int | None = None  # to choose among the finalists; None for as many
    beside_seeds: int | None = None  # of them, for curves, changes, assumptions and slopes; None for all
    deadlines: int | None = None  # most on the axis; None for all that are worth a try

    def __post_init__(self) -> None:
        for name in ("points", "finalists"):
            _checks.count(name, getattr(self, name))
        _checks.count("fresh_seeds", self.fresh_seeds, least=2)
        for name, least in (("choice_seeds", 2), ("beside_seeds", 2), ("deadlines", 3)):
            if getattr(self, name) is not None:
                _checks.count(name, getattr(self, name), least=least)
        if len(self.rounds) == 0 or min(self.rounds) < 2 or list(self.rounds) != sorted(set(self.rounds)):
            raise ValueError(f"rounds: got {list(self.rounds)}, expected ascending numbers of seeds, each at least 2")


def shortlist(
    objective: Objective, box: Box, axis: np.ndarray, limit: float, effort: Effort, search: Sequence[int]
) -> Design:
    """Finalists, the best first: Sobol points over the box, again over the box of the best, then successive halving.

    Args:
        objective: The setting.
        box: Gains and their bounds.
        axis: Deadlines (s).
        limit: Largest share of runs with a collision.
        effort: How much is simulated.
        search: Seeds of the last round; those of each round are the first of these.

    Raises:
        ValueError: Every design that was tried is shown to break the limit; the message names the closest.
    """
    rng = np.random.default_rng(objective.key % 2**32)
    seeds = search[: effort.rounds[0]]
    unit = box.points(effort.points, rng)
    pool = stacked([_crossed(box, unit, axis), along_deadlines(box.baseline, axis)])
    score, share, hits = _measure(objective, pool, seeds)
    elite = _order(score, share, limit)[: 2 * effort.finalists]
    # The second round: the smallest box that holds the best, widened, as it holds few of them.
    inside = unit[elite[elite < len(unit) * axis.size] // axis.size]
    if len(inside):
        low, high = np.clip([inside.min(axis=0) - 0.05, inside.max(axis=0) + 0.05], 0.0, 1.0)
        nearby = np.unique(np.asarray(pool.deadline)[elite])
        again = _crossed(box, low + (high - low) * box.points(effort.points, rng), nearby)
        pool = stacked([take(pool, elite), again])
        score, share, hits = _measure(objective, pool, seeds)
    for k, count in enumerate(effort.rounds[1:], start=1):
        left = max(effort.finalists, score.size // 8 if k < len(effort.rounds) - 1 else effort.finalists)
        pool = take(pool, _order(score, share, limit)[:left])
        score, share, hits = _measure(objective, pool, search[:count])
    cautious = np.where(share > 0, share + np.sqrt(share * (1 - share) / effort.rounds[-1]), share)
    share = cautious if cautious.min() <= limit else share  # a design at the limit is within it by luck
    order = _order(score, share, limit)[: effort.finalists]
    within = share <= limit
    if not within.any():  # few seeds do not tell: those remain that are not shown to break it
        units = objective.units(search[: effort.rounds[-1]], pool.tau)
        within = np.array([share_of(each, units).low for each in hits]) <= limit
    if not within.any():
        least = row(pool, int(order[0]))
        values = ", ".join(f"{name}={float(least.values()[name]):.3g}" for name in (*box.bounds, "deadline"))
        raise ValueError(
            f"max_collision_share: got {limit:g}, which no design that was tried keeps; the closest has "
            f"{share[order[0]]:.3g}, with {values}"
        )
    return take(pool, order[within[order]])


def _measure(objective: Objective, designs: Design, seeds: Sequence[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean QoC and share of collisions of each design, and which of its runs [G, S] collide."""
    runs = objective.runs(designs, seeds)
    hits = runs["collided"].values
    return qoc_by_seed(runs, objective.scale).mean(axis=1), hits.mean(axis=1), hits


def _order(score: np.ndarray, share: np.ndarray, limit: float) -> np.ndarray:
    """Best first: those within the limit by QoC, then the others by how far they are from it."""
    return np.lexsort((-score, np.maximum(share - limit, 0.0)))


def _crossed(box: Box, unit: np.ndarray, axis: np.ndarray) -> Design:
    """Every point with every deadline, the deadline running fastest."""
    return box.designs(np.repeat(unit, axis.size, axis=0), np.tile(axis, len(unit)))


def along_deadlines(current: Design, axis: np.ndarray) -> Design:
    """One design with every deadline (s)."""
    values = {name: np.full(axis.size, float(np.asarray(value))) for name, value in current.values().items()}
    return Design.of(values | {"deadline": axis})


def row(designs: Design, index: int) -> Design:
    """One design of a group, as numbers."""
    return Design.of({name: float(np.asarray(value)[index]) for name, value in designs.values().items()})
