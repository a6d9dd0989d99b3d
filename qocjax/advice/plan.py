"""How an advice is found: what is given, the seeds of each purpose, the search and the choice."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from qocjax import _checks
from qocjax.advice.character import candidate_deadlines
from qocjax.advice.robust import OBJECTIVES, Chosen, choose
from qocjax.advice.shortlist import Effort, shortlist
from qocjax.advice.slack import Asked
from qocjax.advice.target import Target, usual_target
from qocjax.controllers import Controller
from qocjax.network import Network
from qocjax.network.schedule import Rules
from qocjax.quality import QocScale
from qocjax.scenario import Design, Scenario
from qocjax.search.objective import Objective, pilot_scale
from qocjax.search.sensitivity import Box
from qocjax.statistics.units import seeds_apart
from qocjax.study.reliability import load_of

__all__ = ["Plan", "Seeds", "found_by", "plan_of"]


@dataclass(frozen=True)
class Seeds:
    """Seeds of each purpose; no two share one, and of a long trace those that judge take other stretches."""

    search: Sequence[int]
    choice: Sequence[int]
    fresh: Sequence[int]


@dataclass(frozen=True)
class Plan:
    """What is given, and what follows from it before anything is searched."""

    objective: Objective
    current: Design
    box: Box
    periods: np.ndarray  # sampling periods to choose from, s
    deadlines: np.ndarray  # those of the curves, s
    longest: float  # s
    limit: float  # share of runs with a collision
    how: str  # of `OBJECTIVES`
    effort: Effort
    asked: Asked
    seeds: Seeds

    def axis(self, design: Design) -> np.ndarray:
        """Deadlines worth a try (s) at the sampling period of a design."""
        goal = self.objective
        return _axis(goal.scenario, goal.network, design, self.longest, self.effort.deadlines)

    @property
    def target(self) -> Target:
        """What margins keep."""
        assert self.asked.target is not None  # `plan_of` has filled it in
        return self.asked.target

    @property
    def beside(self) -> Sequence[int]:
        """Fresh seeds of curves, changes, assumptions and slopes."""
        return self.seeds.fresh[: self.effort.beside_seeds]


def plan_of(
    scenario: Scenario,
    network: Network,
    current: Design,
    bounds: dict[str, tuple[float, float]],
    *,
    rules: Rules,
    key: int,
    longest: float,
    limit: float,
    how: str,
    taus: Sequence[float],
    effort: Effort,
    scale: QocScale | None,
    asked: Asked,
    controller: Controller | None = None,
    told: Callable[[int], None] | None = None,
) -> Plan:
    """Checks what is given, shares out the seeds and fixes the scale; for the arguments see `advise`.

    Raises:
        ValueError: An argument is out of range, or hardly a loop completes by the longest deadline.
    """
    _checks.bounded("max_collision_share", limit, least=0, most=1)
    _checks.bounded("margins.delay", asked.delay or 0.0, most=longest)
    _checks.choice("advise.objective", how, OBJECTIVES)
    if asked.target is not None:
        asked.target.check(scenario)
    box = Box(current, bounds)
    axis = _axis(scenario, network, current, longest, effort.deadlines)
    periods = np.unique(np.append(_checks.bounded("taus", taus, above=0), float(np.asarray(current.tau))))
    counts = [effort.rounds[-1], effort.choice_seeds or effort.fresh_seeds, effort.fresh_seeds]
    seeds = Seeds(*seeds_apart(network, key, counts, scenario.horizon, periods))
    between = np.zeros(0) if effort.deadlines is not None else np.geomspace(axis[0], longest, 12)
    deadlines = np.unique(np.concatenate([axis, between]))
    pilot = [0.0, *deadlines.tolist()]  # from a deadline at which hardly a robot moves: the worst that can happen
    few = seeds.search[: effort.rounds[0]]
    scale = scale or pilot_scale(scenario, network, current, pilot, few, rules=rules, key=key, controller=controller)
    spent = len(pilot) * len(few)
    asked = replace(asked, target=asked.target or usual_target(scenario, scale))
    objective = Objective(scenario, network, scale, rules, key, spent, controller, told)
    return Plan(objective, current, box, periods, deadlines, longest, limit, how, effort, asked, seeds)


def _axis(scenario: Scenario, network: Network, design: Design, longest: float, most: int | None) -> np.ndarray:
    """Deadlines worth a try (s), at most so many of them, spread evenly over their order."""
    found = candidate_deadlines(network, load_of(scenario, float(np.asarray(design.tau))), longest)
    if most is None or found.size <= most:
        return found
    return found[np.unique(np.round(np.linspace(0, found.size - 1, most)).astype(int))]


def found_by(plan: Plan) -> Chosen:
    """Searches at each sampling period, and chooses among what was found.

    Raises:
        ValueError: No design keeps the limit on collisions at any sampling period.
    """
    free = [*plan.box.bounds, *(["tau"] if plan.periods.size > 1 else [])]
    return choose(
        plan.objective, _shortlists(plan), plan.current, free, plan.limit, plan.longest, plan.seeds.choice, plan.how,
        plan.target.little,
    )  # fmt: skip


def _shortlists(plan: Plan) -> list[Design]:
    """Finalists at each sampling period; without those periods at which no design keeps the limit on collisions."""
    found, failed = [], []
    for tau in plan.periods.tolist():
        here = replace(plan.box, baseline=replace(plan.box.baseline, tau=tau))
        try:
            axis = plan.axis(here.baseline)
            found.append(shortlist(plan.objective, here, axis, plan.limit, plan.effort, plan.seeds.search))
        except ValueError as error:
            failed.append(error)
    if not found:
        raise failed[0]
    return found
