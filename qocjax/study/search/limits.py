"""What is asked of a design besides its score, and by how much a design breaks it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from qocjax import _checks
from qocjax.network.demand import Demand, Traffic
from qocjax.network.interface import Network
from qocjax.scenario import Design
from qocjax.study.search.space import Space

__all__ = ["Limits"]


@dataclass(frozen=True)
class Limits:
    """Limits on a design; None asks nothing.

    Attributes:
        collision_share: Largest share of runs in which two robots come closer than two radii.
        reliability: Smallest loop-completion probability F(Delta).
        loops_per_s: Largest message rate, all robots together (1/s).
        uplink_kbit_s: Largest uplink throughput.
        downlink_kbit_s: Largest downlink throughput.
        carrier_share: Largest share of the carrier's resource blocks.
    """

    collision_share: float | None = None
    reliability: float | None = None
    loops_per_s: float | None = None
    uplink_kbit_s: float | None = None
    downlink_kbit_s: float | None = None
    carrier_share: float | None = None

    def __post_init__(self) -> None:
        for name in ("collision_share", "reliability"):
            if getattr(self, name) is not None:
                _checks.bounded(name, getattr(self, name), least=0, most=1, shape=())
        for name in _DEMANDS:
            if getattr(self, name) is not None:
                _checks.bounded(name, getattr(self, name), above=0, shape=())

    def of_network(self, designs: Design, network: Network, demand: Demand) -> np.ndarray:
        """By how much designs break what is known without simulation, [G]: relative excess, summed; 0 if kept."""
        excess = np.zeros(np.shape(designs.deadline))
        if self.reliability is not None:
            excess = excess + np.maximum(self.reliability - network.reliability(np.asarray(designs.deadline)), 0.0)
        for name in _DEMANDS:
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

    def narrowed(self, space: Space, network: Network, traffic: Traffic, num_robots: int) -> Space:
        """The part of a space that keeps the limits known without simulation; the whole space where nothing does."""
        tau = np.asarray(space.tau)
        demand = traffic.of(tau, num_robots)
        kept = np.ones(tau.size, bool)
        for name in _DEMANDS:
            if (limit := getattr(self, name)) is not None:
                kept &= getattr(demand, name) <= limit
        found = space if not kept.any() else replace(space, tau=tuple(tau[kept]))
        return found if self.reliability is None else self._reliable(found, network)

    def _reliable(self, space: Space, network: Network) -> Space:
        """Deadlines with enough reliability only."""
        least = self.reliability or 0.0
        if space.deadline_axis:
            axis = np.asarray(space.deadline)
            kept = axis[network.reliability(axis) >= least]
            return space if kept.size == 0 else replace(space, deadline=tuple(kept))
        low, high = space.deadline
        if network.reliability(np.array(low)) >= least or network.reliability(np.array(high)) < least:
            return space
        inside = high
        for _ in range(50):
            middle = 0.5 * (low + inside)
            low, inside = (low, middle) if network.reliability(np.array(middle)) >= least else (middle, inside)
        return space if inside >= high else replace(space, deadline=(inside, high))


_DEMANDS = ("loops_per_s", "uplink_kbit_s", "downlink_kbit_s", "carrier_share")


def _upper(share: np.ndarray, count: int) -> np.ndarray:
    """Upper end of Wilson's interval at one sigma."""
    half = np.sqrt(share * (1 - share) / count + 1 / (4 * count * count))
    return (share + 1 / (2 * count) + half) / (1 + 1 / count)
