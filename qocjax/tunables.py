"""What may be chosen: each part of the loop declares its parameters, under their names in the configuration.

A design holds values for some of them: the model's own as fields (`Design.kappa`), any other in `Design.others`. One
that is an *array* goes into a compiled program as numbers, so that many values share one; of any other each value is a
set-up of its own, with its own program where that differs in shape.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from qocjax import _checks

__all__ = [
    "APF",
    "CBF",
    "CONTINUOUS",
    "DESIGN",
    "LOOP",
    "NAVIGATION",
    "NETWORK",
    "ROBOT",
    "WIDEST",
    "Tunable",
    "by_name",
    "check_others",
    "design_name",
]

CONTINUOUS = ("v_max", "omega_max", "eta", "kappa", "gamma", "c_miss", "d_safe")
DESIGN = (*CONTINUOUS, "tau", "deadline")  # the model's values of a design, in the order of its fields


@dataclass(frozen=True)
class Tunable:
    """A parameter that may be chosen.

    Attributes:
        name: In the configuration.
        unit: SI.
        low: Smallest value.
        high: Largest value.
        positive: Whether it must be above its smallest value.
        whole: Whether it is a whole number.
        array: Whether a compiled program takes it as an array.
    """

    name: str
    unit: str = "1"
    low: float = 0.0
    high: float = math.inf
    positive: bool = False
    whole: bool = False
    array: bool = True

    def check(self, values: Any) -> Any:
        """Checks values.

        Raises:
            TypeError: One is no real number.
            ValueError: One is out of range; the message names the parameter.
        """
        least: dict[str, Any] = {"above" if self.positive else "least": self.low}
        ends = {name: end for name, end in {**least, "most": self.high}.items() if math.isfinite(end)}
        checked = _checks.bounded(self.name, values, **ends)
        if self.whole and _checks.is_concrete(checked) and (np.asarray(checked) % 1 != 0).any():
            raise ValueError(f"{self.name}: got {np.asarray(checked).tolist()}, expected whole numbers")
        return checked


def _of(part: str, *declared: Tunable) -> tuple[Tunable, ...]:
    return tuple(Tunable(**{**vars(each), "name": f"{part}.{each.name}"}) for each in declared)


def _fixed(name: str, unit: str = "1", low: float = 0.0, positive: bool = True, whole: bool = False) -> Tunable:
    return Tunable(name, unit, low, positive=positive, whole=whole, array=False)


def _count(name: str) -> Tunable:
    return Tunable(name, "1", 1, whole=True, array=False)


ROBOT = _of(
    "robot", Tunable("v_max", "m/s", positive=True), Tunable("omega_max", "rad/s", positive=True),
    _fixed("radius", "m"), _fixed("ax_max", "m/s^2"), _fixed("az_max", "rad/s^2"),
    Tunable("ax_min", "m/s^2", -math.inf, 0.0, array=False),
)  # fmt: skip
LOOP = _of(
    "loop", Tunable("tau", "s", positive=True), Tunable("deadline", "s"), _fixed("hold_timeout", "s", positive=False),
    _fixed("hold_decay", "s"), _count("plan_length"), _count("command_bytes"),
)  # fmt: skip
NETWORK = _of("network", _count("edge.workers"))

_GOAL = (Tunable("kappa", "1/s"), Tunable("gamma", "1/s"), Tunable("c_miss", "m/s"),
         Tunable("d_safe", "m", positive=True))  # fmt: skip
APF = _of("controller", *_GOAL, Tunable("eta"))
CBF = _of("controller", *_GOAL, Tunable("alpha", "1/s", positive=True))

WIDEST = 5.0  # spread of sampled turn rates (rad/s) that a program is made for where it takes it as an array

_WEIGHT, _NEAR = Tunable("cost_weight"), Tunable("near_goal_distance", "m")
_CRITICS: dict[str, tuple[Tunable, ...]] = {
    "ConstraintCritic": (_WEIGHT,),
    "CostCritic": (_WEIGHT, Tunable("critical_cost"), Tunable("near_collision_cost"), Tunable("collision_cost"), _NEAR,
                   _count("trajectory_point_step")),
    "GoalAngleCritic": (_WEIGHT, Tunable("threshold_to_consider", "m")),
    "GoalCritic": (_WEIGHT, Tunable("threshold_to_consider", "m")),
    "ObstaclesCritic": (
        Tunable("repulsion_weight"), Tunable("critical_weight"), Tunable("collision_cost"),
        Tunable("collision_margin_distance", "m"), _NEAR, Tunable("cost_scaling_factor", "1/m", positive=True),
        Tunable("inflation_radius", "m"),
    ),
    "PathAlignCritic": (_WEIGHT, Tunable("threshold_to_consider", "m"), Tunable("max_path_occupancy_ratio", high=1.0),
                        _fixed("offset_from_furthest", positive=False, whole=True), _count("trajectory_point_step")),
    "PathFollowCritic": (_WEIGHT, Tunable("threshold_to_consider", "m"),
                         _fixed("offset_from_furthest", positive=False, whole=True)),
    "PreferForwardCritic": (_WEIGHT, Tunable("threshold_to_consider", "m")),
}  # fmt: skip
NAVIGATION = _of(
    "controller",
    *_of("inflation", Tunable("inflation_radius", "m"), Tunable("cost_scaling_factor", "1/m"),
         _fixed("localisation_sigma", "m", positive=False), _fixed("sigma_factor", positive=False)),
    *_of("planner", Tunable("cost_travel_multiplier"), _fixed("tolerance", "m", positive=False)),
    *_of("mppi", Tunable("temperature", positive=True), Tunable("gamma"), Tunable("vx_std", "m/s"),
         Tunable("vy_std", "m/s"), Tunable("wz_std", "rad/s", high=WIDEST), Tunable("vx_min", "m/s", -math.inf),
         _count("batch_size"), _count("time_steps"), _count("iteration_count"), _fixed("model_dt", "s"),
         _fixed("prune_distance", "m"), _fixed("path_spacing", "m"), _fixed("ax_max", "m/s^2"),
         _fixed("az_max", "rad/s^2"), Tunable("ax_min", "m/s^2", -math.inf, 0.0, array=False)),
    *(each for critic, declared in _CRITICS.items() for each in _of(f"mppi.critics.{critic}", *declared)),
    Tunable("xy_goal_tolerance", "m"), Tunable("max_widening", "m"), Tunable("backup_speed", "m/s"),
    Tunable("backup_dist", "m", positive=True), _fixed("planner_period", "s"),
)  # fmt: skip


def design_name(name: str) -> str:
    """The name of a parameter in a design: `kappa` for `controller.kappa`, any that is no field of it unchanged."""
    part, _, last = name.rpartition(".")
    return last if part in ("robot", "controller", "loop") and last in DESIGN else name


def by_name(declared: Iterable[Tunable]) -> dict[str, Tunable]:
    """Declarations by the name in a design."""
    return {design_name(each.name): each for each in declared}


def check_others(declared: Iterable[Tunable], others: Mapping[str, Any]) -> None:
    """Checks values beside the model's own against what a controller declares.

    Raises:
        TypeError: A value is no real number.
        ValueError: One is not declared, needs a program of its own, or is out of range.
    """
    known = {name: each for name, each in by_name(declared).items() if each.array and name not in DESIGN}
    for name, values in others.items():
        if name not in known:
            listed = ", ".join(known) or "none beside the model's own"
            raise ValueError(f"others: got {name}, expected what the controller declares: {listed}")
        known[name].check(values)
