"""The tables of an advice: the designs that are compared, and QoC and collisions over the deadline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from qocjax.advice.margins import Margin, deadline_margin
from qocjax.advice.robust import Chosen
from qocjax.advice.shortlist import along_deadlines
from qocjax.advice.stress import of_runs
from qocjax.advice.target import Target, collision_excess
from qocjax.scenario import Design
from qocjax.search import stacked
from qocjax.search.objective import Objective
from qocjax.statistics.collisions import collision_share

__all__ = ["curves_of", "judged_of"]

_NEAR = 0.95  # of the best QoC


def judged_of(
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
            values = {name: float(np.asarray(value)[k]) for name, value in designs.values().items()}
            tied.append(values | {"qoc": float(scores[k].values.mean())} | gap.columns("difference"))
    return pd.DataFrame(table), pd.DataFrame(tied).drop_duplicates(list(designs.names), ignore_index=True)


def curves_of(
    objective: Objective,
    best: Design,
    current: Design,
    axis: np.ndarray,
    seeds: Sequence[int],
    target: Target,
    limit: float,
) -> tuple[pd.DataFrame, tuple[Margin, Margin]]:
    """QoC and collisions over the deadline for both gains, and the margin of each.

    Within a margin the target is kept, and the limit on collisions by the upper end of their share. Where no deadline
    shows that, those that collide the least are taken; where even these do so too often, all are.
    """
    axis = np.union1d(axis, [float(np.asarray(best.deadline))])
    designs = stacked([along_deadlines(best, axis), along_deadlines(current, axis)])
    runs = objective.runs(designs, seeds)
    scores, collided, robots = objective.judged(runs), runs["collided"].values, objective.scenario.num_robots
    merits = target.merits(runs, scores)
    rows = {"recommended": slice(0, axis.size), "current": slice(axis.size, None)}
    known = objective.reliability(axis, best.tau)
    table: dict[str, Any] = {"deadline": axis, "reliability": known.share, "reliability_se": known.error}
    margins = []
    for name, which in rows.items():
        found = [one.mean().given for one in (scores[which][k] for k in range(axis.size))]
        table |= {f"qoc_{name}": [e.mean for e in found], f"qoc_{name}_low": [e.low for e in found],
                  f"qoc_{name}_high": [e.high for e in found]}  # fmt: skip
        # What is usual where it works: elsewhere stretches of a trace differ more.
        qoc = scores.values[which]
        usual = qoc[qoc.mean(axis=1) >= _NEAR * qoc.mean(axis=1).max()].mean(axis=0)
        close = [collision_share(hits, robots, scores.units, usual) for hits in collided[which]]
        table |= {f"collision_{name}": [e.mean for e in close], f"collision_{name}_low": [e.low for e in close],
                  f"collision_{name}_high": [e.high for e in close]}  # fmt: skip
        safety = "kept" if min(each.high for each in close) <= limit else "not shown"
        excess = collision_excess(close, limit)
        if min(each.low for each in close) > limit:
            safety, excess = "broken", np.zeros(axis.size)
        margins.append(replace(deadline_margin(axis, merits[which], target, scores.units, excess), safety=safety))
    return pd.DataFrame(table), (margins[0], margins[1])
