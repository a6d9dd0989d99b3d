"""Which topics of a bag are the poses, the commands and the goals of which robot."""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from qocjax.recorded.bag import Bag, Topic
from qocjax.recorded.findings import Findings
from qocjax.recorded.messages import COMMANDS, FOOTPRINTS, GOALS, ODOMETRY, POSES, TRANSFORMS
from qocjax.recorded.patterns import matched
from qocjax.recorded.topics import TopicPatterns

__all__ = ["Choice", "choose", "nothing"]

_ROBOT = "robot"  # of a topic without a robot's name
_LOCALISATION = POSES[0]
_ENCODINGS = ("cdr", "")
Names = dict[str, str]
"""Name of a topic by robot."""


@dataclass
class Choice:
    """Names of the topics to read, by robot, and the topics of each name that can be read."""

    poses: Names = field(default_factory=dict)
    commands: Names = field(default_factory=dict)
    odometry: Names = field(default_factory=dict)  # beside other poses: they say better how far a robot drove
    transforms: Names = field(default_factory=dict)  # by namespace, where no topic has poses
    driven: Names = field(default_factory=dict)  # odometry of any robot, for its speeds
    footprints: Names = field(default_factory=dict)
    goals: Names = field(default_factory=dict)  # by name of the topic
    topics: dict[str, list[Topic]] = field(default_factory=dict)

    def readable(self, findings: Findings) -> list[Topic]:
        """The topics to read; of a transform's topic also its static half."""
        names = dict.fromkeys((
            *self.poses.values(), *self.commands.values(), *self.odometry.values(), *self.transforms.values(),
            *self.driven.values(), *self.footprints.values(), *self.goals,
        ))  # fmt: skip
        found = [topic for name in names for topic in self.topics.get(name, [])]
        for topic in found:
            if topic.publishers > 1 and topic.kind in (*POSES, *COMMANDS):
                findings.count(topic.name, "several_publishers", topic.publishers - 1)
        return found


def choose(bag: Bag, patterns: TopicPatterns, findings: Findings, without: Collection[str] = ()) -> Choice:
    """Chooses topics by name, type and pattern.

    Args:
        bag: An open bag.
        patterns: Which topics are whose; of the poses and of the commands the first that the bag has counts.
        findings: Takes remarks.
        without: Names of topics that turned out to hold nothing.
    """
    topics = [topic for topic in bag.topics if topic.name not in without]
    found = Choice()
    pick = _Picker(topics, patterns.only, findings, found.topics)
    found.poses = pick.first(patterns.poses, (*POSES, TRANSFORMS))
    found.commands = pick.first(patterns.commands, COMMANDS)
    found.transforms = {robot: name for robot, name in found.poses.items() if pick.holds(name, TRANSFORMS)}
    found.poses = {robot: name for robot, name in found.poses.items() if robot not in found.transforms}
    for name in list(found.transforms.values()):
        for topic in topics:
            if topic.name == f"{name}_static" and topic.kind == TRANSFORMS:
                found.transforms[topic.name] = topic.name
                found.topics[topic.name] = [topic]
    every = pick.all((*patterns.poses, *patterns.odometry), (ODOMETRY,))
    found.driven = {robot: name for robot, name in every.items() if not _above(robot, every)}
    found.footprints = pick.all(patterns.footprints, FOOTPRINTS)
    sparse = [robot for robot, name in found.poses.items() if pick.holds(name, _LOCALISATION)]
    if sparse:
        own = pick.all(patterns.poses, (ODOMETRY,))
        found.odometry = {robot: own[robot] for robot in sparse if robot in own}
    found.goals = pick.goals(patterns.goals)
    return found


def _above(robot: str, found: Names) -> str | None:
    """The robot in whose namespace another name lies."""
    return next((other for other in found if robot.startswith(f"{other}/")), None)


class _Picker:
    """Looks for topics by pattern and type, and says what fits one but not the other."""

    def __init__(
        self, topics: list[Topic], only: tuple[str, ...] | None, findings: Findings, kept: dict[str, list[Topic]]
    ) -> None:
        self._topics, self._only, self._findings, self._kept = topics, only, findings, kept

    def holds(self, name: str, kind: str) -> bool:
        return any(topic.kind == kind for topic in self._kept[name])

    def first(self, patterns: tuple[str, ...], kinds: tuple[str, ...]) -> Names:
        """Topics of the first pattern that matches any, and of robots that only later ones of its kind name."""
        found: Names = {}
        stem = ""
        for pattern in patterns:
            if not found or (stem and pattern.startswith(stem)):
                here = self._matching(pattern, kinds, quiet=bool(found))
                new = {robot: name for robot, name in here.items() if robot not in found}
                if not found:
                    stem = pattern.partition("}")[0] + "}/" if "{robot}/" in pattern else ""
                found |= new
        return dict(sorted(self._outermost(found).items()))

    def all(self, patterns: tuple[str, ...], kinds: tuple[str, ...]) -> Names:
        """Topics of any pattern, the first that names a robot."""
        found: Names = {}
        for pattern in patterns:
            found = self._matching(pattern, kinds, quiet=True) | found
        return found

    def goals(self, patterns: tuple[str, ...]) -> Names:
        """Robots by topic; the empty name for a topic of all robots."""
        found: Names = {}
        for pattern in patterns:
            for topic in self._topics:
                place = matched(pattern, topic.name, deep=True)
                if place is not None and topic.kind in GOALS and topic.encoding in _ENCODINGS and topic.count != 0:
                    found.setdefault(topic.name, place.get("robot", ""))
                    self._kept.setdefault(topic.name, [topic])
        return found

    def _matching(self, pattern: str, kinds: tuple[str, ...], quiet: bool) -> Names:
        found: dict[str, list[Topic]] = {}
        robots: Names = {}
        for topic in self._topics:
            place = matched(pattern, topic.name, deep=True)
            if place is None:
                continue
            robot = place.get("robot", _ROBOT)
            reason = self._reason(topic, robot, kinds)
            if reason is None:
                found.setdefault(topic.name, []).append(topic)
                robots[robot] = topic.name
            elif not quiet:
                self._findings.note(f"{topic.name}: {reason}")
        self._kept.update(found)
        return robots

    def _reason(self, topic: Topic, robot: str, kinds: tuple[str, ...]) -> str | None:
        """Why a topic is not read."""
        if topic.kind not in kinds:
            return f"is of type {topic.kind}, expected one of {', '.join(kinds)}"
        if topic.encoding not in _ENCODINGS:
            return f"is in the encoding {topic.encoding}, expected cdr"
        if self._only is not None and not any(fnmatch.fnmatchcase(robot, name) for name in self._only):
            return f"is of {robot}, which is none of the robots wanted; left out"
        return "has no message" if topic.count == 0 else None

    def _outermost(self, found: Names) -> Names:
        """Without topics deeper in the namespace of a robot that has one: those are its sensors'."""
        kept = {}
        for robot, name in found.items():
            above = _above(robot, found)
            if above is None:
                kept[robot] = name
            else:
                self._findings.note(f"{name}: lies within the namespace of {above}, which has {found[above]}; left out")
        return kept


def nothing(path: Path, topics: Iterable[Topic], patterns: TopicPatterns) -> str:
    """What to say where no topic fits."""
    here = ", ".join(f"{topic.name} ({topic.kind.split('/')[-1]})" for topic in topics) or "none"
    return (
        f"{path}: no topic is one of topics.poses {list(patterns.poses)} or topics.commands {list(patterns.commands)}; "
        f"its topics are {here}"
    )
