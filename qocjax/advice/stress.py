"""A network that becomes worse, and what is left of a design on it (model, section 4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from qocjax.advice.character import lost_share
from qocjax.advice.reaching import Bound, reach
from qocjax.advice.target import Target
from qocjax.advice.trace_parts import WORST_PART, worst_part
from qocjax.network import Network, Reliability
from qocjax.network.edge_network import EdgeNetwork
from qocjax.network.stressed import Stressed, with_lost_twice, with_slow_compute
from qocjax.scenario import Design
from qocjax.search import stacked
from qocjax.search.objective import Objective
from qocjax.statistics.collisions import collision_share
from qocjax.statistics.estimates import estimate
from qocjax.statistics.scores import Scored, Scores
from qocjax.study.reliability import load_of, reliability_of

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["GROWTHS", "largest_growth", "of_runs", "on_network", "stress_table", "worse"]

GROWTHS = (1.0, 1.05, 1.15, 1.3, 1.5, 2.0, 3.0)  # of all loop times, the deadline kept


def of_runs(runs: xr.Dataset, k: int, scores: Scores) -> dict[str, float]:
    """What else is said of the k-th design of some runs, with 95 % intervals; `scores` are those of all designs."""
    units, usual = scores.units, scores.values[k]
    auc = runs["auc"].values[k].astype(float)
    costs = np.where(np.isfinite(auc), auc, np.nanmax(runs["auc"].values)).mean(axis=-1)
    cost = estimate(costs, units=units)
    collided = collision_share(runs["collided"].values[k], runs.sizes["robot"], units, usual)
    last = runs["arrival_time"].values[k].max(axis=-1)
    return {
        "auc": cost.mean, "auc_low": cost.low, "auc_high": cost.high,
        "collision_share": collided.mean, "collision_low": collided.low, "collision_high": collided.high,
        "min_distance": float(runs["min_distance"].values[k].min()),
        "arrived_share": float(np.isfinite(last).mean()),
        "arrival_time": float(last[np.isfinite(last)].mean()) if np.isfinite(last).any() else np.inf,
        "completed_share": float(runs["completed_share"].values[k].mean()),
        "age_peak_p99": float(np.quantile(runs["age_peak"].values[k], 0.99)),
    }  # fmt: skip


def worse(objective: Objective, tau: float) -> dict[str, Network]:
    """The network after each of the changes that advice has to stand up to, by its name; deadlines stay.

    Args:
        objective: The setting.
        tau: Sampling period (s).
    """
    network = objective.network
    found: dict[str, Network] = {
        f"all loop times x {factor:g}": Stressed(network, delay_factor=factor) for factor in (1.25, 1.5)
    }
    # What a busy edge drops is not lost on the way.
    path = network.path if isinstance(network, EdgeNetwork) else network
    dropping = getattr(getattr(path, "edge", None), "finite", False)
    if not dropping and lost_share(path, load_of(objective.scenario, tau)) > 0:
        found["lost loops x 2"] = with_lost_twice(network)
    found["bursts twice as long"] = Stressed(network, hang=2)
    if (slower := with_slow_compute(network, 1.5)) is not None:
        found["computing x 1.5"] = slower
    return found


def stress_table(
    objective: Objective,
    design: Design,
    others: Mapping[str, Design],
    seeds: Sequence[int],
    target: Target | None = None,
    limit: float = 1.0,
) -> pd.DataFrame:
    """A design on worse networks, paired with itself on the network as it is, the first row; beside it others.

    The second row is the worst part of a trace, where one is long enough (`worst_part`).

    Args:
        objective: The setting.
        design: Numbers.
        others: Numbers, by name; what it is compared with where all keep their deadlines.
        seeds: [S] at least two.
        target: What has to be kept; a share of the best is one of the QoC on the network as it is.
        limit: Largest share of runs with a collision, kept by the upper end of its interval.

    Returns:
        Per case: what, deadline (s), reliability with its standard error, qoc and change with both 95 % intervals
        (`_whole_` with the error of J_med in it), what `of_runs` says, and with their names before it QoC and
        collision share of the others, NaN where the case is none of theirs; `stands`, whether target and limit are
        kept: yes, no, or not shown, where the limit lies within the interval of the collision share.
    """
    network, deadline = objective.network, float(np.asarray(design.deadline))
    longer = replace(design, deadline=1.5 * deadline)
    changed, likely = worse(objective, float(np.asarray(design.tau))), objective.reliability(deadline, design.tau).share
    cases: list[tuple[str, Network, Design]] = [
        ("as it is", network, design),
        *((what, other, design) for what, other in changed.items()),
        *([("missed loops x 2", Stressed(network, miss_deadline=deadline), design)] if likely >= 0.5 else []),
        ("as it is, deadline x 1.5", network, longer),
        ("all loop times x 1.5, deadline x 1.5", changed["all loop times x 1.5"], longer),
    ]
    table: list[dict[str, Any]] = []
    base: Scores | None = None
    target, merits = target or Target(), []
    for what, other, chosen in cases:
        runs, scores = on_network(objective, other, stacked([chosen, *others.values()]), seeds)
        base = scores[0] if base is None else base
        merits.append(float(target.merits(runs, scores)[0].mean()))
        known = reliability_of(other, objective.scenario, chosen.deadline, chosen.tau)
        beside = others if what == "as it is" or what in changed else dict.fromkeys(others)
        table.append(_case(what, chosen, known, (scores[0] - base).mean(), runs, scores, beside))
        if what == "as it is" and (part := worst_part(objective, scores, stacked([chosen, *others.values()]))):
            table.append(_case(WORST_PART, chosen, part.reliability, part.change, part.runs, part.scores, others))
            merits.append(float(target.merits(part.runs, part.scores)[0].mean()))
    rows = pd.DataFrame(table)
    lost = (np.array(merits) < target.level(merits[0])) | (rows["collision_low"] > limit)
    rows["stands"] = np.where(lost, "no", np.where(rows["collision_high"] <= limit, "yes", "not shown"))
    return rows


def _case(
    what: str,
    chosen: Design,
    known: Reliability,
    change: Scored,
    runs: xr.Dataset,
    scores: Scores,
    others: Mapping[str, Design | None],
) -> dict[str, Any]:
    """A row of the table, of runs of a design and of others; of those that are None nothing is said."""
    line: dict[str, Any] = {"what": what, "deadline": float(np.asarray(chosen.deadline))}
    line |= {"reliability": float(known.share), "reliability_se": float(known.error)}
    line |= scores[0].mean().columns("qoc") | change.columns("change") | of_runs(runs, 0, scores)
    for k, (name, design) in enumerate(others.items(), start=1):
        line[f"{name}_qoc"] = np.nan if design is None else float(scores.values[k].mean())
        line[f"{name}_collision_share"] = np.nan if design is None else float(runs["collided"].values[k].mean())
    return line


def largest_growth(objective: Objective, design: Design, seeds: Sequence[int], target: Target) -> Bound:
    """By what factor all loop times may grow, the deadline kept, until a target is missed.

    Args:
        objective: The setting.
        design: Numbers.
        seeds: [S] at least two, common to all factors.
        target: A share of the best is one of the QoC on the network as it is.
    """
    network = objective.network
    slower: list[Network] = [network if growth == 1.0 else Stressed(network, growth) for growth in GROWTHS]
    merits = np.stack([
        target.merits(*on_network(objective, other, stacked([design]), seeds))[0] for other in slower
    ])  # fmt: skip
    # Robots that get no command any more stand, far apart: what is lost on the way counts.
    return reach(GROWTHS, target.beyond(merits, merits[0]), 0.0, objective.units(seeds, design.tau), contiguous=True)


def on_network(
    objective: Objective, network: Network, designs: Design, seeds: Sequence[int]
) -> tuple[xr.Dataset, Scores]:
    """Runs and scores [G, S] of designs on another network; the simulations count for the objective."""
    setting = replace(objective, network=network, simulations=0)
    runs = setting.runs(designs, seeds)
    objective.simulations += setting.simulations
    return runs, setting.judged(runs)
