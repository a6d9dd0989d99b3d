"""How far delay or reliability may go, each by itself, and which parameters matter over the whole box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from qocjax import _checks
from qocjax.advice.plane import delay_reliability_plane, largest_delay, smallest_reliability
from qocjax.advice.reaching import Bound
from qocjax.advice.target import Target, usual_target
from qocjax.scenario import Design
from qocjax.search.objective import Objective

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Asked", "Slack", "find_slack"]

_SHARES = (0.01, 0.03, 0.1, 0.3, 0.6, 1.0)  # reliabilities of the plane, beside the one that is asked for
_SHORTEST = 0.01  # s, delays of the plane begin here, or at half of what is looked at, so that no cliff is hidden


@dataclass(frozen=True)
class Asked:
    """Which margins are asked for, and how much is simulated for them.

    Attributes:
        target: What the margins keep; None for the usual.
        reliability: At which the largest delay is asked for; None takes F at the design's deadline.
        delay: At which the smallest reliability is asked for (s); None takes the design's deadline.
        delays: Delays of the plane; 0 leaves plane and inverse questions out.
        plane_seeds: Of the plane; 368 without a collision show 1 %.
        seeds: Of the Sobol indices.
        points: Of the Sobol indices, a power of two; 0 leaves them out.
    """

    target: Target | None = None
    reliability: float | None = None
    delay: float | None = None
    delays: int = 10
    plane_seeds: int = 384
    seeds: int = 16
    points: int = 128

    def __post_init__(self) -> None:
        if self.reliability is not None:
            _checks.bounded("margins.reliability", self.reliability, above=0, most=1)
        if self.delay is not None:
            _checks.bounded("margins.delay", self.delay, least=0)
        for name in ("seeds", "plane_seeds"):
            _checks.count(f"margins.{name}", getattr(self, name), least=2)
        if self.delays and _checks.count("margins.delays", self.delays, least=0) < 3:
            raise ValueError(f"margins.delays: got {self.delays}, expected at least 3, or 0 for no plane")
        size = _checks.count("margins.points", self.points, least=0)
        if size & (size - 1):
            raise ValueError(f"margins.points: got {size}, expected a power of two, or 0 for no Sobol indices")


@dataclass(frozen=True)
class Slack:
    """How far delay or reliability may go, each by itself, before a target or safety is lost; losses independent."""

    delay: float  # s, at which the reliability is asked for
    reliability: float  # at which the delay is asked for
    target: Target
    level: float  # of the mean merit, that is to be reached
    reached: bool  # whether it is anywhere on the plane, with collisions in their limit
    largest_delay: Bound  # s, at this reliability
    smallest_reliability: Bound  # at this delay
    plane: pd.DataFrame


def find_slack(
    objective: Objective, design: Design, longest: float, seeds: Sequence[int], asked: Asked, limit: float = 1.0
) -> Slack:
    """Answers the inverse questions from the plane of QoC over delay and reliability.

    A share of the best is one of the QoC that the design has on the plane at its own deadline and F.

    Args:
        objective: The setting.
        design: Numbers; its gains, and where delay or reliability are not asked for its deadline.
        longest: Longest delay of the plane (s).
        seeds: [S] at least two.
        asked: What is asked for.
        limit: Largest share of runs with a collision, kept by the upper end of its interval.

    Raises:
        ValueError: A delay beyond the longest.
    """
    deadline, target = (
        float(np.asarray(design.deadline)),
        asked.target or usual_target(objective.scenario, objective.scale),
    )
    here = float(objective.reliability(deadline, design.tau).share)
    delay = deadline if asked.delay is None else asked.delay
    _checks.bounded("margins.delay", delay, most=longest)
    share = here if asked.reliability is None else asked.reliability
    delays = np.geomspace(min(max(0.5 * min(delay, deadline), 1e-3), _SHORTEST), longest, asked.delays)
    shares = [min(_SHARES[0], share, here), *_SHARES[1:]]
    plane = delay_reliability_plane(
        objective, design, _with(delays, delay, deadline), _with(shares, share, here), seeds, target
    )
    own = plane.merits[_nearest(plane.reliability, here), _nearest(plane.delay, deadline)]
    # A share of what the plane gives is estimated too: what its seeds owe to chance goes off all cells.
    told = replace(plane, merits=target.beyond(plane.merits, own))
    reached = (told.merits.mean(axis=-1) >= 0.0) & (plane.excess(limit) <= 0.0)
    return Slack(
        delay, share, target, target.level(float(own.mean())), bool(reached.any()),
        largest_delay(told, 0.0, share, limit), smallest_reliability(told, 0.0, delay, limit), plane.to_table(),
    )  # fmt: skip


def _with(values: Sequence[float] | np.ndarray, *wanted: float) -> list[float]:
    """Ascending values that hold the wanted ones exactly, without others next to them."""
    near = [value for value in values if all(abs(value - own) > 0.02 * own for own in wanted)]
    return np.unique([*near, *wanted]).tolist()


def _nearest(axis: np.ndarray, value: float) -> int:
    return int(np.argmin(np.abs(axis - value)))
