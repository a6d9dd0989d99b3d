"""The surrogate law: artificial potential field with a staleness-aware safety distance (model, section 3)."""

from __future__ import annotations

from dataclasses import dataclass

from jax import Array, lax

from qocjax._math import AngleMath, at_least
from qocjax.controllers.interface import Sight, Task
from qocjax.controllers.law import Law
from qocjax.pairs import pair_forces
from qocjax.robots import Command, Pose, Robot, Unicycle
from qocjax.scenario import Design
from qocjax.tunables import APF

__all__ = ["MIN_DISTANCE", "Apf", "apf"]

# Floor of d_ij, so that coincident robots give finite numbers (m).
MIN_DISTANCE = 1e-6

_UNICYCLE = Unicycle()


@dataclass(frozen=True)
class Apf(Law):
    """The surrogate law as a controller: it remembers nothing, and all its parameters are the design's."""

    smooth = True
    tunables = APF

    def command(self, task: Task, memory: tuple[()], sight: Sight) -> tuple[tuple[()], Command, tuple[()]]:
        """The law at one sampling instant."""
        return (), apf(sight.pose, sight.age, task.goal, task.design, task.math, task.robot), ()


def apf(
    pose: Pose,
    age: Array,
    goal: tuple[Array, Array],
    design: Design,
    math: AngleMath,
    robot: Robot = _UNICYCLE,
) -> Command:
    """Commands from the poses and ages at one sampling instant.

    Args:
        pose: [N, *B] sampled poses.
        age: [N, *B'] age of information that the controller sees (s), broadcastable to the poses.
        goal: The two coordinates of p*, each broadcastable to [N, *B] (m).
        design: Parameters broadcastable to [N, *B].
        math: Functions of angles.
        robot: What is steered.

    Returns:
        The saturated command, [N, *B] (paper, Eqs. 4 to 8).
    """
    push_x, push_y = _repulsion(pose, age, design)
    v_x = (goal[0] - pose.x) * design.kappa + push_x
    v_y = (goal[1] - pose.y) * design.kappa + push_y
    return robot.steer(v_x, v_y, pose, design, math)


def _repulsion(pose: Pose, age: Array, design: Design) -> tuple[Array, Array]:
    """Sum of v_ij over the other robots (paper, Eqs. 5 and 6)."""

    def law(squared_distance: Array, age_i: Array, age_j: Array) -> Array:
        inverse = lax.rsqrt(at_least(squared_distance, MIN_DISTANCE**2))
        stale = at_least(at_least(age_i, age_j) - design.deadline, 0.0)
        # Written as a clipped difference: 1/d > 1/d_eff exactly where d < d_eff.
        excess = at_least(inverse - 1.0 / (design.d_safe + design.c_miss * stale), 0.0)
        return excess * design.eta * inverse * inverse * inverse

    return pair_forces(pose.x, pose.y, age, law)
