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
from qocjax.study.capacity import at_once_text
from qocjax.study.character import candidate_deadlines, characterise, quantiles
from qocjax.study.edges import at_bounds
from qocjax.study.margins import Bound, Margin, deadline_margin
from qocjax.study.objective import Objective, pilot_scale
from qocjax.study.policies import MIN_RELIABILITY
from qocjax.study.reliability import load_of
from qocjax.study.robust import OBJECTIVES, Chosen, choose
from qocjax.study.search import stacked
from qocjax.study.sensitivity import Box, elasticities, sobol
from qocjax.study.shortlist import NAMES, Effort, along_deadlines, shortlist
from qocjax.study.slack import Asked, Slack, find_slack
from qocjax.study.stress import largest_growth, of_runs, stress_table
from qocjax.study.units import seeds_apart, trace_remark

__all__ = ["ANSWERS", "VERDICTS", "Advice", "advise", "plain"]

VERDICTS = ("recommended", "not shown", "unsafe")
"""Of a design: it keeps the limit on collisions; fresh seeds do not show that it does; they show that it does not."""

ANSWERS = ("yes", "no: QoC", "no: collisions", "not shown")
"""Whether what one has may stay."""


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
        how: What is maximised, of `robust.OBJECTIVES`.
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
    load = load_of(scenario, float(np.asarray(current.tau)))
    box, axis = Box(current, bounds), candidate_deadlines(network, load, longest_deadline)
    counts = [effort.rounds[-1], effort.fresh_seeds, effort.fresh_seeds]
    search, choice, fresh = seeds_apart(network, key, counts, scenario.horizon, current.tau)
    fine = np.unique(np.concatenate([axis, np.geomspace(axis[0], longest_deadline, 12)]))
    pilot = [0.0, *fine.tolist()]  # from a deadline at which hardly a robot moves: the worst that can happen
    few = search[: effort.rounds[0]]
    scale = scale or pilot_scale(scenario, network, current, pilot, few, rules=rules, key=key)
    objective = Objective(scenario, network, scale, rules, key, simulations=len(pilot) * len(few))
    finalists = shortlist(objective, box, axis, max_collision_share, effort, search)
    found = choose(objective, finalists, current, list(bounds), max_collision_share, longest_deadline, choice, how)
    best, deadline = found.design, float(np.asarray(found.design.deadline))
    judged, ties = _judge(objective, found, current, fresh)
    part, some = fresh[: asked.seeds], fresh[: max(asked.seeds, len(fresh) // 4)]
    curve, margins = _curves(objective, best, current, fine, some, asked.share, max_collision_share)
    names = [name for name in (*bounds, "deadline") if float(np.asarray(getattr(best, name))) > 0]
    return Advice(
        network=network.describe(),
        character=characterise(network, load, deadline, key),
        trace=trace_remark(network, best.deadline, scenario.horizon, best.tau) or "",
        capacity=at_once_text(network, load, deadline),
        recommended=best,
        verdict=_verdict(found.safe, judged.iloc[-1], max_collision_share),
        objective=how,
        by_mean=found.by_mean,
        kept=found.kept,
        at_edge=at_bounds(
            asdict(best),
            {name: ends for name, ends in bounds.items() if name not in found.kept},
            {"deadline": axis.tolist()},
        ),
        current=current,
        acceptable=_answer(judged.iloc[0], margins[1], max_collision_share),
        max_collision_share=max_collision_share,
        policy=_policy(float(np.asarray(current.deadline)), margins[1]),
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


def _verdict(safe: bool, row: pd.Series, limit: float) -> str:
    """Whether a choice that kept the limit keeps it on fresh seeds, even at the upper end of its collision share."""
    if safe and row["collision_high"] <= limit:
        return "recommended"
    return "unsafe" if row["collision_low"] > limit else "not shown"


def _answer(row: pd.Series, margin: Margin, limit: float) -> str:
    """Whether the current design may stay: within its margin of QoC, and within the limit on collisions."""
    if row["collision_low"] > limit:
        return "no: collisions"
    if _policy(float(row["deadline"]), margin) != "Co-design":
        return "no: QoC"
    return "yes" if row["collision_high"] <= limit else "not shown"


def _judge(
    objective: Objective, found: Chosen, current: Design, seeds: Sequence[int]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The table of what is compared, and the designs tied with the recommended, on fresh seeds."""
    middle = replace(current, deadline=found.design.deadline)
    designs = stacked([current, middle, found.by_mean, found.design, found.others])
    runs = objective.runs(designs, seeds)
    scores = objective.judged(runs)
    named = ("current", "current gains, recommended deadline", "best by the mean alone", "recommended")
    table = []
    for k, what in enumerate(named):
        at, tau = (float(np.asarray(values)[k]) for values in (designs.deadline, designs.tau))
        share, error = objective.reliability(at, tau)
        line = {"what": what, "deadline": at, "reliability": float(share), "reliability_se": float(error)}
        gain, cost = (scores[k] - scores[0]).mean(), (scores[k] - scores[3]).mean()
        line |= scores[k].mean().columns("qoc") | gain.columns("gain") | cost.columns("beyond")
        table.append(line | of_runs(runs, k, scores))
    tied = []
    for k in range(len(named) - 1, len(scores.values)):
        gap = (scores[k] - scores[3]).mean()
        if gap.given.high >= 0.0:
            values = {name: float(np.asarray(getattr(designs, name))[k]) for name in NAMES}
            tied.append(values | {"qoc": float(scores[k].values.mean())} | gap.columns("difference"))
    return pd.DataFrame(table), pd.DataFrame(tied).drop_duplicates(NAMES, ignore_index=True)


def _curves(
    objective: Objective,
    best: Design,
    current: Design,
    axis: np.ndarray,
    seeds: Sequence[int],
    share: float,
    limit: float,
) -> tuple[pd.DataFrame, tuple[Margin, Margin]]:
    """QoC and collisions over the deadline for both gains, and the margin of each: within it both are kept."""
    axis = np.union1d(axis, [float(np.asarray(best.deadline))])
    designs = stacked([along_deadlines(best, axis), along_deadlines(current, axis)])
    runs = objective.runs(designs, seeds)
    scores, close = objective.judged(runs), runs["collided"].values.mean(axis=1)
    rows = {"recommended": slice(0, axis.size), "current": slice(axis.size, None)}
    known = objective.reliability(axis, best.tau)
    table: dict[str, Any] = {"deadline": axis, "reliability": known.share, "reliability_se": known.error}
    margins = []
    for name, which in rows.items():
        found = [one.mean().given for one in (scores[which][k] for k in range(axis.size))]
        table |= {f"qoc_{name}": [e.mean for e in found], f"qoc_{name}_low": [e.low for e in found],
                  f"qoc_{name}_high": [e.high for e in found], f"collision_{name}": close[which]}  # fmt: skip
        allowed = np.where(close[which, None] <= max(limit, close[which].min()), scores.values[which], 0.0)
        margins.append(deadline_margin(axis, allowed, share, scores.units))
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
