"""How much more AUC is so little that it does not matter, however much QoC makes of it.

QoC is relative to J_med, the median of the study itself (model, section 5). Where a loop hardly feels its delay, as of
a slow robot by itself, all AUC are small, and QoC tells apart what nobody would see. So besides a share of the best QoC
something absolute counts: robots that are no more than their radius further off, in the root mean square over the way.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax._kept import called
from qocjax.quality import QocScale, initial_norm
from qocjax.reference import reference_origin, reference_way
from qocjax.scenario import Scenario

__all__ = ["Little", "little_of"]


@dataclass(frozen=True)
class Little:
    """What does not matter."""

    auc: float  # s, more than the best
    distance: float  # m, what it is in the root mean square over the way
    ratio: float  # of that AUC to J_med

    def share(self, best: float, part: float = 1.0) -> float:
        """Share of a best QoC 1 / (1 + J / J_med) that is left with so much more AUC, or a part of it."""
        return 1.0 / (1.0 + part * self.ratio * best)

    def further(self, more: float) -> float:
        """How far robots are off (m, root mean square over the way) with so much more AUC (s), beside the best."""
        return self.distance * float(np.sqrt(max(more, 0.0) / self.auc))


def little_of(scenario: Scenario, scale: QocScale) -> Little:
    """The AUC of a distance of one radius over the way: t r² / |delta(0)|²_W, t being the way at the nominal speed cap.

    Args:
        scenario: Robots, ways and normaliser.
        scale: Whose J_med makes QoC of it.
    """
    way, norm = map(float, called(_way_and_norm, (jax.tree.map(np.asarray, scenario),), ()))
    time = way / float(np.asarray(scenario.nominal_v_max))
    radius = float(np.asarray(scenario.robot_radius))
    auc = time * float(np.min(scenario.weights)) * radius**2 / norm
    return Little(auc, radius, auc / scale.median)


def _way_and_norm(scenario: Scenario) -> tuple[Array, Array]:
    """Means over the robots: of the length of the reference's way (m), and of what |delta|²_W is divided by."""
    start = jnp.asarray(scenario.start, float)[..., None]
    goal = jnp.broadcast_to(jnp.asarray(scenario.goal, float), (start.shape[0], 2))[..., None]
    own = scenario.reference_per_robot
    _, way = reference_way(start, goal, own)
    return jnp.hypot(*way).mean(), initial_norm(scenario, start, goal, reference_origin(start, own)).mean()
