"""Advice on a network: how it is, which deadline and gains to set, and what that is worth (model, sections 4 to 6)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd

from qocjax.advice.assumptions import Otherwise, assumption_table, otherwise
from qocjax.advice.character import characterise, quantiles
from qocjax.advice.margins import Margin
from qocjax.advice.plan import Plan, found_by, plan_of
from qocjax.advice.reaching import Bound
from qocjax.advice.robust import Chosen
from qocjax.advice.shortlist import Effort
from qocjax.advice.slack import Asked, Slack, find_slack
from qocjax.advice.stress import largest_growth, stress_table
from qocjax.advice.tables import curves_of, judged_of
from qocjax.advice.target import Target
from qocjax.advice.verdict import answer_of, policy_of, verdict_of
from qocjax.controllers import Apf, Controller
from qocjax.network import Load, Network
from qocjax.network.schedule import Rules
from qocjax.quality import QocScale
from qocjax.scenario import Design, Scenario
from qocjax.search.objective import Objective
from qocjax.search.sensitivity import elasticities, sobol
from qocjax.statistics.units import trace_remark
from qocjax.study.capacity import at_once_text
from qocjax.study.edges import at_bounds
from qocjax.study.policies import MIN_RELIABILITY
from qocjax.study.reliability import load_of

__all__ = ["Advice", "advise", "plain"]


@dataclass(frozen=True)
class Advice:
    """What is advised, and what it rests on."""

    network: dict[str, Any]  # what the network is
    character: dict[str, Any]  # how it behaves at the recommended deadline
    trace: str  # what a measured trace is too short to say; empty where nothing is
    capacity: str  # how many computations at once it takes, in a line
    recommended: Design
    verdict: str  # of `VERDICTS`: whether it may be recommended
    objective: str  # what was maximised, of `robust.OBJECTIVES`
    by_mean: Design  # the best mean QoC, whatever becomes of it on a worse network
    kept: tuple[str, ...]  # gains that made no difference and so stay the user's
    at_edge: str  # which bounds of the search it lies at
    current: Design  # what it is compared with
    acceptable: str  # of `ANSWERS`: whether the current design may stay
    max_collision_share: float  # the limit that it was chosen under
    policy: str  # which of the three the current deadline amounts to
    judged: pd.DataFrame  # on fresh seeds: current, its gains at the recommended deadline, by the mean, recommended
    stress: pd.DataFrame  # recommended on networks that became worse
    ties: pd.DataFrame  # finalists that are not worse than the recommended, as far as the fresh seeds can tell
    actuation: Otherwise  # the recommended design where commands take effect otherwise
    assumptions: pd.DataFrame  # the recommended design where one of them is wrong, what matters most first
    setup: dict[str, Any]  # robots and runs that it was judged on
    target: Target  # what margins keep
    margin: Margin  # of the recommended gains
    current_margin: Margin  # of the current gains
    curve: pd.DataFrame  # QoC, collisions and F over the deadline, for both gains
    growth: Bound  # factor by which all loop times may grow, the deadline kept, until QoC leaves the margin
    elasticities: pd.DataFrame
    sobol: pd.DataFrame | None  # global indices over the bounds and the deadlines tried
    policies: tuple[tuple[str, float, float], ...]  # policy, its deadline, F there
    slack: Slack | None
    scale: QocScale
    seeds: dict[str, int]
    simulations: int
    unread: tuple[str, ...] = ()  # values of a design that neither controller nor robot reads


def advise(
    scenario: Scenario,
    network: Network,
    current: Design,
    bounds: dict[str, tuple[float, float]],
    *,
    rules: Rules | None = None,
    key: int = 0,
    longest_deadline: float = 0.8,
    max_collision_share: float = 0.01,
    how: str = "robust",
    taus: Sequence[float] = (),
    effort: Effort | None = None,
    scale: QocScale | None = None,
    asked: Asked | None = None,
    controller: Controller | None = None,
    told: Callable[[int], None] | None = None,
) -> Advice:
    """Recommends deadline and gains for a network, and says what they gain over the current ones.

    Args:
        scenario: Robots and yardstick.
        network: Where loop times come from.
        current: Numbers; its deadline is what one uses now, its tau stays unless others are given.
        bounds: Parameters that may change, with their bounds.
        rules: Actuation and hold.
        key: Root of all random numbers.
        longest_deadline: Longest deadline to consider (s).
        max_collision_share: Largest share of runs in which robots may come closer than two radii.
        how: What is maximised, of `robust.OBJECTIVES`.
        taus: Further sampling periods to choose from (s).
        effort: How much to simulate for the recommendation.
        scale: J_med and J_max; by default J_med of the current gains over the deadlines tried.
        asked: Which margins to work out.
        controller: What computes the commands, by default the surrogate law.
        told: Called with the number of runs, each time some are done.

    Raises:
        ValueError: An argument is out of range, the rules ask for plans, which no robot of ROS takes, hardly a loop
            completes by the longest deadline, or no design keeps the collision share: the message names the one that
            comes closest.
    """
    rules = rules or Rules()
    rules.check_single()
    plan = plan_of(
        scenario, network, current, bounds, rules=rules, key=key, longest=longest_deadline,
        limit=max_collision_share, how=how, taus=taus, effort=effort or Effort(), scale=scale, asked=asked or Asked(),
        controller=controller, told=told,
    )  # fmt: skip
    return _judged(plan, found_by(plan))


def _judged(plan: Plan, found: Chosen) -> Advice:
    """All that fresh seeds say of what was chosen."""
    goal, current, asked, limit, fresh = plan.objective, plan.current, plan.asked, plan.limit, plan.seeds.fresh
    best, network, target = found.design, goal.network, plan.target
    deadline, axis = float(np.asarray(best.deadline)), plan.axis(best)
    load = load_of(goal.scenario, float(np.asarray(best.tau)))
    judged, ties = judged_of(goal, found, current, fresh)
    beside = plan.beside
    curve, margins = curves_of(goal, best, current, plan.deadlines, beside, target, limit)
    few = plan.seeds.choice[: max(asked.seeds, len(beside) // 4)]
    return Advice(
        network=network.describe(),
        character=characterise(network, load, deadline, goal.key),
        trace=trace_remark(network, best.deadline, goal.scenario.horizon, best.tau) or "",
        capacity=at_once_text(network, load, deadline),
        recommended=best,
        verdict=verdict_of(found.safe, judged.iloc[-1], limit),
        objective=plan.how,
        by_mean=found.by_mean,
        kept=found.kept,
        at_edge=_at_edge(plan, found, axis),
        current=current,
        acceptable=answer_of(judged.iloc[0], margins[1], limit),
        max_collision_share=limit,
        policy=policy_of(float(np.asarray(current.deadline)), margins[1]),
        judged=judged,
        stress=stress_table(goal, best, {"current": current, "by_mean": found.by_mean}, beside, target, limit),
        ties=ties,
        actuation=otherwise(goal, best, axis, few, beside),
        assumptions=assumption_table(goal, best, beside, limit),
        setup=_setup(goal, best),
        target=target,
        margin=margins[0],
        current_margin=margins[1],
        curve=curve,
        growth=largest_growth(goal, best, beside, target),
        elasticities=_elasticities(plan, best),
        sobol=sobol(goal, plan.box, plan.axis(current).tolist(), fresh[: asked.seeds], asked.points, abs(goal.key))
        if asked.points
        else None,
        policies=_policies(network, load, best, plan.longest),
        slack=find_slack(goal, best, plan.longest, fresh[: asked.plane_seeds], asked, limit) if asked.delays else None,
        scale=goal.scale,
        seeds={name: len(getattr(plan.seeds, name)) for name in ("search", "choice", "fresh")},
        simulations=goal.simulations,
        unread=_unread(goal),
    )


def _unread(goal: Objective) -> tuple[str, ...]:
    """Values of a design that count for nothing; a law that reads a heading gain leaves it to the robot to steer."""
    own = (goal.controller or Apf()).unread
    return own if "gamma" in own else (*own, *goal.scenario.robot.unread)


def _setup(goal: Objective, best: Design) -> dict[str, Any]:
    """Robots and runs in numbers."""
    scenario, rules = goal.scenario, goal.rules
    return {
        "robots": scenario.num_robots, "robot_radius": float(np.asarray(scenario.robot_radius)),
        "v_max": float(np.asarray(best.v_max)), "omega_max": float(np.asarray(best.omega_max)),
        "horizon": scenario.horizon, "actuation": rules.actuation, "hold": rules.hold,
        "controller": type(goal.controller or Apf()).__name__,
    }  # fmt: skip


def _at_edge(plan: Plan, found: Chosen, axis: np.ndarray) -> str:
    """Which bounds of the search the recommended lies at."""
    free = {name: ends for name, ends in plan.box.bounds.items() if name not in found.kept}
    return at_bounds(found.design.values(), free, {"deadline": axis.tolist(), "tau": plan.periods.tolist()})


def _elasticities(plan: Plan, best: Design) -> pd.DataFrame:
    names = [name for name in (*plan.box.bounds, "deadline") if float(np.asarray(best.values()[name])) > 0]
    return elasticities(plan.objective, best, plan.beside, names)


def _policies(network: Network, load: Load, best: Design, longest: float) -> tuple[tuple[str, float, float], ...]:
    """Where the three policies stand: deadline (s) and F."""
    least = float(quantiles(network, load, [MIN_RELIABILITY], longest)[0])
    chosen = {"MinDelay": least, "Co-design": float(np.asarray(best.deadline)), "MaxRel": longest}
    return tuple((name, at, float(network.reliability(np.float64(at), load).share)) for name, at in chosen.items())


def plain(values: Any) -> Any:
    """Plain Python values for a file: no NumPy, six digits; what is not finite becomes None."""
    if isinstance(values, dict):
        return {str(key): plain(value) for key, value in values.items()}
    if isinstance(values, pd.DataFrame):
        return [plain(row) for row in values.to_dict("records")]
    if isinstance(values, Design):
        return plain(values.values())
    if hasattr(values, "__dataclass_fields__"):
        return plain(asdict(values))
    if isinstance(values, (list, tuple)):
        return [plain(value) for value in values]
    if isinstance(values, (np.generic, np.ndarray)):
        values = values.item()
    if not isinstance(values, float):
        return values
    return float(f"{values:.6g}") if math.isfinite(values) else None
