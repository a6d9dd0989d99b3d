"""Which topics of a bag are the poses and commands of which robot, and their messages as numbers."""

from __future__ import annotations

import fnmatch
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from qocjax.recorded.bags import Bag, Topic, open_bag
from qocjax.recorded.findings import Findings
from qocjax.recorded.messages import COMMANDS, POSES, decoder
from qocjax.recorded.patterns import matched
from qocjax.recorded.pose_tables import PosesFormat, read_poses
from qocjax.recorded.series import Raw

__all__ = ["BagContent", "TopicPatterns", "read_bag", "read_pose_table"]

_PLAIN_TWIST = COMMANDS[0]


@dataclass(frozen=True)
class TopicPatterns:
    """Topics by name, `{robot}` in the place of the robot's name; the first pattern that a bag has is taken."""

    poses: tuple[str, ...]
    commands: tuple[str, ...]
    only: tuple[str, ...] | None = None  # robots wanted, by name with * and ?


@dataclass(frozen=True)
class BagContent:
    """Poses and commands of each robot, as read."""

    begin: int  # ns, record time of the first message read
    end: int  # ns
    poses: dict[str, Raw]
    commands: dict[str, Raw]
    topics: dict[str, tuple[str, str]]  # of poses and of commands, by robot
    qos: dict[str, str]  # offered, by topic


def read_bag(path: Path, patterns: TopicPatterns, findings: Findings, *, quiet: bool = False) -> BagContent:
    """Reads poses and commands of a bag; other topics are never decoded.

    Memory holds one message, and 40 bytes of each that was read.

    Args:
        path: rosbag2 folder or file.
        patterns: Which topics.
        findings: Takes counts and remarks.
        quiet: No progress bar (there is none anyway where standard error is no terminal).

    Raises:
        ValueError: There is no bag, or no topic in it has poses.
    """
    with open_bag(path, findings) as bag:
        poses = _chosen(bag, patterns.poses, POSES, patterns.only, findings)
        commands = _chosen(bag, patterns.commands, COMMANDS, patterns.only, findings)
        if not poses and not commands:
            raise ValueError(_nothing(path, bag.topics.values(), patterns))
        wanted = {topic.name: topic for topic in (*poses.values(), *commands.values())}
        raws = _messages(bag, wanted, findings, quiet)
    found = [raw for raw in raws.values() if len(raw.record)]
    if not found:
        raise ValueError(f"{path}: holds no message that can be read of {', '.join(wanted)}")
    begin, end = min(min(raw.record) for raw in found), max(max(raw.record) for raw in found)
    return BagContent(
        begin, end,
        {name: raws[topic.name] for name, topic in poses.items() if len(raws[topic.name].record)},
        {name: raws[topic.name] for name, topic in commands.items() if len(raws[topic.name].record)},
        {name: (poses[name].name if name in poses else "", commands[name].name if name in commands else "")
         for name in (*poses, *(name for name in commands if name not in poses))},
        {name: topic.qos for name, topic in wanted.items()},
    )  # fmt: skip


def _chosen(
    bag: Bag, patterns: tuple[str, ...], kinds: tuple[str, ...], only: tuple[str, ...] | None, findings: Findings
) -> dict[str, Topic]:
    """Topics by robot, those of the first pattern that matches any."""
    for pattern in patterns:
        found = {}
        for topic in bag.topics.values():
            place = matched(pattern, topic.name)
            if place is None:
                continue
            robot = place.get("robot", "robot")
            if topic.kind not in kinds:
                findings.note(f"{topic.name}: is of type {topic.kind}, expected one of {', '.join(kinds)}")
            elif only is not None and not any(fnmatch.fnmatchcase(robot, name) for name in only):
                findings.note(f"{topic.name}: is of {robot}, which is none of the robots wanted; left out")
            elif topic.count == 0:
                findings.note(f"{topic.name}: has no message")
            else:
                found[robot] = topic
        if found:
            return dict(sorted(found.items()))
    return {}


def _nothing(path: Path, topics: Iterable[Topic], patterns: TopicPatterns) -> str:
    here = ", ".join(f"{topic.name} ({topic.kind.split('/')[-1]})" for topic in topics) or "none"
    return (
        f"{path}: no topic is one of topics.poses {list(patterns.poses)} or topics.commands {list(patterns.commands)}; "
        f"its topics are {here}"
    )


def _messages(bag: Bag, wanted: dict[str, Topic], findings: Findings, quiet: bool) -> dict[str, Raw]:
    """Decodes the messages of the topics wanted."""
    read = {name: decoder(topic.kind) for name, topic in wanted.items()}
    raws = {name: Raw(topic.kind) for name, topic in wanted.items()}
    counts = [topic.count for topic in wanted.values()]
    total = None if None in counts else sum(count or 0 for count in counts)
    seen = dict.fromkeys(wanted, 0)
    bar = tqdm(
        bag.messages(wanted.keys()), total=total, desc=f"reading {bag.path.name}", unit=" messages", unit_scale=True,
        file=sys.stderr, disable=True if quiet else None,
    )  # fmt: skip
    for name, time, data in bar:
        seen[name] += 1
        try:
            stamp, x, y, z, frame = read[name](data)
        except ValueError as error:
            findings.count(name, "unreadable")
            findings.note(f"{name}: {error}")
            continue
        raws[name].append(time, stamp, (x, y, z))
        raws[name].frame = raws[name].frame or frame
    for name, topic in wanted.items():
        findings.count(name, "missing_messages", max((topic.count or 0) - seen[name], 0))
    return raws


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
