"""Goal law through a control-barrier filter: the velocity nearest to the goal's that keeps the robots apart.

In the place of the repulsion of the surrogate law each robot takes

    v = argmin |v - v_nom|²   subject to   n_ij · v >= -(alpha / 2) h_ij   for each other robot j,
    v_nom = -κ (p_i - p*), no faster than ν^max,   n_ij = (p_i - p_j) / d_ij,   h_ij = d_ij - d_eff,

with d_eff of the surrogate law (model, section 3), which grows with the age of what is known, and the same steering.
Two robots that both keep it have h' >= -alpha h, each taking half (Wang, Ames, Egerstedt, "Safety Barrier Certificates
for Collisions-Free Multirobot Systems", 2017). The comparison with potential fields is that of Singletary et al., 2021,
which the paper cites.

The barrier is that of a robot that moves as it is told, a holonomic one without delay. A unicycle or a car first has to
turn, and what they are told acts later: under delay it is no proof, and `experiments/cbf.py` says what it is worth.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from qocjax import _checks
from qocjax.controllers.apf import MIN_DISTANCE
from qocjax.controllers.halfplanes import HalfPlanes, nearest
from qocjax.controllers.interface import Sight, Task
from qocjax.controllers.law import Law
from qocjax.robots import Command, Pose
from qocjax.scenario import Design
from qocjax.tunables import CBF

__all__ = ["Cbf"]


@dataclass(frozen=True)
class Cbf(Law):
    """The goal law behind a barrier.

    Attributes:
        alpha: Rate at which a robot may use up the distance that it has to another (1/s).
    """

    alpha: float = 2.0

    unread = ("eta",)
    tunables = CBF

    def __post_init__(self) -> None:
        object.__setattr__(self, "alpha", float(_checks.bounded("alpha", self.alpha, above=0.0, shape=())))

    def begin(self, task: Task, pose: Pose, keys: Array | None) -> Array:
        """Cycles [N, *B] in which no velocity was admissible."""
        return jnp.zeros_like(pose.x)

    def command(self, task: Task, memory: Array, sight: Sight) -> tuple[Array, Command, tuple[()]]:
        """The law at one sampling instant."""
        pose, design, goal = sight.pose, task.design, task.goal
        wanted_x, wanted_y = ((goal[k] - at) * design.kappa for k, at in enumerate((pose.x, pose.y)))
        over = jnp.maximum(jnp.hypot(wanted_x, wanted_y) / design.v_max, 1.0)
        planes = _barriers(pose, sight.age, design, design.others.get("controller.alpha", self.alpha))
        v_x, v_y, admissible = nearest(wanted_x / over, wanted_y / over, planes)
        return memory + ~admissible, task.robot.steer(v_x, v_y, pose, design, task.math), ()

    def report(self, memory: Array) -> dict[str, Array]:
        """How often no velocity kept every barrier."""
        return {"squeezed": memory}


def _barriers(pose: Pose, age: Array, design: Design, alpha: ArrayLike) -> HalfPlanes:
    """The half-planes [N - 1, N, *B] of each robot, one for each other."""
    robots = pose.x.shape[0]
    others = np.array([[j for j in range(robots) if j != i] for i in range(robots)], int).reshape(robots, -1).T
    age = jnp.broadcast_to(age, pose.x.shape)
    apart_x, apart_y = (at[None] - at[others] for at in (pose.x, pose.y))
    distance = jnp.sqrt(jnp.maximum(apart_x * apart_x + apart_y * apart_y, MIN_DISTANCE**2))
    deadline, d_safe, c_miss, alpha = (
        jnp.expand_dims(value, 0) if jnp.ndim(value) else value
        for value in (design.deadline, design.d_safe, design.c_miss, alpha)
    )
    stale = jnp.maximum(jnp.maximum(age[None], age[others]) - deadline, 0.0)
    barrier = distance - (d_safe + c_miss * stale)
    on_top = distance <= MIN_DISTANCE  # coincident robots: away from the middle, in the order of their numbers
    sign = jnp.asarray(np.where(others > np.arange(robots), -1.0, 1.0), distance.dtype)
    sign = jnp.broadcast_to(sign.reshape(*others.shape, *(1,) * (distance.ndim - 2)), distance.shape)
    n_x, n_y = jnp.where(on_top, sign, apart_x / distance), jnp.where(on_top, 0.0, apart_y / distance)
    return HalfPlanes(n_x, n_y, -0.5 * barrier * alpha)
