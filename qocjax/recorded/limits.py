"""What a robot was seen to do: how fast it was told to drive and drove, and how quickly it changed its speed.

A recording shows what was driven, and no more: each number is a lower bound of what the robot can do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from qocjax.recorded.findings import Findings
from qocjax.recorded.footprint import Footprint
from qocjax.recorded.nearest import Nearest
from qocjax.recorded.series import Cleaning, Series

__all__ = ["Accelerations", "RobotLimits", "Speeds", "accelerations", "driven_speeds", "speeds"]

Array = NDArray[np.float64]

LEVEL = 99  # %, of the samples that a cap seen is not below
WINDOW = 0.2  # s, at least, over which a change of speed is measured
_SAMPLES = 5  # at least, in a window
_CLEAR = 4.0  # standard errors, from where on a change is none of the noise
_LONGEST = 1.0  # s, of a window, beyond which speeds come too seldom
_FLAT = 0.01  # m/s² or rad/s², below which a slope is none
_LUCK = 2.33  # standard errors that 1 % of the samples of a level are above it by
_STILL = (0.01, 0.02)  # m/s and rad/s, below which a robot stands
_SEEN = (0.05, 0.2)  # m/s and rad/s, below which it was hardly seen to drive, or to turn
_MOVED = 0.05  # m
_BLOCK = 50_000  # windows that are looked at together


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
class Accelerations:
    """Largest accelerations, in m/s² and rad/s²: what 99 % of those clear of the noise do not pass, less its share.

    None where none is clear.
    """

    ax_max: float | None
    ax_min: float | None  # below 0
    az_max: float | None  # either way
    ax_noise: float  # what noise alone may look like: four standard errors of a slope
    az_noise: float
    window: float  # s, over which slopes are taken


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
    ways = [(nu, _STILL[0]), (-nu, _STILL[0]), (np.abs(omega), _STILL[1])]
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


def accelerations(driven: Series) -> Accelerations | None:
    """The largest accelerations of a robot; None where its speeds are too few or too seldom, or it stands.

    A line is fitted to the speeds in each window of 0.2 s or five samples, whichever is longer, after a median of three
    has taken single spikes out. Its slope counts where it is four standard errors from 0, with the noise of a sample
    from the second differences of the speeds while it moves, by their median; so what noise makes of steady driving is
    left out. Of the level that 99 % of the slopes that count do not pass, 2.3 standard errors are taken off, as the
    largest of many are also those that noise made larger. A change that is quicker than the window is seen too slow.

    Args:
        driven: nu (m/s) and omega (rad/s) in order of time.
    """
    every = np.diff(driven.time)
    if every.size < _SAMPLES or not np.median(every) > 0.0:
        return None
    usual = float(np.median(every))
    count = max(_SAMPLES, int(np.ceil(WINDOW / usual - 1e-6)) + 1)
    span = (count - 1) * usual
    moving = (np.abs(driven.values[:, :2]) > _STILL).any(axis=1)
    if span > _LONGEST or driven.time.size < count or not moving.any():
        return None
    ax, ax_noise = _slopes(driven.time, driven.values[:, 0], moving, count, 1.5 * span)
    az, az_noise = _slopes(driven.time, driven.values[:, 1], moving, count, 1.5 * span)
    slower = _above(-ax, ax_noise)
    return Accelerations(
        _above(ax, ax_noise), None if slower is None else -slower, _above(np.abs(az), az_noise), ax_noise, az_noise,
        round(span, 6),
    )  # fmt: skip


def _above(slopes: Array, noise: float) -> float | None:
    """What most of the slopes clear of the noise do not pass, without the part of luck in it."""
    clear = slopes[slopes > max(noise, _FLAT)]
    return _largest(clear)[0] - _LUCK * noise / _CLEAR if clear.size else None


def _slopes(time: Array, values: Array, moving: NDArray[np.bool_], count: int, longest: float) -> tuple[Array, float]:
    """Slopes of lines through windows of so many samples within `longest` s, and what noise may look like."""
    smooth = values.copy()
    smooth[1:-1] = np.median(sliding_window_view(values, 3), axis=1)
    second = np.abs(values[2:] - 2.0 * values[1:-1] + values[:-2])
    driving = moving[2:] & moving[1:-1] & moving[:-2]  # a robot that stands has little noise
    sigma = 1.4826 * float(np.median(second[driving] if driving.any() else second)) / math.sqrt(6.0)
    found, widths = [], []
    for first in range(0, time.size - count + 1, _BLOCK):
        last = min(first + _BLOCK + count - 1, time.size)
        t, v = (sliding_window_view(each[first:last], count) for each in (time, smooth))
        t = t - t.mean(axis=1, keepdims=True)
        width = (t**2).sum(axis=1)
        kept = (t[:, -1] - t[:, 0] <= longest) & (width > 0.0)
        found.append((t[kept] * v[kept]).sum(axis=1) / width[kept])
        widths.append(width[kept])
    slopes, width = np.concatenate(found), np.concatenate(widths)
    return slopes, _CLEAR * sigma / math.sqrt(float(np.median(width))) if width.size else 0.0
