"""From a command to the motion that it makes: the delay at which recorded commands fit the recorded poses best.

A command holds until the next, so a robot that did what it was told d seconds later would turn between two poses by
what Ω(t - d) changes, with Ω the integral of the commands, a line with a bend at each command. The delay is the
d at which these changes, and likewise those of the distance along the heading, correlate best with the poses'; what is
compared are integrals over the same intervals, so neither numerical derivatives nor a common grid blur the result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit  # not scipy.stats, which takes a third of a second to import

from qocjax.recorded.series import Series

__all__ = ["Latency", "command_to_motion"]

Array = NDArray[np.float64]

_RANGE = (-0.5, 2.0)  # s, of delays that are tried
_COARSE, _FINE, _WINDOW = 0.02, 0.002, 0.05  # s
_BLOCKS = 12  # of the run, each left out once for the uncertainty
_MOST = 20_000  # intervals; of denser poses every n-th counts
_LEAST = 100
_SAMPLING = 0.1  # of the interval between poses, as far as steps between them blur the result
_CHANGE = 1e-3  # m/s or rad/s, from where on two commands differ; they must in half of the blocks
_CLEAR = 0.5  # correlation, below which commands do not explain the motion
_WIDEST = 0.25  # s, half of the interval, above which the delay counts as unknown
_LONGEST = 1.0  # s, between two poses, above which nothing is known of the way between


@dataclass(frozen=True)
class Latency:
    """The delay from the record time of a command to the robot's motion, as its poses show it."""

    delay: float  # s
    low: float  # s, 95 % interval
    high: float
    correlation: float  # of what was told and what was done, at that delay


def command_to_motion(commands: Series, poses: Series) -> Latency | None:
    """Estimates the delay between commands and motion.

    It holds everything between the two records: transport to the robot, waiting, and the robot's own response; of the
    poses' way to the recorder the smallest delay. The interval is Student's, from leaving out one of twelve parts of
    the run at a time, and a tenth of the interval between poses.

    Args:
        commands: Speeds nu (m/s) and omega (rad/s) at their record times.
        poses: x, y (m) and heading (rad).

    Returns:
        None where the commands vary too little, or do not explain the motion.
    """
    order = np.argsort(commands.record, kind="stable")
    told, speeds = commands.record[order], commands.values[order, :2]
    found = _increments(poses, told[0] - _RANGE[0] if told.size else 0.0, told[-1] if told.size else 0.0)
    if found is None or told.size < 3:
        return None
    start, end, done = found
    changed = told[1:][(np.abs(np.diff(speeds, axis=0)) > _CHANGE).any(axis=1)]
    if np.unique(np.searchsorted(np.linspace(start[0], end[-1], _BLOCKS + 1), changed)).size < _BLOCKS // 2:
        return None
    block = np.minimum(np.arange(start.size) * _BLOCKS // start.size, _BLOCKS - 1)
    coarse = np.arange(_RANGE[0], _RANGE[1] + _COARSE / 2, _COARSE)
    sums = _sums(coarse, told, speeds, start, end, done, block)
    near = float(coarse[np.argmin(np.log(_unexplained(sums.sum(axis=1))).sum(axis=-1))])
    fine = np.arange(near - 4.0 * _WINDOW, near + 4.0 * _WINDOW + _FINE / 2, _FINE)
    sums = _sums(fine, told, speeds, start, end, done, block)
    found_at = _centre(fine, sums)
    if found_at is None or not _RANGE[0] < found_at[0] < _RANGE[1]:
        return None
    delay, left_out, correlation = found_at
    error = np.sqrt((_BLOCKS - 1) / _BLOCKS * np.square(left_out - left_out.mean()).sum())
    half = float(stdtrit(_BLOCKS - 1, 0.975) * error) + _FINE + _SAMPLING * float(np.median(end - start))
    return Latency(delay, delay - half, delay + half, correlation) if half < _WIDEST else None


def _increments(poses: Series, first: float, last: float) -> tuple[Array, Array, Array] | None:
    """Begins, ends and changes [n, 2] of distance along the heading and of heading, while there are commands."""
    rows = np.flatnonzero((poses.time >= first) & (poses.time <= last))
    rows = rows[:: max(-(-rows.size // _MOST), 1)]
    if rows.size < _LEAST:
        return None
    time, pose = poses.time[rows], poses.values[rows]
    heading = np.unwrap(pose[:, 2])
    turn, (x, y) = np.diff(heading), np.diff(pose[:, :2], axis=0).T
    middle = heading[:-1] + 0.5 * turn
    every = np.diff(time)
    kept = (every > 0.0) & (every < _LONGEST)
    done = np.column_stack([x * np.cos(middle) + y * np.sin(middle), turn])
    return (time[:-1][kept], time[1:][kept], done[kept]) if kept.sum() >= _LEAST else None


def _sums(
    delays: Array, told: Array, speeds: Array, start: Array, end: Array, done: Array, block: NDArray[np.intp]
) -> Array:
    """Sums over each block that correlations are made of: [delays, blocks, channels, (n, u, y, uu, uy, yy)]."""
    total = np.vstack([np.zeros(2), np.cumsum(speeds[:-1] * np.diff(told)[:, None], axis=0)])
    found = np.zeros((delays.size, _BLOCKS, 2, 6))
    for k, delay in enumerate(delays):
        for channel in range(2):
            y = done[:, channel]
            u = _held(end - delay, told, total[:, channel], speeds[-1, channel]) - _held(
                start - delay, told, total[:, channel], speeds[-1, channel]
            )
            for column, values in enumerate((np.ones_like(u), u, y, u * u, u * y, y * y)):
                found[k, :, channel, column] = np.bincount(block, values, _BLOCKS)
    return found


def _held(time: Array, told: Array, total: Array, last: float) -> Array:
    """The integral of the commands up to times; the first is preceded by standing, the last goes on."""
    return np.interp(time, told, total) + last * np.maximum(time - told[-1], 0.0)


def _unexplained(sums: Array) -> Array:
    """Share of the motion's variance that a gain and an offset of the commands do not explain, 1 - r² [.., channels].

    It is 1 for a channel that is not moved, not told to move, or moves the other way.
    """
    n, u, y, uu, uy, yy = np.moveaxis(sums, -1, 0)
    n = np.maximum(n, 1.0)
    uu, uy, yy = uu - u * u / n, uy - u * y / n, yy - y * y / n
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where((uu > 1e-15 * n) & (yy > 1e-12 * n) & (uy > 0.0), uy * uy / (uu * yy), 0.0)
    return np.clip(1.0 - share, 1e-6, 1.0)


def _centre(delays: Array, sums: Array) -> tuple[float, Array, float] | None:
    """The delay, those with a block left out, and the correlation; None where there is no minimum.

    Around the best delay the misfit of all channels, each over its own least, is met by a parabola where it is at most
    twice its least: that is smooth in the data, where the minimum itself jumps from bend to bend.
    """
    whole = _unexplained(sums.sum(axis=1))
    best = int(np.argmin(np.log(whole).sum(axis=-1)))
    weights = (whole[best] < 1.0) / whole[best]
    correlation = float(np.sqrt(1.0 - whole[best].min()))
    if correlation < _CLEAR:
        return None
    misfit, delay = whole @ weights, float(delays[best])
    beyond = np.abs(delays - delay)[misfit > 2.0 * misfit[best]]
    width = float(np.clip(beyond.min(initial=_WINDOW), 3.0 * _FINE, _WINDOW))
    window = np.ones(delays.size, bool)
    for _ in range(4):
        window = np.abs(delays - delay) <= width
        vertex = _vertex(delays[window], misfit[window])
        if vertex is None:
            return None
        delay = vertex
    total = sums.sum(axis=1)
    parts = [_vertex(delays[window], (_unexplained(total - sums[:, k]) @ weights)[window]) for k in range(_BLOCKS)]
    return None if None in parts else (delay, np.array(parts, float), correlation)


def _vertex(delays: Array, misfit: Array) -> float | None:
    """Where the parabola through a misfit is least; None where that is not among the delays."""
    if delays.size < 5:
        return None
    middle = 0.5 * (delays[0] + delays[-1])
    curve, slope, _ = np.polyfit(delays - middle, misfit, 2)
    found = middle - slope / (2.0 * curve) if curve > 0.0 else np.inf
    return float(found) if delays[0] <= found <= delays[-1] else None
