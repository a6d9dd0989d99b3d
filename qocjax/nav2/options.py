"""Options of qocjax that follow from a user's parameter file."""

from __future__ import annotations

from collections.abc import Mapping

from qocjax.nav2.known import MPPI
from qocjax.nav2.read import NavParams, Plugin

__all__ = ["stack_options", "to_options"]

_MPPI = ("batch_size", "time_steps", "model_dt", "vx_min", "temperature", "gamma")
_ACCELERATIONS = {"ax_max": 1.0, "ax_min": -1.0, "az_max": 1.0}


def to_options(params: NavParams) -> dict[str, float]:
    """Options of the loop and the robot, for any controller; only what the file says.

    Raises:
        ValueError: The controller's frequency is not above 0.
    """
    frequency = params.frequency
    if frequency is not None and frequency <= 0.0:
        raise ValueError(f"{params.path}: controller_frequency: got {frequency}, expected > 0")
    found = {
        "loop.tau": 1.0 / frequency if frequency else None,
        "robot.v_max": params.v_max, "robot.omega_max": params.omega_max, "robot.radius": params.radius,
        "robot.ax_max": params.ax_max, "robot.ax_min": params.ax_min, "robot.az_max": params.az_max,
    }  # fmt: skip
    return {name: value for name, value in found.items() if value is not None}


def stack_options(params: NavParams) -> dict[str, float]:
    """Options of `controller=navigation`: rollouts of MPPI, inflation and tolerance of the goal."""
    mppi = [each for each in params.controllers[:1] if each.kind == MPPI]
    return {
        **{f"controller.mppi.{name}": value for each in mppi for name, value in _numbers(each, _MPPI).items()},
        # As Nav2 does, whatever their signs.
        **{f"controller.mppi.{name}": sign * abs(value) for each in mppi for name, sign in _ACCELERATIONS.items()
           for value in _numbers(each, (name,)).values()},
        **_prefixed("controller.inflation.", params.inflation, ("inflation_radius", "cost_scaling_factor")),
        **_prefixed("controller.", params.goal, ("xy_goal_tolerance",)),
    }  # fmt: skip


def _prefixed(prefix: str, plugin: Plugin | None, names: tuple[str, ...]) -> Mapping[str, float]:
    return {prefix + name: value for name, value in (_numbers(plugin, names) if plugin else {}).items()}


def _numbers(plugin: Plugin, names: tuple[str, ...]) -> dict[str, float]:
    found = {name: plugin.values.get(name) for name in names}
    return {name: value for name, value in found.items() if isinstance(value, (int, float))}
