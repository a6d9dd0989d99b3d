"""Advice on a network: how it is, which deadline and gains to set, and what that is worth (model, sections 4 to 6)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from qocjax import _checks
from qocjax.network import Load, Network
from qocjax.network.schedule import Rules
from qocjax.quality import QocScale
from qocjax.scenario import Design, Scenario
from qocjax.study.actuation import Otherwise, otherwise
from qocjax.study.advice_tables import curves_of, judged_of
from qocjax.study.capacity import at_once_text
from qocjax.study.character import candidate_deadlines, characterise, quantiles
from qocjax.study.edges import at_bounds
from qocjax.study.margins import Bound, Margin
from qocjax.study.objective import Objective, pilot_scale
from qocjax.study.policies import MIN_RELIABILITY
from qocjax.study.reliability import load_of
from qocjax.study.robust import OBJECTIVES, choose
from qocjax.study.sensitivity import Box, elasticities, sobol
from qocjax.study.shortlist import Effort, shortlist
from qocjax.study.slack import Asked, Slack, find_slack
from qocjax.study.stress import largest_growth, stress_table
from qocjax.study.units import seeds_apart, trace_remark
from qocjax.study.verdict import answer_of, policy_of, verdict_of

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

    Raises:
        ValueError: An argument is out of range, hardly a loop completes by the longest deadline, or no design keeps
            the collision share: the message names the one that comes closest.
    """
    rules, effort, asked = rules or Rules(), effort or Effort(), asked or Asked()
    _checks.bounded("max_collision_share", max_collision_share, least=0, most=1)
    _checks.bounded("margins.delay", asked.delay or 0.0, most=longest_deadline)
    _checks.choice("advise.objective", how, OBJECTIVES)
    box, axis = Box(current, bounds), _axis(scenario, network, current, longest_deadline)
    periods = np.unique(np.append(_checks.bounded("taus", taus, above=0), float(np.asarray(current.tau))))
    counts = [effort.rounds[-1], effort.fresh_seeds, effort.fresh_seeds]
    search, choice, fresh = seeds_apart(network, key, counts, scenario.horizon, periods)
    fine = np.unique(np.concatenate([axis, np.geomspace(axis[0], longest_deadline, 12)]))
    pilot = [0.0, *fine.tolist()]  # from a deadline at which hardly a robot moves: the worst that can happen
    few = search[: effort.rounds[0]]
    scale = scale or pilot_scale(scenario, network, current, pilot, few, rules=rules, key=key)
    objective = Objective(scenario, network, scale, rules, key, simulations=len(pilot) * len(few))
    finalists = _shortlists(objective, box, periods, longest_deadline, max_collision_share, effort, search)
    free = [*bounds, *(["tau"] if periods.size > 1 else [])]
    found = choose(objective, finalists, current, free, max_collision_share, longest_deadline, choice, how)
    best, deadline = found.design, float(np.asarray(found.design.deadline))
    load, axis = load_of(scenario, float(np.asarray(best.tau))), _axis(scenario, network, best, longest_deadline)
    judged, ties = judged_of(objective, found, current, fresh)
    part, some = fresh[: asked.seeds], fresh[: max(asked.seeds, len(fresh) // 4)]
    curve, margins = curves_of(objective, best, current, fine, some, asked.share, max_collision_share)
    names = [name for name in (*bounds, "deadline") if float(np.asarray(getattr(best, name))) > 0]
    return Advice(
        network=network.describe(),
        character=characterise(network, load, deadline, key),
        trace=trace_remark(network, best.deadline, scenario.horizon, best.tau) or "",
        capacity=at_once_text(network, load, deadline),
        recommended=best,
        verdict=verdict_of(found.safe, judged.iloc[-1], max_collision_share),
        objective=how,
        by_mean=found.by_mean,
        kept=found.kept,
        at_edge=at_bounds(
            asdict(best),
            {name: ends for name, ends in bounds.items() if name not in found.kept},
            {"deadline": axis.tolist(), "tau": periods.tolist()},
        ),
        current=current,
        acceptable=answer_of(judged.iloc[0], margins[1], max_collision_share),
        max_collision_share=max_collision_share,
        policy=policy_of(float(np.asarray(current.deadline)), margins[1]),
        judged=judged,
        stress=stress_table(objective, best, {"current": current, "by_mean": found.by_mean}, fresh),
        ties=ties,
        actuation=otherwise(objective, best, axis, choice[: len(some)], fresh),
        margin=margins[0],
        current_margin=margins[1],
        curve=curve,
        growth=largest_growth(objective, best, fresh, asked.share),
        elasticities=elasticities(objective, best, fresh, names),
        sobol=sobol(objective, box, axis.tolist(), part, asked.points, abs(key)) if asked.points else None,
        policies=_policies(network, load, best, longest_deadline),
        slack=find_slack(objective, best, longest_deadline, part, asked) if asked.delays else None,
        scale=scale,
        seeds={"search": len(search), "choice": len(choice), "fresh": len(fresh)},
        simulations=objective.simulations,
    )


def _axis(scenario: Scenario, network: Network, design: Design, longest: float) -> np.ndarray:
    """Deadlines worth a try (s) at the sampling period of a design."""
    return candidate_deadlines(network, load_of(scenario, float(np.asarray(design.tau))), longest)


def _shortlists(
    objective: Objective,
    box: Box,
    periods: np.ndarray,
    longest: float,
    limit: float,
    effort: Effort,
    search: Sequence[int],
) -> list[Design]:
    """Finalists at each sampling period (s); without those periods at which no design keeps the limit on collisions.

    Raises:
        ValueError: None does at any.
    """
    found, failed = [], []
    for tau in periods.tolist():
        here = replace(box, baseline=replace(box.baseline, tau=tau))
        try:
            axis = _axis(objective.scenario, objective.network, here.baseline, longest)
            found.append(shortlist(objective, here, axis, limit, effort, search))
        except ValueError as error:
            failed.append(error)
    if not found:
        raise failed[0]
    return found


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
    if hasattr(values, "__dataclass_fields__"):
        return plain(asdict(values))
    if isinstance(values, (list, tuple)):
        return [plain(value) for value in values]
    if isinstance(values, (np.generic, np.ndarray)):
        values = values.item()
    if not isinstance(values, float):
        return values
    return float(f"{values:.6g}") if math.isfinite(values) else None
