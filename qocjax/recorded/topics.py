"""Names of topics, and what is read of a bag or of a table of poses."""

from __future__ import annotations

import fnmatch
from dataclasses import dataclass, field
from pathlib import Path

from qocjax.recorded.findings import Findings
from qocjax.recorded.footprint import Outline
from qocjax.recorded.goals import Goal
from qocjax.recorded.messages import COMMANDS
from qocjax.recorded.pose_tables import PosesFormat, read_poses
from qocjax.recorded.series import Raw

__all__ = ["BagContent", "TopicPatterns", "read_pose_table"]

_PLAIN_TWIST = COMMANDS[0]


@dataclass(frozen=True)
class TopicPatterns:
    """Topics by name, `{robot}` in the place of the robot's name; the first pattern that a bag has is taken."""

    poses: tuple[str, ...]
    commands: tuple[str, ...]
    goals: tuple[str, ...] = ()
    only: tuple[str, ...] | None = None  # robots wanted, by name with * and ?
    odometry: tuple[str, ...] = ()  # whose speeds count beside those among the poses
    footprints: tuple[str, ...] = ()


@dataclass(frozen=True)
class BagContent:
    """Poses and commands of each robot, as read."""

    begin: int  # ns, record time of the first message read
    end: int  # ns
    poses: dict[str, Raw]
    commands: dict[str, Raw]
    topics: dict[str, tuple[str, str]]  # of poses and of commands, by robot
    qos: dict[str, str]  # offered, by topic
    odometry: dict[str, Raw] = field(default_factory=dict)  # of robots whose poses are others
    goals: dict[str, Goal] = field(default_factory=dict)  # by robot; that of all robots under the empty name
    driven: dict[str, Raw] = field(default_factory=dict)  # odometry of any robot, for its speeds
    footprints: dict[str, list[Outline]] = field(default_factory=dict)  # by robot


def read_pose_table(
    path: Path, findings: Findings, only: tuple[str, ...] | None, layout: PosesFormat | None = None
) -> BagContent:
    """Reads poses from a table with the columns time (s), robot, x, y (m) and, if there, heading (rad), or as `layout`.

    Columns nu and omega are commands, one at each row that has both; so a simulated run's own table can be read.

    Raises:
        ValueError: A column or number is not as expected.
    """
    table = read_poses(path, layout or PosesFormat())
    first = table["time"].min()
    poses, commands = {}, {}
    for robot, rows in table.groupby("robot", sort=True):
        name = str(robot)
        if only is not None and not any(fnmatch.fnmatchcase(name, each) for each in only):
            findings.count(path.name, "excluded", len(rows))
            continue
        time = ((rows["time"] - first) * 1e9).round().astype("int64").to_numpy()
        poses[name] = Raw("table")
        poses[name].record.extend(time)
        poses[name].stamp.extend([0] * time.size)
        poses[name].values.extend(rows[["x", "y", "heading"]].to_numpy().ravel())
        given = rows[["nu", "omega"]].notna().all(axis=1).to_numpy()
        if given.any():
            commands[name] = Raw(_PLAIN_TWIST)
            commands[name].record.extend(time[given])
            commands[name].stamp.extend([0] * int(given.sum()))
            commands[name].values.extend(rows.loc[given, ["nu", "omega"]].assign(zero=0.0).to_numpy().ravel())
    if not poses:
        raise ValueError(f"{path}: holds no pose of the robots wanted")
    span = round(float(table["time"].max() - first) * 1e9)
    return BagContent(0, span, poses, commands, {name: (path.name, "") for name in poses}, {})
