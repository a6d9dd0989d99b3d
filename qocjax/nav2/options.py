"""Options of qocjax that follow from a user's parameter file."""

from __future__ import annotations

from collections.abc import Mapping

import yaml

from qocjax.nav2.document import Value
from qocjax.nav2.facts import fact, facts
from qocjax.nav2.known import CRITICS, HANDLER, MPPI
from qocjax.nav2.read import NavParams, Plugin
from qocjax.navigation.mppi_config import MppiConfig
from qocjax.navigation.stack_parts import STACK_MPPI

__all__ = ["NO_HEADING", "critics_of", "stack_options", "stack_values", "to_options"]

_MPPI = (
    "batch_size", "time_steps", "model_dt", "iteration_count", "vx_min", "vx_std", "wz_std", "temperature", "gamma",
    "sgf_order", "clamp_raw_controls",
)  # fmt: skip
_ACCELERATIONS = {"ax_max": 1.0, "ax_min": -1.0, "az_max": 1.0}
NO_HEADING = "GoalAngleCritic"  # for which simulated goals have none
_OF_DESIGN = ("vx_max", "wz_max")  # which the advice sets
_CRITICS = "controller.mppi.critics"
# What the stack has otherwise than Nav2: a file that leaves it out means Nav2's default.
_OWN = {"PathFollowCritic.cost_weight"}


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


def stack_options(params: NavParams) -> dict[str, float | None]:
    """Options of `controller=navigation`: rollouts of MPPI with its critics, inflation and tolerance of the goal.

    None stands for a critic that the file does not name or switches off.
    """
    found: dict[str, float | None] = {}
    for mppi in [each for each in params.controllers[:1] if each.kind == MPPI]:
        found |= {f"controller.mppi.{name}": value for name, value in _numbers(mppi, _MPPI).items()}
        # As Nav2 does, whatever their signs.
        found |= {f"controller.mppi.{name}": sign * abs(value) for name, sign in _ACCELERATIONS.items()
                  for value in _numbers(mppi, (name,)).values()}  # fmt: skip
        found["controller.mppi.prune_distance"] = _prune_distance(params, mppi)
        found |= _critics(params, mppi)
    return {
        **found,
        **_prefixed("controller.inflation.", params.inflation, ("inflation_radius", "cost_scaling_factor")),
        **_prefixed("controller.", params.goal, ("xy_goal_tolerance",)),
    }


def stack_values(mppi: MppiConfig) -> dict[str, Value]:
    """What a simulated stack has otherwise than Nav2's defaults, and its critics, by the names of MPPI's parameters."""
    found: dict[str, Value] = {"critics": [type(critic).__name__ for critic in mppi.critics]}
    parts = {"": mppi} | {f"{type(critic).__name__}.": critic for critic in mppi.critics}
    for known in facts("controller_server", MPPI):
        prefix, _, own = known.name.rpartition(".")
        value = getattr(parts.get(f"{prefix}." if prefix else ""), own, None)
        if isinstance(value, (int, float)) and own not in _OF_DESIGN and value != _default(known.name, MPPI):
            found[known.name] = int(value) if known.type == "integer" else value
    return found


def _prune_distance(params: NavParams, mppi: Plugin) -> float:
    """Of MPPI up to Kilted, of the path handler from Lyrical on."""
    plugin, kind = (mppi, MPPI) if params.handler is None else (params.handler, HANDLER)
    return _numbers(plugin, ("prune_distance",)).get("prune_distance", _default("prune_distance", kind))


def critics_of(mppi: Plugin) -> list[str]:
    """The critics that a file names, has switched on, and that are simulated, by name."""
    named = mppi.values.get("critics")
    known = CRITICS & set(named if isinstance(named, list) else [])
    return sorted(each for each in known - {NO_HEADING} if mppi.values.get(f"{each}.enabled") is not False)


def _critics(params: NavParams, mppi: Plugin) -> dict[str, float | None]:
    """The critics of a file that names some, each with what the file says of it; of the stack's own the others go."""
    named, found = critics_of(mppi), dict[str, float | None]()
    if not named:
        return found
    own = {type(critic).__name__ for critic in STACK_MPPI.critics}
    found |= {f"{_CRITICS}.{critic}": None for critic in sorted(own - set(named))}
    for critic in named:
        given = {name: value for name, value in mppi.values.items() if name.startswith(f"{critic}.")}
        if critic not in own:  # which has to be named by a value
            given.setdefault(f"{critic}.cost_power", _default(f"{critic}.cost_power", MPPI))
        given |= {name: _default(name, MPPI) for name in _OWN if name.startswith(f"{critic}.") and name not in given}
        if critic == "ObstaclesCritic" and params.inflation:
            given |= {f"{critic}.{name}": value for name, value in params.inflation.values.items()
                      if name in ("inflation_radius", "cost_scaling_factor")}  # fmt: skip
        found |= {f"{_CRITICS}.{name}": value for name, value in sorted(given.items())
                  if isinstance(value, (int, float)) and not name.endswith(".enabled")}  # fmt: skip
    return found


def _default(name: str, plugin: str) -> float:
    """Of the first release that has the parameter."""
    known = fact("controller_server", name, plugin)
    value: float = yaml.safe_load(next(filter(None, known.defaults)))
    return value


def _prefixed(prefix: str, plugin: Plugin | None, names: tuple[str, ...]) -> Mapping[str, float]:
    return {prefix + name: value for name, value in (_numbers(plugin, names) if plugin else {}).items()}


def _numbers(plugin: Plugin, names: tuple[str, ...]) -> dict[str, float]:
    found = {name: plugin.values.get(name) for name in names}
    return {name: value for name, value in found.items() if isinstance(value, (int, float))}
