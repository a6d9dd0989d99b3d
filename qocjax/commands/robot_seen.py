"""The robot that a bag shows, for advice where nobody chose one."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from qocjax.config.robot import RobotConfig
from qocjax.recorded import RecordedRun
from qocjax.recorded.limits import RobotLimits

__all__ = ["RobotSeen", "limits_values", "robot_seen", "robot_text"]

_MORE = 1.1  # times the caps that were asked for, from where on a bag contradicts them
_UNITS = {
    "v_max": "m/s", "omega_max": "rad/s", "radius": "m", "ax_max": "m/s²", "ax_min": "m/s²", "az_max": "rad/s²",
}  # fmt: skip


@dataclass(frozen=True)
class RobotSeen:
    """Which robot is advised on."""

    text: str = ""  # for the page; empty where no bag shows one
    options: dict[str, float] = field(default_factory=dict)  # of `robot`, that the bag tells
    limits: RobotLimits | None = None


def robot_seen(run: RecordedRun, robot: RobotConfig, preset: str, chosen: bool) -> RobotSeen:
    """The caps, accelerations and size that a recording shows, unless somebody chose a robot; and what to tell of it.

    Args:
        run: A recording.
        robot: As configured.
        preset: Its name in `conf/robot`.
        chosen: Whether somebody chose it, or any of its values.
    """
    if not run.limits:
        return RobotSeen()
    seen = _of_loops(run)
    if seen is None:
        return RobotSeen(f"{robot_text(robot)} (robot={preset}): the bag shows several, {', '.join(run.limits)}.")
    radius = None if seen.footprint is None else seen.footprint.radius
    found = {"v_max": seen.v_max, "omega_max": seen.omega_max, "radius": radius}
    found |= {name: getattr(seen.accelerations, name, None) for name in ("ax_max", "ax_min", "az_max")}
    told = {name: float(f"{value:.3g}") for name, value in found.items() if value is not None}
    if chosen:
        own = _own(robot)
        more = {name: value for name, value in told.items()
                if name != "radius" and name in own and abs(value) > _MORE * abs(own[name])}  # fmt: skip
        beyond = f" The bag shows more: {_values(more)}." if more else ""
        return RobotSeen(f"{robot_text(robot)}, as given.{beyond}", {}, seen)
    kept = {name: value for name, value in _own(robot).items() if name not in told}
    near = "robot=turtlebot3_burger"
    if seen.nearest is not None and seen.nearest.near:
        near = f"robot={seen.nearest.name}, the nearest preset,"
    text = f"as the bag shows it: {_values(told)}. " if told else "the bag does not show what it can do. "
    text += f"Of robot={preset}, as the bag does not show them: {_values(kept)}. " if kept else ""
    text += "A bag shows only what was driven: it can do that at least. " if told else ""
    return RobotSeen(f"{text}{near} or robot.v_max=... say otherwise.", told, seen)


def _of_loops(run: RecordedRun) -> RobotLimits | None:
    """Of the robot whose loops, or whose delay from commands to motion, are simulated; None where that is not known."""
    names = list(run.loops or run.latency)
    if len(names) == 1 and names[0] in run.limits:
        return run.limits[names[0]]
    return next(iter(run.limits.values())) if len(run.limits) == 1 else None


def robot_text(robot: RobotConfig) -> str:
    """Caps, size and limits on acceleration of a robot, those that there are, with units."""
    return _values(_own(robot))


def _own(robot: RobotConfig) -> dict[str, float]:
    """Caps, size and limits on acceleration of a robot, those that there are."""
    return {name: value for name in _UNITS if (value := getattr(robot, name)) is not None}


def _values(values: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.3g} {_UNITS[name]}" for name, value in values.items())


def limits_values(seen: RobotLimits) -> dict[str, Any]:
    """What a robot was seen to do, with the caps that follow, for a file."""
    return {"v_max": seen.v_max, "omega_max": seen.omega_max, **asdict(seen)}
