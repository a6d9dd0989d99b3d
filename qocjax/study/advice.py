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
from qocjax.study.capacity import at_once_text
from qocjax.study.character import candidate_deadlines, characterise, quantiles
from qocjax.study.edges import at_bounds
from qocjax.study.margins import Bound, Margin, deadline_margin
from qocjax.study.objective import Objective, pilot_scale
from qocjax.study.policies import MIN_RELIABILITY
from qocjax.study.reliability import load_of
from qocjax.study.search import stacked
from qocjax.study.sensitivity import Box, elasticities, sobol
from qocjax.study.shortlist import NAMES, Effort, along_deadlines, row, shortlist
from qocjax.study.slack import Asked, Slack, find_slack
from qocjax.study.stress import largest_growth, of_runs, stress_table
from qocjax.study.units import trace_remark

__all__ = ["Advice", "advise", "plain"]


@dataclass(frozen=True)
class Advice:
    """What is advised, and what it rests on."""

    network: dict[str, Any]  # what the network is
    character: dict[str, Any]  # how it behaves at the recommended deadline
    trace: str  # what a measured trace is too short to say; empty where nothing is
    capacity: str  # how many computations at once it takes, in a line
    recommended: Design
    at_edge: str  # which bounds of the search it lies at
    current: Design  # what it is compared with
    max_collision_share: float  # the limit that it was chosen under
    policy: str  # which of the three the current deadline amounts to
    judged: pd.DataFrame  # current, current gains at the recommended deadline, recommended: on fresh seeds
    stress: pd.DataFrame  # recommended on networks that became worse
    ties: pd.DataFrame  # finalists that are not worse than the recommended, as far as the fresh seeds can tell
    margin: Margin  # of the recommended gains
    current_margin: Margin  # of the current gains
    curve: pd.DataFrame  # QoC and F over the deadline, for both gains
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
    effort: Effort | None = None,
    scale: QocScale | None = None,
    asked: Asked | None = None,
) -> Advice:
    """Recommends deadline and gains for a network, and says what they gain over the current ones.

    Args:
        scenario: Robots and yardstick.
        network: Where loop times come from.
        current: Numbers; its tau stays, its deadline is what one uses now.
        bounds: Parameters that may change, with their bounds.
        rules: Actuation and hold.
        key: Root of all random numbers.
        longest_deadline: Longest deadline to consider (s).
        max_collision_share: Largest share of runs in which robots may come closer than two radii.
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
    load = load_of(scenario, float(np.asarray(current.tau)))
    box, axis = Box(current, bounds), candidate_deadlines(network, load, longest_deadline)
    fine = np.unique(np.concatenate([axis, np.geomspace(axis[0], longest_deadline, 12)]))
    pilot = [0.0, *fine.tolist()]  # from a deadline at which hardly a robot moves: the worst that can happen
    scale = scale or pilot_scale(scenario, network, current, pilot, range(effort.rounds[0]), rules=rules, key=key)
    objective = Objective(scenario, network, scale, rules, key, simulations=len(pilot) * effort.rounds[0])
    finalists = shortlist(objective, box, axis, max_collision_share, effort)
    fresh = range(effort.rounds[-1], effort.rounds[-1] + effort.fresh_seeds)
    best = row(finalists, 0)
    judged, ties = _judge(objective, finalists, current, fresh)
    few, some = fresh[: asked.seeds], fresh[: max(asked.seeds, len(fresh) // 4)]
    curve, margins = _curves(objective, best, current, fine, some, asked.share)
    names = [name for name in (*bounds, "deadline") if float(np.asarray(getattr(best, name))) > 0]
    return Advice(
        network=network.describe(),
        character=characterise(network, load, float(np.asarray(best.deadline)), key),
        trace=trace_remark(network, best.deadline) or "",
        capacity=at_once_text(network, load, float(np.asarray(best.deadline))),
        recommended=best,
        at_edge=at_bounds(asdict(best), bounds, {"deadline": axis.tolist()}),
        current=current,
        max_collision_share=max_collision_share,
        policy=_policy(float(np.asarray(current.deadline)), margins[1]),
        judged=judged,
        stress=stress_table(objective, best, fresh),
        ties=ties,
        margin=margins[0],
        current_margin=margins[1],
        curve=curve,
        growth=largest_growth(objective, best, fresh, asked.share),
        elasticities=elasticities(objective, best, fresh, names),
        sobol=sobol(objective, box, axis.tolist(), few, asked.points, abs(key)) if asked.points else None,
        policies=_policies(network, load, best, longest_deadline),
        slack=find_slack(objective, best, longest_deadline, few, asked) if asked.delays else None,
        scale=scale,
        seeds={"search": effort.rounds[-1], "fresh": len(fresh), "first_fresh": fresh[0]},
        simulations=objective.simulations,
    )


def _judge(
    objective: Objective, finalists: Design, current: Design, seeds: Sequence[int]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The table of the three, and the finalists tied with the recommended, on fresh seeds."""
    middle = replace(current, deadline=float(np.asarray(finalists.deadline)[0]))
    designs = stacked([finalists, middle, current])
    runs = objective.runs(designs, seeds)
    scores = objective.judged(runs)
    count = len(scores.values) - 2
    named = (("current", count + 1), ("current gains, recommended deadline", count), ("recommended", 0))
    table = []
    for what, k in named:
        at, tau = (float(np.asarray(values)[k]) for values in (designs.deadline, designs.tau))
        share, error = objective.reliability(at, tau)
        found = {"what": what, "deadline": at, "reliability": float(share), "reliability_se": float(error)}
        gain = (scores[k] - scores[count + 1]).mean()
        table.append(found | scores[k].mean().columns("qoc") | gain.columns("gain") | of_runs(runs, k, scores.units))
    tied = []
    for k in range(count):
        gap = (scores[k] - scores[0]).mean()
        if gap.given.high >= 0.0:
            values = {name: float(np.asarray(getattr(designs, name))[k]) for name in NAMES}
            tied.append(values | {"qoc": float(scores[k].values.mean())} | gap.columns("difference"))
    return pd.DataFrame(table), pd.DataFrame(tied)


def _curves(
    objective: Objective, best: Design, current: Design, axis: np.ndarray, seeds: Sequence[int], share: float
) -> tuple[pd.DataFrame, tuple[Margin, Margin]]:
    """QoC over the deadline for both gains, and the margin of each."""
    axis = np.union1d(axis, [float(np.asarray(best.deadline))])
    designs = stacked([along_deadlines(best, axis), along_deadlines(current, axis)])
    scores = objective.judged(objective.runs(designs, seeds))
    parts = {"recommended": scores[: axis.size], "current": scores[axis.size :]}
    known = objective.reliability(axis, best.tau)
    table: dict[str, Any] = {"deadline": axis, "reliability": known.share, "reliability_se": known.error}
    for name, part in parts.items():
        found = [part[k].mean().given for k in range(axis.size)]
        table |= {f"qoc_{name}": [e.mean for e in found], f"qoc_{name}_low": [e.low for e in found],
                  f"qoc_{name}_high": [e.high for e in found]}  # fmt: skip
    margins = [deadline_margin(axis, part.values, share, scores.units) for part in parts.values()]
    return pd.DataFrame(table), (margins[0], margins[1])


def _policy(deadline: float, margin: Margin) -> str:
    """Which policy a deadline amounts to: within the margin of its gains Co-design, before MinDelay, after MaxRel."""
    low, high = (bound.value if bound.value is not None else margin.best for bound in (margin.low, margin.high))
    if deadline < low * (1 - 1e-9):
        return "MinDelay"
    return "MaxRel" if deadline > high * (1 + 1e-9) else "Co-design"


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
