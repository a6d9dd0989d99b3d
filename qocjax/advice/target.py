"""What a margin keeps, in units that one knows: a share of the best QoC, AUC, time to the goal, distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from qocjax import _checks
from qocjax.advice.little import Little, little_of
from qocjax.quality import QocScale
from qocjax.scenario import Scenario
from qocjax.statistics.estimates import Estimate
from qocjax.statistics.scores import Scores

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["KINDS", "Target", "collision_excess", "usual_target"]

KINDS = ("share_of_best", "auc_s", "time_to_goal_s", "closest_m")
_RUNS = 0.95  # of the runs keep a time or a distance


@dataclass(frozen=True)
class Target:
    """What is to be kept.

    Attributes:
        kind: Of `KINDS`. `share_of_best` is of the mean QoC that the same gains reach at their best deadline; `auc_s`
            the largest mean AUC (s); `time_to_goal_s` the latest time (s) at which all robots are there, and
            `closest_m` the smallest distance (m) of two robots, each in 95 % of the runs.
        value: The number.
        little: AUC beyond that of the best which does not matter; then also less than the share of the best is enough.
    """

    kind: str = "share_of_best"
    value: float = 0.95
    little: Little | None = None

    def __post_init__(self) -> None:
        _checks.choice("margins.target", self.kind, KINDS)
        most = 1.0 if self.kind == "share_of_best" else None
        _checks.bounded(f"margins.target.{self.kind}", self.value, above=0, most=most, shape=())

    @property
    def absolute(self) -> bool:
        """Whether it hangs on nothing that is estimated."""
        return self.kind != "share_of_best"

    def check(self, scenario: Scenario) -> None:
        """Raises a ValueError where runs of a scenario cannot tell."""
        if self.kind == "time_to_goal_s" and self.value > scenario.horizon:
            raise ValueError(f"margins.target.time_to_goal_s: got {self.value:g}, expected at most the "
                             f"{scenario.horizon:g} s of a run (scenario.horizon)")  # fmt: skip
        if self.kind == "closest_m" and scenario.num_robots < 2:
            raise ValueError("margins.target.closest_m: got it for one robot, expected two robots or more")

    def merits(self, runs: xr.Dataset, scores: Scores) -> np.ndarray:
        """What is averaged over the seeds of each design, [G, S]; the larger the better."""
        if self.kind == "share_of_best":
            return scores.values
        if self.kind == "auc_s":
            auc = runs["auc"].values.astype(float)
            return -np.where(np.isfinite(auc), auc, np.nanmax(np.where(np.isfinite(auc), auc, 0.0))).mean(axis=-1)
        if self.kind == "time_to_goal_s":
            return (runs["arrival_time"].values.max(axis=-1) <= self.value).astype(float)
        return (runs["min_distance"].values >= self.value).astype(float)

    def level(self, best: float) -> float:
        """What mean merits must reach, where the best is so good."""
        if self.kind == "share_of_best":
            return self.share(best) * best
        return -self.value if self.kind == "auc_s" else _RUNS

    def share(self, best: float) -> float:
        """Share of a best QoC that is asked for: the value, or what is left of it where it is little that is lost."""
        return self.value if self.little is None else min(self.value, self.little.share(best))

    def beyond(self, merits: np.ndarray, own: np.ndarray) -> np.ndarray:
        """By how much merits [..., S] pass what they must reach, where `own` [S] are the best; seed by seed."""
        return merits - (self.level(0.0) if self.absolute else self.share(float(own.mean())) * own)

    @property
    def text(self) -> str:
        """As a clause: what is to be so."""
        return self.than("its best")

    def than(self, best: str) -> str:
        """As a clause: what is to be so, where the best is what it says."""
        more = "" if self.little is None else f" or AUC at most {self.little.auc:.2g} s more"
        return {
            "share_of_best": f"QoC is at least {self.value:.4g} of {best}{more}",
            "auc_s": f"AUC is at most {self.value:g} s in the mean",
            "time_to_goal_s": f"all robots are there within {self.value:g} s in {_RUNS:.0%} of the runs",
            "closest_m": f"robots stay {self.value:g} m apart in {_RUNS:.0%} of the runs",
        }[self.kind]

    @property
    def lost(self) -> str:
        """As a clause: what happens where it is no longer so."""
        rest = f"in more than {1.0 - _RUNS:.0%} of the runs"
        more = "" if self.little is None else f" and AUC grows by {self.little.auc:.2g} s"
        return {
            "share_of_best": f"QoC falls by {1.0 - self.value:.0%}{more}",
            "auc_s": f"AUC passes {self.value:g} s in the mean",
            "time_to_goal_s": f"robots are not there within {self.value:g} s {rest}",
            "closest_m": f"robots come closer than {self.value:g} m {rest}",
        }[self.kind]

    def reading(self, merit: Estimate) -> str:
        """A mean merit with its interval, in words."""
        if self.kind == "auc_s":
            return f"an AUC of {-merit.mean:.3g} [{-merit.high:.3g}, {-merit.low:.3g}] s"
        if self.kind == "share_of_best":
            return f"a QoC of {merit.mean:.4f} [{merit.low:.4f}, {merit.high:.4f}]"
        low, high = max(merit.low, 0.0), min(merit.high, 1.0)
        return f"{merit.mean:.1%} [{low:.1%}, {high:.1%}] of the runs"


def usual_target(scenario: Scenario, scale: QocScale) -> Target:
    """The target where none is asked for; it knows what is little only where that can count."""
    plain, little = Target(), little_of(scenario, scale)
    return replace(plain, little=little) if little.share(1.0) < plain.value else plain


def collision_excess(shares: Sequence[Estimate], limit: float) -> np.ndarray:
    """By how much the upper end of each share of runs with a collision passes its limit, [G]; 0 or less if it keeps it.

    Where none is shown to keep it, the lower end: those count that are not shown to break it.
    """
    kept = min(each.high for each in shares) <= limit
    return np.array([each.high if kept else each.low for each in shares]) - limit
