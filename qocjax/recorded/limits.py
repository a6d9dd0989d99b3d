"""What a robot was seen to do: how fast it was told to drive and drove, and how quickly it changed its speed.

A recording shows what was driven, and no more: each number is a lower bound of what the robot can do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from qocjax.recorded.accelerations import LEVEL, STILL, WINDOW, Accelerations, accelerations
from qocjax.recorded.findings import Findings
from qocjax.recorded.footprint import Footprint, footprint_of
from qocjax.recorded.nearest import Nearest, Preset, nearest_preset
from qocjax.recorded.series import Cleaning, Series, clean
from qocjax.recorded.topics import BagContent

__all__ = ["RobotLimits", "Speeds", "driven_speeds", "limits_of", "speeds"]

Array = NDArray[np.float64]

_SEEN = (0.05, 0.2)  # m/s and rad/s, below which it was hardly seen to drive, or to turn
_MOVED = 0.05  # m


@dataclass(frozen=True)
class Speeds:
    """Largest speeds of some samples, in m/s and rad/s; 0 for a way that it never went.

    The plain ones are those that 99 % of the samples with motion that way do not pass, `_max` the largest.
    """

    forward: float
    forward_max: float
    backward: float
    backward_max: float
    turn: float  # either way
    turn_max: float


@dataclass(frozen=True)
class RobotLimits:
    """What a recording says of one robot; None for what it does not say."""

    commanded: Speeds | None = None
    driven: Speeds | None = None
    accelerations: Accelerations | None = None
    footprint: Footprint | None = None
    nearest: Nearest | None = None

    @property
    def v_max(self) -> float | None:
        """Cap of the speed that was seen (m/s): commanded and driven; None where it hardly drove."""
        return self._cap("forward", _SEEN[0])

    @property
    def omega_max(self) -> float | None:
        """Cap of the turn rate that was seen (rad/s); None where it hardly turned."""
        return self._cap("turn", _SEEN[1])

    def _cap(self, name: str, least: float) -> float | None:
        seen = [getattr(each, name) for each in (self.commanded, self.driven) if each is not None]
        return min(seen) if seen and min(seen) >= least else None


def speeds(values: Array, cleaning: Cleaning) -> Speeds | None:
    """The largest speeds of samples [n, 2 or more] of nu (m/s) and omega (rad/s), without outliers; None for none."""
    kept = (np.abs(values[:, 0]) <= cleaning.max_speed) & (np.abs(values[:, 1]) <= cleaning.max_turn_rate)
    if not kept.any():
        return None
    nu, omega = values[kept, :2].T
    ways = [(nu, STILL[0]), (-nu, STILL[0]), (np.abs(omega), STILL[1])]
    found = [number for way, still in ways for number in _largest(way[way > still])]
    return Speeds(*found)


def _largest(values: Array) -> tuple[float, float]:
    """The level that the share of them does not pass, and the largest; 0 of none."""
    if not values.size:
        return 0.0, 0.0
    return float(np.percentile(values, LEVEL, method="inverted_cdf")), float(values.max())


def driven_speeds(twists: Series, poses: Series, where: str, cleaning: Cleaning, findings: Findings) -> Series | None:
    """Speeds of a robot's odometry without outliers; None where it has none.

    Drivers that leave the twist at 0 are found by the motion of their poses, whose changes then count.

    Args:
        twists: nu (m/s) and omega (rad/s) of the messages.
        poses: x, y (m) and heading (rad) of the same.
        where: Name of the topic, for the findings.
        cleaning: What counts as an outlier.
        findings: Takes a count and a remark.
    """
    found = twists
    moved = np.ptp(poses.values[:, :2], axis=0).max() if poses.time.size else 0.0
    if not twists.values.any() and moved > _MOVED:
        findings.note(f"{where}: its twists are 0 although it moves; speeds are those of its poses over {WINDOW:g} s")
        found = _from_poses(poses)
    values = np.abs(found.values)
    kept = (values[:, 0] <= cleaning.max_speed) & (values[:, 1] <= cleaning.max_turn_rate)
    findings.count(where, "outlier_speeds", int((~kept).sum()))
    if not kept.all():
        findings.note(
            f"{where}: up to {values[:, 0].max():.4g} m/s and {values[:, 1].max():.4g} rad/s; of a robot that is so "
            "fast, expected clean.max_speed and clean.max_turn_rate above them"
        )
    return _rows(found, kept) if kept.any() else None


def _rows(series: Series, kept: NDArray[np.bool_]) -> Series:
    return Series(
        series.time[kept], series.record[kept], series.stamp[kept], series.late[kept], series.values[kept],
        series.kind, series.frame,
    )  # fmt: skip


def _from_poses(poses: Series) -> Series:
    """Speeds as changes of distance along the heading, and of heading, over a window around each pose."""
    heading = np.unwrap(poses.values[:, 2])
    middle = heading[:-1] + 0.5 * np.diff(heading)
    x, y = np.diff(poses.values[:, :2], axis=0).T
    along = np.append(0.0, np.cumsum(x * np.cos(middle) + y * np.sin(middle)))
    begin, end = (np.clip(poses.time + half, poses.time[0], poses.time[-1]) for half in (-0.5 * WINDOW, 0.5 * WINDOW))
    changes = [np.interp(end, poses.time, each) - np.interp(begin, poses.time, each) for each in (along, heading)]
    values = np.column_stack([*(each / np.maximum(end - begin, 1e-9) for each in changes), np.zeros(begin.size)])
    return Series(poses.time, poses.record, poses.stamp, poses.late, values, poses.kind, poses.frame)


def limits_of(
    content: BagContent, commands: Mapping[str, Series], states: Sequence[Mapping[str, Series]], cleaning: Cleaning,
    presets: Sequence[Preset], findings: Findings,
) -> dict[str, RobotLimits]:  # fmt: skip
    """What the robots of a bag were seen to do, and their size, by robot; without those of which nothing is known.

    Args:
        content: As read.
        commands: Clean, by robot.
        states: Clean poses by robot, of every kind that there is.
        cleaning: What counts as wrong.
        presets: Robots that they may be.
        findings: Takes counts and remarks.
    """
    found = {}
    for robot in sorted({*commands, *content.driven, *content.footprints}):
        told = speeds(commands[robot].values, cleaning) if robot in commands else None
        driven = _driven(content, robot, cleaning, findings) if robot in content.driven else None
        known = [part[robot] for part in states if robot in part]
        outlines = content.footprints.get(robot, [])
        outline = footprint_of(outlines, known, content.begin, f"footprint of {robot}", findings)
        done = None if driven is None else speeds(driven.values, cleaning)
        seen = RobotLimits(told, done, None if driven is None else accelerations(driven), outline)
        radius = None if outline is None else outline.radius
        seen = replace(seen, nearest=nearest_preset(seen.v_max, seen.omega_max, radius, presets))
        if seen != RobotLimits():
            found[robot] = seen
    return found


def _driven(content: BagContent, robot: str, cleaning: Cleaning, findings: Findings) -> Series | None:
    """The speeds of a robot's odometry; what is wrong with its times was said of its poses."""
    where, raw, quiet = f"speeds of {robot}", content.driven[robot], Findings()
    twists = raw.driven()
    values = np.frombuffer(twists.values, np.float64).reshape(-1, 3)
    findings.count(where, "not_finite", int((~np.isfinite(values).all(axis=1)).sum()))
    poses, made = (clean(each, content.begin, where, cleaning, quiet) for each in (raw, twists))
    return driven_speeds(made, poses, where, cleaning, findings)
