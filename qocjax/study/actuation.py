"""What of a design is left where commands take effect otherwise than assumed: at stamp + deadline, or as they come."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from qocjax.scenario import Design
from qocjax.study.objective import Objective
from qocjax.study.scores import Scored
from qocjax.study.search import stacked
from qocjax.study.shortlist import along_deadlines
from qocjax.study.statistics import Estimate, share

__all__ = ["Otherwise", "otherwise"]

_OTHER = {"deadline": "arrival", "arrival": "deadline", "instant": "arrival"}


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
    rules = replace(objective.rules, actuation=_OTHER[objective.rules.actuation])
    setting = replace(objective, rules=rules, simulations=0)
    scores = setting.scores(along_deadlines(design, axis), choice)
    best = float(axis[int(scores.mean(axis=1).argmax())])
    runs = setting.runs(stacked([design, replace(design, deadline=best)]), fresh)
    judged = setting.judged(runs)
    objective.simulations += setting.simulations
    return Otherwise(
        rules.actuation, judged[0].mean(), share(runs["collided"].values[0], judged.units), best,
        (judged[1] - judged[0]).mean(),
    )  # fmt: skip
