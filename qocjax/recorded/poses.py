"""From clean poses of each robot to a judged run: in which frame, from when to when (model, sections 5 and 10)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from qocjax.recorded.commands import gaps
from qocjax.recorded.findings import Findings
from qocjax.recorded.goals import Goal, chosen_goal, in_own_frame
from qocjax.recorded.judge import Quality, Yardstick, judge, path_length
from qocjax.recorded.series import Cleaning, Series

__all__ = ["BEGINNINGS", "quality"]

Array = NDArray[np.float64]

BEGINNINGS = ("first", "motion", "command")
_MOVED = 0.05  # m, from where on a robot counts as moving
_SPARSE = 3.0  # times the interval of odometry


def quality(
    series: dict[str, Series],
    yardstick: Yardstick,
    cleaning: Cleaning,
    findings: Findings,
    command: float | None,
    odometry: dict[str, Series] | None = None,
    goals: dict[str, Goal] | None = None,
) -> Quality | None:
    """Judges the robots' poses; None where they were never seen together.

    Poses are joined by straight lines. The squared disagreement is integrated exactly for these and a reference that is
    straight between two instants, so the error is that of the polygon: at 20 Hz and 0.2 m/s some 1e-4.

    Args:
        series: Clean poses by robot.
        yardstick: Goal, reference and normaliser.
        cleaning: What counts as gap and jump.
        findings: Takes counts and remarks.
        command: Time of the first command (s), where there is one.
        odometry: Of robots whose poses are of another kind; where that is denser it says how far they drove.
        goals: That the recording has, by robot, or for all under the empty name.

    Raises:
        ValueError: A value of the yardstick is out of range.
    """
    robots = tuple(series)
    for name, each in series.items():
        _look_at(name, each, cleaning, findings)
    shared = len(robots) == 1 or _share_frame(series, yardstick, findings)
    paths = [_placed(name, each, yardstick) for name, each in series.items()]
    times = [each.time for each in series.values()]
    begin, end = _window(times, paths, yardstick, findings, command)
    if not end > begin:
        findings.note("no quality: the robots' poses do not overlap in time")
        return None
    instants = np.unique(np.concatenate([t[(t > begin) & (t < end)] for t in times] + [[begin, end]]))
    pose = np.stack([_at(instants, t, path) for t, path in zip(times, paths, strict=True)], axis=1)
    goal = chosen_goal(series, pose, instants, yardstick, shared, goals or {}, findings)
    driven = np.array([
        _driven(name, each, (odometry or {}).get(name), pose[:, k, :2], (begin, end), yardstick, findings)
        for k, (name, each) in enumerate(series.items())
    ])  # fmt: skip
    return judge(robots, instants - begin, pose, begin, yardstick, shared, goal, driven, findings)


def _driven(
    name: str,
    poses: Series,
    odometry: Series | None,
    points: Array,
    window: tuple[float, float],
    yardstick: Yardstick,
    findings: Findings,
) -> float:
    """How far a robot drove: by its poses, or by its odometry where poses are seldom, and jump as localisation does."""
    if odometry is not None and odometry.time.size > 1:
        usual = [float(np.median(np.diff(each.time))) for each in (poses, odometry)]
        inside = (odometry.time >= window[0]) & (odometry.time <= window[1])
        if usual[0] > _SPARSE * usual[1] and inside.sum() > 1:
            findings.note(
                f"{name}: its poses come every {usual[0]:.3g} s, so its path length is that of its odometry "
                f"(every {usual[1]:.3g} s)"
            )
            return path_length(odometry.values[inside, :2], yardstick.path_resolution)
    return path_length(points, yardstick.path_resolution)


def _look_at(name: str, series: Series, cleaning: Cleaning, findings: Findings) -> None:
    """Counts gaps and jumps of a robot's poses."""
    findings.count(f"poses of {name}", "gaps", int(gaps(series.time, cleaning)[1].sum()))
    moved = np.hypot(*np.diff(series.values[:, :2], axis=0).T)
    too_far = (moved > cleaning.max_speed * np.diff(series.time)) & (moved > 0.1)
    findings.count(f"poses of {name}", "jumps", int(too_far.sum()))


def _share_frame(series: dict[str, Series], yardstick: Yardstick, findings: Findings) -> bool:
    """Whether positions of different robots can be compared."""
    starts = yardstick.starts or {}
    own = [name for name, each in series.items() if in_own_frame(each) and name not in starts]
    frames = {name: each.frame.strip("/") for name, each in series.items()}
    if not own and len(set(frames.values())) > 1 and not starts:
        own = list(frames)
    if own:
        findings.note(
            f"{', '.join(own)}: poses in frames of their own, as odometry is; each robot is judged on its own, and no "
            "distance between robots is given (quality.starts puts them into one frame)"
        )
    return not own


def _placed(name: str, series: Series, yardstick: Yardstick) -> Array:
    """Poses with a continuous heading, moved to where the robot started if that is given."""
    pose = series.values.copy()
    pose[:, 2] = np.unwrap(pose[:, 2])
    start = (yardstick.starts or {}).get(name)
    if start is None:
        return pose
    x, y, heading = start
    turn = heading - pose[0, 2]
    along = pose[:, :2] - pose[0, :2]
    turned = along @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return np.column_stack([turned + (x, y), pose[:, 2] + turn])


def _window(
    times: list[Array], paths: list[Array], yardstick: Yardstick, findings: Findings, command: float | None
) -> tuple[float, float]:
    """When a run begins and ends, on the recorder's clock."""
    first, end = max(t[0] for t in times), min(t[-1] for t in times)
    begin = first
    if yardstick.begin == "command":
        if command is None:
            findings.note("begin: there is no command; the run begins with the first pose of all")
        begin = max(first, command if command is not None else first)
    elif yardstick.begin == "motion":
        moving = [np.flatnonzero(np.hypot(*(path[:, :2] - path[0, :2]).T) > _MOVED) for path in paths]
        begun = [t[rows[0]] for t, rows in zip(times, moving, strict=True) if rows.size]
        if not begun:
            findings.note(f"begin: no robot moves by {_MOVED} m; the run begins with the first pose of all")
        begin = max([first, min(begun, default=first)])
    elif isinstance(yardstick.begin, (int, float)):
        begin = first + yardstick.begin
    if yardstick.horizon is not None:
        if end - begin < yardstick.horizon - 1e-6:
            findings.note(f"horizon: the run lasts {end - begin:.4g} s, expected {yardstick.horizon:g} s")
        end = min(end, begin + yardstick.horizon)
    return float(begin), float(end)


def _at(instants: Array, time: Array, path: Array) -> Array:
    return np.stack([np.interp(instants, time, path[:, k]) for k in range(3)], axis=1)
