"""Configuration of controllers: gains of a law, the navigation stack, or a class from outside."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Tag

from qocjax.config.custom import CustomConfig
from qocjax.config.part import Part, conf_dir
from qocjax.controllers import Apf, Cbf, Controller
from qocjax.navigation import (
    ConstraintCritic,
    CostCritic,
    GoalAngleCritic,
    GoalCritic,
    Inflation,
    MppiConfig,
    NavigationStack,
    ObstaclesCritic,
    PathAlignCritic,
    PathFollowCritic,
    Planner,
    PreferForwardCritic,
    StaticMap,
    open_floor,
    read_map,
)
from qocjax.robots import Ackermann, Robot, Unicycle
from qocjax.scenario import Scenario

__all__ = ["ApfConfig", "CbfConfig", "ControllerConfig", "CustomConfig", "NavigationConfig", "map_of"]

_CRITICS = {
    critic.__name__: critic
    for critic in (
        ConstraintCritic, CostCritic, GoalAngleCritic, GoalCritic, ObstaclesCritic, PathAlignCritic, PathFollowCritic,
        PreferForwardCritic,
    )
}  # fmt: skip

_UNICYCLE = Unicycle()


class ApfConfig(Part):
    """Gains of the surrogate law at baseline."""

    law: Literal["apf"]
    kappa: float
    eta: float
    gamma: float
    c_miss: float
    d_safe: float

    def gains(self) -> dict[str, float]:
        """Values of the baseline design."""
        return self.model_dump(exclude={"law"})

    def declares(self) -> Any:
        """The law or its class, which says what may be chosen of it and what it reads; reads no file."""
        return Apf

    def build(self, scenario: Scenario, map_name: str | None, wz_max: float, release: str = "jazzy") -> Controller:
        """The surrogate law, which knows no map."""
        return Apf()


class CbfConfig(Part):
    """Gains of the goal law behind a barrier."""

    law: Literal["cbf"]
    kappa: float
    gamma: float
    c_miss: float
    d_safe: float
    alpha: float

    def gains(self) -> dict[str, float]:
        """Values of the baseline design; the law reads no repulsion gain."""
        return self.model_dump(exclude={"law", "alpha"})

    def declares(self) -> Any:
        """The law or its class, which says what may be chosen of it and what it reads; reads no file."""
        return Cbf

    def build(self, scenario: Scenario, map_name: str | None, wz_max: float, release: str = "jazzy") -> Controller:
        """The law, which knows no map."""
        return Cbf(self.alpha)


class InflationConfig(Part):
    """How costs fall off around obstacles."""

    inflation_radius: float
    cost_scaling_factor: float
    localisation_sigma: float
    sigma_factor: float


class PlannerConfig(Part):
    """The global planner."""

    cost_travel_multiplier: float
    tolerance: float


class MppiPart(Part):
    """The local controller; what the design and the loop set is not here."""

    batch_size: int
    time_steps: int
    model_dt: float
    iteration_count: int
    vx_min: float
    vy_max: float
    ax_max: float | None
    ax_min: float | None
    ay_max: float | None
    ay_min: float | None
    az_max: float | None
    vx_std: float
    vy_std: float
    wz_std: float
    temperature: float
    gamma: float
    clamp_raw_controls: bool
    sgf_order: int
    prune_distance: float
    path_spacing: float
    stop_if_blocked: bool
    critics: dict[str, dict[str, float | int]]

    def build(self, wz_max: float, robot: Robot = _UNICYCLE) -> MppiConfig:
        """Parameters of the local controller of a robot.

        Raises:
            ValueError: An unknown critic or parameter, or a value out of range.
        """
        values = self.model_dump(exclude={"critics"})
        critics = tuple(_critic(name, given) for name, given in self.critics.items())
        if robot.motion_model is not None:  # where it is, the stack refuses the robot
            values["motion_model"] = robot.motion_model
        if isinstance(robot, Ackermann):
            values["min_turning_r"] = float(np.asarray(robot.min_turning_r))
        return MppiConfig(**values, wz_max=wz_max, critics=critics)


class NavigationConfig(Part):
    """The navigation stack."""

    law: Literal["navigation"]
    kappa: float
    d_safe: float
    resolution: float
    floor_margin: float
    inflation: InflationConfig
    planner: PlannerConfig
    mppi: MppiPart
    planner_period: float
    predict: bool
    xy_goal_tolerance: float
    max_widening: float
    backup_speed: float
    backup_dist: float

    def gains(self) -> dict[str, float]:
        """Values of the baseline design; the stack reads neither, the yardstick and the time of arrival do."""
        return {"kappa": self.kappa, "d_safe": self.d_safe}

    def declares(self) -> Any:
        """The law or its class, which says what may be chosen of it and what it reads; reads no file."""
        return NavigationStack

    def build(self, scenario: Scenario, map_name: str | None, wz_max: float, release: str = "jazzy") -> NavigationStack:
        """The stack on a map, or on open floor.

        Args:
            scenario: Robots and goals.
            map_name: From the configuration of the scenario; None for open floor.
            wz_max: Largest rate of turn of the study (rad/s).
            release: Of ROS 2, whose rule for pixels that are not opaque holds.
        """
        rest = ("planner_period", "predict", "xy_goal_tolerance", "max_widening", "backup_speed", "backup_dist")
        return NavigationStack(
            map_of(scenario, map_name, self.floor_margin, self.resolution, release),
            Inflation(robot_radius=float(scenario.robot_radius), **self.inflation.model_dump()),  # type: ignore[arg-type]
            Planner(**self.planner.model_dump()),
            self.mppi.build(wz_max, scenario.robot),
            **{name: getattr(self, name) for name in rest},
        )


def _branch(value: Any) -> str | None:
    """Which of the models holds a controller: what names a class is a law from outside."""
    if isinstance(value, dict):
        return "custom" if "_target_" in value else value.get("law")
    return "custom" if isinstance(value, CustomConfig) else getattr(value, "law", None)


ControllerConfig = Annotated[
    Annotated[ApfConfig, Tag("apf")]
    | Annotated[CbfConfig, Tag("cbf")]
    | Annotated[NavigationConfig, Tag("navigation")]
    | Annotated[CustomConfig, Tag("custom")],
    Discriminator(_branch),
]


def map_of(
    scenario: Scenario, name: str | None, margin: float = 1.0, resolution: float = 0.05, release: str = "jazzy"
) -> StaticMap:
    """The map of a scenario: a file of `conf/maps` or of the working directory, or open floor where there is none.

    Raises:
        ValueError: There is no such file, or it is no map.
    """
    if name is None:
        return open_floor(scenario, margin, resolution)
    places = (conf_dir() / "maps" / name, Path(name))
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise ValueError(f"scenario.map: got {name}, expected a map file of {places[0].parent} or a path to one")
    return read_map(found, release=release)


def _critic(name: str, given: dict[str, Any]) -> Any:
    if name not in _CRITICS:
        raise ValueError(f"controller.mppi.critics: got {name}, expected one of {', '.join(_CRITICS)}")
    known = [item.name for item in fields(_CRITICS[name])]
    for key in given:
        if key not in known:
            raise ValueError(f"controller.mppi.critics.{name}: got {key}, expected one of {', '.join(known)}")
    return _CRITICS[name](**given)
