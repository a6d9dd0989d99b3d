"""Some fleets of a study to watch, from a small one to the first that does not keep what is asked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from qocjax.fleets.point import BEST
from qocjax.report.replay import Replay
from qocjax.single import Run
from qocjax.study.problem import Problem
from qocjax.study.replays import policy_runs
from qocjax.study.study import Study

__all__ = ["REPLAYED", "fleet_replays"]

REPLAYED = (
    "Fleets at their best deadline with the gains as given, each on the seed whose AUC is the median. A floor that is "
    "higher than wide is shown lying."
)
_MOST = 64  # robots of a fleet that is replayed: more cannot be told apart


def fleet_replays(runs: Mapping[int, tuple[Study, Problem]], largest: int | None) -> list[Replay]:
    """A run of some fleets with the gains as given, at the best deadline; seeds whose AUC is the median.

    Args:
        runs: The study of each fleet and what it simulated.
        largest: Fleet that keeps what is asked; None where none does.
    """
    found = []
    for robots in _shown(list(runs), largest):
        study, problem = runs[robots]
        rows = study.policies[(study.policies["sweep"] == BEST) & (study.policies["policy"] == "Co-design")]
        for each in policy_runs(replace(study, policies=rows), problem):
            name = f"{robots} robot{'s' * (robots > 1)}"
            deadline, tau = (float(np.asarray(value)) for value in (each.design.deadline, each.design.tau))
            found.append(Replay(each.sweep, name, each.values, deadline, each.reliability, tau, _lying(each.run), name))
    return found


def _shown(fleets: Sequence[int], largest: int | None) -> list[int]:
    """Fleets to watch: a small one, one between, the largest that keeps what is asked, the first that does not."""
    some = [n for n in fleets if n <= _MOST]
    if not some:
        return []
    small = next((n for n in some if n >= 2), some[-1])
    last = max((n for n in some if n <= (largest or 0)), default=some[-1])
    between = min(some, key=lambda n: abs(np.log(n * n / (small * last))))
    following = [n for n in some if n > (largest or 0)][:1]
    return sorted({small, between, last, *following})


def _lying(run: Run) -> Run:
    """The run seen from the side where the floor is wider than high; screens are."""
    wide, high = np.ptp(np.concatenate([run.pose[0, :, :2], np.reshape(run.goal, (-1, 2))]), axis=0)
    if high <= wide:
        return run
    pose, reference, goal = (np.asarray(part, float) for part in (run.pose, run.reference, run.goal))
    turned = np.concatenate([_turned(pose[..., :2]), pose[..., 2:] - 0.5 * np.pi], axis=-1)
    return replace(run, pose=turned, reference=_turned(reference), goal=_turned(goal))  # type: ignore[arg-type]


def _turned(places: np.ndarray) -> np.ndarray:
    return np.stack([places[..., 1], -places[..., 0]], axis=-1)
