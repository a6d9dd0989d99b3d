"""Runs of the policies as the replay plays them: whole numbers, sampled often enough for the eye."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from qocjax.figures.style import OKABE_ITO, sequence
from qocjax.report.hall import HallMap
from qocjax.single import Run

__all__ = ["Replay", "hold_times", "replay_data"]

_FRAME = 0.05  # s, between two frames; less often where the loop is slower, or the robots are many
_MOST_SAMPLES = 120_000  # robots x frames of all runs: about 2 MB
_STEP = 0.5  # of a sampling period, that rounding may be off by


@dataclass(frozen=True)
class Replay:
    """One policy's choice in one sweep, and a run of it."""

    sweep: str
    policy: str
    values: Mapping[str, float]  # of what the sweep varies, by parameter
    deadline: float  # s
    reliability: float
    tau: float  # s
    run: Run
    group: str = ""  # what is shown together, in words; empty for the runs of one sweep

    @property
    def chosen_by(self) -> str:
        """What a reader chooses it by."""
        return self.group or self.sweep


def replay_data(replays: Sequence[Replay], hall: HallMap | None = None) -> dict[str, Any]:
    """What the script needs: the hall, and each run in mm, mrad and ms, as differences from frame to frame.

    Runs of equally many robots share what is shown of the floor.
    """
    frame = _FRAME
    while sum(_robots(each) * (each.run.time[-1] / max(frame, each.tau) + 2) for each in replays) > _MOST_SAMPLES:
        frame *= 2
    fleets = {count: [each for each in replays if _robots(each) == count] for count in map(_robots, replays)}
    shown = {count: {"box": _box(some, hall), "colours": _colours(count)} for count, some in fleets.items()}
    data: dict[str, Any] = {
        "radius": float(replays[0].run.robot_radius),
        "end": float(replays[0].run.time[-1]),
        "runs": [_run_data(each, frame) | shown[_robots(each)] for each in replays],
    }
    if hall is not None:
        picture = base64.b64encode(hall.png).decode("ascii")
        data["map"] = {"png": f"data:image/png;base64,{picture}", "extent": list(hall.extent)}
    return data


def hold_times(run: Run, tau: float) -> tuple[np.ndarray, np.ndarray]:
    """Since when the command in force is held, [P, N] (s), and whether the first has yet to come, [P, N].

    A command took effect since the instant before wherever the age did not grow by a whole sampling period.
    """
    age, command = np.asarray(run.age, np.float64), np.asarray(run.command)
    instants = tau * np.arange(age.shape[0])[:, None]
    moving = np.any(command != 0, axis=-1)
    waiting = ~np.logical_or.accumulate(moving, axis=0) & (age >= instants - _STEP * tau)
    begun = ~waiting & np.vstack([waiting[:1], waiting[:-1]])  # by the first command, whatever its age
    fresh = np.vstack([age[:1] < _STEP * tau, np.diff(age, axis=0) < _STEP * tau]) | waiting | begun
    last = np.maximum.accumulate(np.where(fresh, instants, 0.0), axis=0)
    return instants - last, waiting


def _run_data(each: Replay, frame: float) -> dict[str, Any]:
    run, ticks = each.run, each.run.age.shape[0]
    stride = max(1, round(frame / each.tau))
    at = np.unique(np.append(np.arange(0, ticks, stride), ticks))
    before = np.minimum(at, ticks - 1)  # age and hold are known at sampling instants only
    held, waiting = hold_times(run, each.tau)
    pose = np.nan_to_num(np.asarray(run.pose, np.float64)[at], posinf=0.0, neginf=0.0)
    reference = np.asarray(run.reference, np.float64)[at]
    reference = reference if reference.ndim == 3 else reference[:, None]
    goals = np.unique(np.atleast_2d(np.asarray(run.goal, np.float64)), axis=0)
    return {
        "policy": each.policy,
        "dt": stride * each.tau,
        "deadline": each.deadline,
        "safe": float(run.d_safe),
        "x": _steps(pose[..., 0], 1e3), "y": _steps(pose[..., 1], 1e3), "heading": _steps(pose[..., 2], 1e3),
        "age": _steps(np.asarray(run.age, np.float64)[before], 1e3), "held": _steps(held[before], 1e3),
        "waiting": waiting[before].sum(axis=0), "goals": goals,
        "rx": _steps(reference[..., 0], 1e3), "ry": _steps(reference[..., 1], 1e3),
    }  # fmt: skip


def _steps(values: np.ndarray, scale: float) -> list[list[int]]:
    """Per robot the first value and the differences, as whole numbers of `1 / scale`."""
    whole = np.rint(np.clip(scale * values, -2e9, 2e9)).astype(np.int64)
    return np.diff(whole, axis=0, prepend=0).T.tolist()


def _box(replays: Sequence[Replay], hall: HallMap | None) -> list[float]:
    """Left, right, bottom, top of what is shown (m): all paths and the hall, as far as they lie around the task."""
    runs = [each.run for each in replays]
    ends = [np.reshape(part, (-1, 2)) for run in runs for part in (run.pose[0, :, :2], run.goal, run.reference)]
    core = np.concatenate(ends)
    low, high = core.min(axis=0), core.max(axis=0)
    room = 0.6 * max(float((high - low).max()), 1.0)  # a robot that drives away does not make all others small
    paths = np.concatenate([np.reshape(run.pose[..., :2], (-1, 2)) for run in runs])
    paths = paths[np.isfinite(paths).all(axis=1)]
    if hall is not None:
        paths = np.concatenate([paths, np.reshape(hall.extent, (2, 2)).T])
    margin = 0.5 * max(float(run.d_safe) for run in runs) + 0.1
    low = np.maximum(paths.min(axis=0), low - room) - margin
    high = np.minimum(paths.max(axis=0), high + room) + margin
    return [float(low[0]), float(high[0]), float(low[1]), float(high[1])]


def _robots(each: Replay) -> int:
    return each.run.pose.shape[1]


def _colours(robots: int) -> list[str]:
    colours = OKABE_ITO if robots <= len(OKABE_ITO) else sequence(robots)
    return [_hex(colour) for colour in colours[:robots]]


def _hex(colour: Any) -> str:
    if isinstance(colour, str):
        return colour
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour[:3])
