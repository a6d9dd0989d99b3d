"""The messages of a bag as numbers: poses and commands of each robot, and where it was sent."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from tqdm import tqdm

from qocjax.recorded.bag import Bag, Topic
from qocjax.recorded.bags import open_bag
from qocjax.recorded.choice import Choice, choose, nothing
from qocjax.recorded.findings import Findings
from qocjax.recorded.footprint import Outline
from qocjax.recorded.goals import Goal, goal_of
from qocjax.recorded.messages import COMMANDS, FOOTPRINTS, TRANSFORMS, Row, decoder, polygon, transforms
from qocjax.recorded.record_clock import mend
from qocjax.recorded.series import Raw
from qocjax.recorded.topics import BagContent, TopicPatterns
from qocjax.recorded.transforms import Transforms, poses_of

__all__ = ["read_bag"]

_OTHERS = (TRANSFORMS, *FOOTPRINTS)  # types that are no rows of numbers
_LATEST = 2**62  # ns; a record time beyond is no time, and is mended as one


def read_bag(path: Path, patterns: TopicPatterns, findings: Findings, *, quiet: bool = False) -> BagContent:
    """Reads poses, speeds, commands, footprints and goals of a bag; other topics are never decoded.

    Memory holds one message, and 48 bytes of each that was read, 64 of odometry.

    Args:
        path: rosbag2 folder or file.
        patterns: Which topics.
        findings: Takes counts and remarks.
        quiet: No progress bar (there is none anyway where standard error is no terminal).

    Raises:
        ValueError: There is no bag, or no topic in it has poses or commands.
    """
    with open_bag(path, findings) as bag:
        empty: set[str] = set()
        while True:
            chosen = choose(bag, patterns, findings, empty)
            wanted = chosen.readable(findings)
            if not chosen.poses and not chosen.commands and not chosen.transforms:
                raise ValueError(_unread(path, empty) if empty else nothing(path, bag.topics, patterns))
            raws, moving, outlines = _messages(bag, wanted, findings, quiet)
            fruitless = {name for name, raw in raws.items() if not raw.record and name in chosen.poses.values()}
            if not fruitless:
                break
            empty |= fruitless  # another topic may have the poses
    found = _content(path, chosen, wanted, raws, moving, findings)
    shapes = {robot: outlines[name] for robot, name in chosen.footprints.items() if outlines.get(name)}
    driven = {robot: raws[name] for robot, name in chosen.driven.items() if raws[name].record}
    return replace(found, driven=driven, footprints=shapes)


def _unread(path: Path, names: set[str]) -> str:
    return f"{path}: holds no message that can be read of {', '.join(sorted(names))}"


def _content(
    path: Path, chosen: Choice, wanted: list[Topic], raws: dict[str, Raw], moving: dict[str, Transforms],
    findings: Findings,
) -> BagContent:  # fmt: skip
    """What was read, by robot."""
    places = {robot: name for robot, name in chosen.poses.items() if raws[name].record}
    poses = {robot: raws[name] for robot, name in places.items()}
    for robot, name in chosen.transforms.items():
        if name in moving and not name.endswith("_static"):
            together = Transforms({**moving.get(f"{name}_static", Transforms({})).raws, **moving[name].raws})
            for each, raw in poses_of("" if robot == "robot" else robot, together, name, findings).items():
                poses[each], places[each] = raw, name
    commands = {robot: name for robot, name in chosen.commands.items() if raws[name].record}
    mend({id(raw): raw for raw in (*poses.values(), *raws.values())}.values(), findings)
    found = [*poses.values(), *(raws[name] for name in commands.values())]
    if not found:
        raise ValueError(_unread(path, {topic.name for topic in wanted}))
    goals: dict[str, Goal] = {}
    for name, robot in chosen.goals.items():
        goal = goal_of(raws[name], name, findings)
        if goal is not None:
            goals.setdefault(robot, goal)
    return BagContent(
        min(min(raw.record) for raw in found), max(max(raw.record) for raw in found), poses,
        {robot: raws[name] for robot, name in commands.items()},
        {robot: (places.get(robot, ""), commands.get(robot, "")) for robot in dict.fromkeys([*places, *commands])},
        {topic.name: topic.qos for topic in wanted if topic.name in (*places.values(), *commands.values())},
        {robot: raws[name] for robot, name in chosen.odometry.items() if robot in poses and raws[name].record},
        goals,
    )  # fmt: skip


def _messages(
    bag: Bag, wanted: list[Topic], findings: Findings, quiet: bool
) -> tuple[dict[str, Raw], dict[str, Transforms], dict[str, list[Outline]]]:
    """Decodes the messages of the topics wanted."""
    read: dict[Topic, Callable[[bytes], Row]] = {t: decoder(t.kind) for t in wanted if t.kind not in _OTHERS}
    raws, moving = _empty(wanted)
    outlines: dict[str, list[Outline]] = {topic.name: [] for topic in wanted if topic.kind in FOOTPRINTS}
    counts = [topic.count for topic in wanted]
    total = None if None in counts else sum(count or 0 for count in counts)
    bar = tqdm(
        bag.messages(wanted), total=total, desc=f"reading {bag.path.name}", unit=" messages", unit_scale=True,
        file=sys.stderr, disable=True if quiet else None,
    )  # fmt: skip
    for place, (topic, time, data) in enumerate(bar):
        record = min(max(time, 0), _LATEST)
        try:
            if topic.kind == TRANSFORMS:
                for each in transforms(data):
                    moving[topic.name].add(place, record, each)
                continue
            if topic.kind in FOOTPRINTS:
                outlines[topic.name].append(Outline(*polygon(topic.kind, data)))
                continue
            stamp, values, frame = read[topic](data)
        except ValueError as error:
            findings.count(topic.name, "unreadable")
            findings.note(f"{topic.name}: {error}")
            continue
        raw = raws[topic.name]
        raw.append(place, record, stamp, values)
        if frame != raw.frame:
            raw.frame = raw.frame or frame
            raw.frames.add(frame)
    for name, raw in raws.items():
        _say_frames(name, raw, findings)
    return raws, moving, outlines


def _empty(wanted: list[Topic]) -> tuple[dict[str, Raw], dict[str, Transforms]]:
    """Where messages go; commands of both types on one topic into the one that has stamps."""
    raws: dict[str, Raw] = {}
    for topic in wanted:
        if topic.kind not in _OTHERS and raws.setdefault(topic.name, Raw(topic.kind)).kind == COMMANDS[0]:
            raws[topic.name].kind = topic.kind
    return raws, {topic.name: Transforms({}) for topic in wanted if topic.kind == TRANSFORMS}


def _say_frames(name: str, raw: Raw, findings: Findings) -> None:
    frames = sorted(raw.frames)
    if len(frames) > 1 and raw.kind not in COMMANDS:
        findings.count(name, "several_publishers", len(frames) - 1)
        findings.note(
            f"{name}: has messages in {len(frames)} frames ({', '.join(frames[:4])}), as of as many publishers"
        )
