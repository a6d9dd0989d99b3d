"""Where robots were sent, as a bag tells: goals as such, the ends of plans, and goals of Nav2's action."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qocjax.recorded.findings import Findings
from qocjax.recorded.judge import Yardstick
from qocjax.recorded.messages import POSES, TRANSFORMS
from qocjax.recorded.series import Raw, Series

__all__ = ["Goal", "chosen_goal", "goal_of", "in_own_frame"]

_APART = 0.1  # m, from where on two goals are two


@dataclass(frozen=True)
class Goal:
    """A position that a robot was sent to."""

    x: float  # m
    y: float  # m
    frame: str
    topic: str


def goal_of(raw: Raw, topic: str, findings: Findings) -> Goal | None:
    """The last goal that a topic has; None where it has none.

    Args:
        raw: Its messages.
        topic: Its name.
        findings: Takes a remark where there are several goals.
    """
    values = np.frombuffer(raw.values, np.float64).reshape(-1, 3)[:, :2]
    values = values[np.isfinite(values).all(axis=1)]
    if not len(values):
        return None
    x, y = map(float, values[-1])
    others = 1 + int((np.hypot(*np.diff(values, axis=0).T) > _APART).sum()) if len(values) > 1 else 1
    if others > 1:
        findings.note(
            f"{topic}: has {others} goals; the run is judged by the last one ({x:.3f} {y:.3f}), which quality.goal, "
            "quality.begin and quality.horizon can change"
        )
    return Goal(x, y, raw.frame, topic) if math.isfinite(x + y) else None


def in_own_frame(series: Series) -> bool:
    """Whether poses are in a frame that begins where the robot was switched on."""
    odometric = series.kind == TRANSFORMS and series.frame.rpartition("/")[2].endswith("odom")
    return odometric or series.kind == POSES[1]


def chosen_goal(
    series: dict[str, Series],
    pose: NDArray[np.float64],
    time: NDArray[np.float64],
    yardstick: Yardstick,
    shared: bool,
    goals: dict[str, Goal],
    findings: Findings,
) -> NDArray[np.float64] | None:
    """The goal that is asked for, or the recording's own.

    Args:
        series: Poses by robot.
        pose: [K, N, 3], the same on common instants.
        time: [K] s.
        yardstick: What is asked for.
        shared: Whether the robots are in one frame.
        goals: Of the recording.
        findings: Takes a remark where there is none.

    Returns:
        [2], or [N, 2] for one a robot; None where there is none.
    """
    if yardstick.goal == "end":
        last = pose[time >= time[-1] - yardstick.end][..., :2].mean(axis=0)
        return last if not shared or yardstick.per_robot else last.mean(axis=0)
    if yardstick.goal is not None:
        return np.asarray(yardstick.goal, float)
    found = [goals.get(name, goals.get("")) for name in series]
    for name, each, goal in zip(series, series.values(), found, strict=True):
        placed = name in (yardstick.starts or {})
        if goal is not None and not placed and goal.frame.strip("/") != each.frame.strip("/"):
            findings.note(
                f"no AUC: the goal of {goal.topic} is in the frame {goal.frame!r} and the poses of {name} are in "
                f"{each.frame!r}; quality.goal=[x,y] gives one in theirs"
            )
            return None
    given = [(goal.x, goal.y) for goal in found if goal is not None]
    if len(given) < len(found):
        findings.note("no AUC: no goal is given, and the recording has none for each robot; quality.goal=[x,y] gives "
                      "one, quality.goal=end takes where the robots end")  # fmt: skip
        return None
    topics = ", ".join(dict.fromkeys(goal.topic for goal in found if goal is not None))
    findings.note(f"the goal is that of {topics}")
    return np.array(given[0] if len(set(given)) == 1 and shared else given)
