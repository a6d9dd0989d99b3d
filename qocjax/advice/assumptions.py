"""What of a design is left where an assumption is wrong: when commands take effect, what a miss does, what computes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from qocjax.advice.shortlist import along_deadlines
from qocjax.network import Edge, Network, with_edge
from qocjax.network.edge_network import EdgeNetwork, Path
from qocjax.network.schedule import Rules
from qocjax.scenario import Design
from qocjax.search import stacked
from qocjax.search.objective import Objective
from qocjax.statistics.collisions import collision_share
from qocjax.statistics.estimates import Estimate
from qocjax.statistics.scores import Scored, Scores

__all__ = ["Otherwise", "assumption_table", "otherwise"]

_OTHER = {"deadline": "arrival", "arrival": "deadline", "instant": "arrival"}
_TAKE_EFFECT = {"arrival": "as they come, as Nav2 does", "deadline": "at stamp + deadline, held by a node at the robot",
                "instant": "at once"}  # fmt: skip
_MISSED = {"hold": "the last command stays in force", "zero": "robots stop until the next command",
           "timeout": "robots stop once a command is {:g} s old", "decay": "commands fade, in {:g} s"}  # fmt: skip


@dataclass(frozen=True)
class Otherwise:
    """The recommended design under the other actuation, on fresh seeds."""

    actuation: str
    here: Scored  # QoC as recommended
    collisions: Estimate  # share of runs
    best_deadline: float  # s, of the same gains
    gain: Scored  # of QoC, at that deadline over the recommended one


def otherwise(
    objective: Objective, design: Design, axis: np.ndarray, choice: Sequence[int], fresh: Sequence[int]
) -> Otherwise:
    """Simulates a design under the other actuation, and finds the deadline that its gains would want there.

    Args:
        objective: The setting.
        design: Numbers.
        axis: Deadlines to try (s).
        choice: Seeds on which the deadline is chosen.
        fresh: Seeds on which it is judged.
    """
    setting = replace(_other_actuation(objective), simulations=0)
    rules = setting.rules
    scores = setting.scores(along_deadlines(design, axis), choice)
    best = float(axis[int(scores.mean(axis=1).argmax())])
    runs = setting.runs(stacked([design, replace(design, deadline=best)]), fresh)
    judged = setting.judged(runs)
    objective.simulations += setting.simulations
    return Otherwise(
        rules.actuation, judged[0].mean(),
        collision_share(runs["collided"].values[0], objective.scenario.num_robots, judged.units), best,
        (judged[1] - judged[0]).mean(),
    )  # fmt: skip


def _other_actuation(objective: Objective) -> Objective:
    """The setting with the other actuation; a prediction of when commands take effect is of no use there."""
    rules, controller = objective.rules, objective.controller
    if getattr(controller, "predict", False):
        controller = replace(controller, predict=False)  # type: ignore[type-var]
    return replace(objective, rules=replace(rules, actuation=_OTHER[rules.actuation]), controller=controller)


def assumption_table(objective: Objective, design: Design, seeds: Sequence[int], limit: float) -> pd.DataFrame:
    """A design where one assumption at a time is wrong, paired with itself as assumed.

    Args:
        objective: The setting, as assumed.
        design: Numbers.
        seeds: [S] that nothing was chosen on.
        limit: Largest share of runs with a collision.

    Returns:
        Per assumption, the one that matters most first: what it is about, what is `assumed` and what is so `instead`,
        qoc and change with both 95 % intervals, and the share of runs with a collision with its own. It matters more
        if collisions then break their limit for sure, else by how much QoC changes.
    """

    def judged(setting: Objective) -> tuple[Scores, np.ndarray]:
        setting = replace(setting, simulations=0)
        runs = setting.runs(stacked([design]), seeds)
        objective.simulations += setting.simulations
        return setting.judged(runs)[0], runs["collided"].values[0]

    base, rows = judged(objective)[0], []
    for what, (assumed, instead, other) in _alternatives(objective).items():
        scores, collided = judged(other)
        close = collision_share(collided, objective.scenario.num_robots, scores.units, scores.values)
        line: dict[str, Any] = {"what": what, "assumed": assumed, "instead": instead}
        line |= scores.mean().columns("qoc") | (scores - base).mean().columns("change")
        rows.append(line | {"collision_share": close.mean, "collision_low": close.low, "collision_high": close.high})
    return pd.DataFrame(sorted(rows, key=lambda row: (row["collision_low"] <= limit, -abs(row["change"]))))


def _alternatives(objective: Objective) -> dict[str, tuple[str, str, Objective]]:
    """For each assumption what is assumed, what may be so instead, and the setting then."""
    rules, other = objective.rules, _other_actuation(objective)
    missed = replace(rules, hold="timeout" if rules.hold == "hold" else "hold")
    found = {
        "when commands take effect": (
            _TAKE_EFFECT[rules.actuation], _TAKE_EFFECT[other.rules.actuation], other
        ),
        "what a missed loop does": (_miss_text(rules), _miss_text(missed), replace(objective, rules=missed)),
    }  # fmt: skip
    if (edge := _other_edge(objective.network, objective.scenario.num_robots)) is not None:
        assumed, instead, network = edge
        found["what computes at the edge"] = (assumed, instead, replace(objective, network=network))
    return found


def _miss_text(rules: Rules) -> str:
    return _MISSED[rules.hold].format(rules.hold_timeout if rules.hold == "timeout" else rules.hold_decay)


def _other_edge(network: Network, robots: int) -> tuple[str, str, Network] | None:
    """An edge that robots share where each has workers of its own, else one without a limit, or one with."""
    if isinstance(network, EdgeNetwork):
        own = network.edge
        shared = own.per_robot and robots > 1
        other = replace(own, per_robot=False) if shared else Edge()
        return _edge_text(own), _edge_text(other), with_edge(network.path, other)
    if isinstance(network, Path):
        return _edge_text(Edge()), _edge_text(few := Edge(discipline="skip")), with_edge(network, few)
    return None


def _edge_text(edge: Edge) -> str:
    if not edge.finite:
        return "an idle worker for every sample"
    workers = f"{edge.workers} worker{'' if edge.workers == 1 else 's'}"
    return f"{workers} {'for each robot' if edge.per_robot else 'for all robots together'} ({edge.discipline})"
