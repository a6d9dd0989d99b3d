"""How quickly a robot was seen to change its speed: slopes of its odometry's speeds that are clear of their noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from qocjax.recorded.series import Series

__all__ = ["LEVEL", "STILL", "WINDOW", "Accelerations", "accelerations"]

Array = NDArray[np.float64]

LEVEL = 99  # %, of the samples that a cap seen is not below
WINDOW = 0.2  # s, at least, over which a change of speed is measured
_SAMPLES = 5  # at least, in a window
_CLEAR = 4.0  # standard errors, from where on a change is none of the noise
_LONGEST = 1.0  # s, of a window, beyond which speeds come too seldom
_FLAT = 0.01  # m/s² or rad/s², below which a slope is none
_LUCK = 2.33  # standard errors that 1 % of the samples of a level are above it by
STILL = (0.01, 0.02)  # m/s and rad/s, below which a robot stands
_BLOCK = 50_000  # windows that are looked at together


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
    moving = (np.abs(driven.values[:, :2]) > STILL).any(axis=1)
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
    if not clear.size:
        return None
    return float(np.percentile(clear, LEVEL, method="inverted_cdf")) - _LUCK * noise / _CLEAR


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
