"""What is asked of a design besides its score, and by how much a design breaks it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from qocjax import _checks
from qocjax.network.demand import Demand
from qocjax.network.interface import Reliability
from qocjax.scenario import Design
from qocjax.search.space import Space

__all__ = ["DEMANDS", "Limits"]

Completing = Callable[[ArrayLike, ArrayLike], Reliability]
"""F of deadlines and sampling periods (s)."""


@dataclass(frozen=True)
class Limits:
    """Limits on a design; None asks nothing.

    Attributes:
        collision_share: Largest share of runs in which two robots come closer than two radii.
        reliability: Smallest loop-completion probability F(Delta).
        loops_per_s: Largest message rate, all robots together (1/s).
        uplink_kbit_s: Largest uplink throughput.
        downlink_kbit_s: Largest downlink throughput.
        uplink_blocks: Most resource blocks that the uplink takes, in the mean over time.
        downlink_blocks: Most that the downlink takes.
        carrier_share: Largest share of the carrier's resource blocks.
        workers: Most workers of the edge that are busy, in the mean over time, all robots together.
    """

    collision_share: float | None = None
    reliability: float | None = None
    loops_per_s: float | None = None
    uplink_kbit_s: float | None = None
    downlink_kbit_s: float | None = None
    uplink_blocks: float | None = None
    downlink_blocks: float | None = None
    carrier_share: float | None = None
    workers: float | None = None

    def __post_init__(self) -> None:
        for name in ("collision_share", "reliability"):
            if getattr(self, name) is not None:
                _checks.bounded(name, getattr(self, name), least=0, most=1, shape=())
        for name in DEMANDS:
            if getattr(self, name) is not None:
                _checks.bounded(name, getattr(self, name), above=0, shape=())

    def of_network(self, designs: Design, reliability: Completing, demand: Demand) -> np.ndarray:
        """By how much designs break what is known of the network alone, [G]: relative excess, summed; 0 if kept."""
        excess = np.zeros(np.shape(designs.deadline))
        if self.reliability is not None:
            excess = excess + np.maximum(self.reliability - reliability(designs.deadline, designs.tau).share, 0.0)
        for name in DEMANDS:
            if (limit := getattr(self, name)) is not None:
                excess = excess + np.maximum(getattr(demand, name) / limit - 1.0, 0.0)
        return excess

    def of_runs(self, collided: np.ndarray, *, cautious: bool = False) -> np.ndarray:
        """By how much the collision share of runs [..., S] breaks its limit, [...].

        Args:
            collided: Which runs collided.
            cautious: Count the upper end of the share's one-sigma Wilson interval once a run has collided, so that a
                design at the limit is not taken for one within it by luck.
        """
        if self.collision_share is None:
            return np.zeros(np.shape(collided)[:-1])
        share = np.mean(collided, axis=-1)
        if cautious:
            share = np.where(share > 0, _upper(share, np.shape(collided)[-1]), 0.0)
        return np.maximum(share - self.collision_share, 0.0)

    def narrowed(self, space: Space, reliability: Completing, demanded: Callable[[np.ndarray], Demand]) -> Space:
        """The part of a space that keeps the limits known without simulation; the whole space where nothing does.

        Args:
            space: What is searched.
            reliability: F of deadlines and sampling periods (s).
            demanded: Demand of sampling periods.
        """
        tau = np.asarray(space.tau)
        demand = demanded(tau)
        kept = np.ones(tau.size, bool)
        for name in DEMANDS:
            if (limit := getattr(self, name)) is not None:
                kept &= getattr(demand, name) <= limit
        found = space if not kept.any() else replace(space, tau=tuple(tau[kept]))
        return found if self.reliability is None else self._reliable(found, reliability)

    def _reliable(self, space: Space, reliability: Completing) -> Space:
        """Deadlines with enough reliability at some sampling period only."""
        periods = np.asarray(space.tau)

        def enough(deadline: float) -> bool:
            return bool(
                (reliability(np.full(periods.shape, deadline), periods).share >= (self.reliability or 0.0)).any()
            )

        if space.deadline_axis:
            kept = [deadline for deadline in space.deadline if enough(deadline)]
            return replace(space, deadline=tuple(kept)) if kept else space
        low, high = space.deadline
        if enough(low) or not enough(high):
            return space
        inside = high
        for _ in range(24):
            middle = 0.5 * (low + inside)
            low, inside = (low, middle) if enough(middle) else (middle, inside)
        return space if inside >= high else replace(space, deadline=(inside, high))


DEMANDS = (
    "loops_per_s", "uplink_kbit_s", "downlink_kbit_s", "uplink_blocks", "downlink_blocks", "carrier_share", "workers"
)  # fmt: skip


def _upper(share: np.ndarray, count: int) -> np.ndarray:
    """Upper end of Wilson's interval at one sigma."""
    half = np.sqrt(share * (1 - share) / count + 1 / (4 * count * count))
    return (share + 1 / (2 * count) + half) / (1 + 1 / count)
