"""Poses of robots out of transforms alone: map → odom → base, as /tf has them."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qocjax.recorded.findings import Findings
from qocjax.recorded.messages import TRANSFORMS
from qocjax.recorded.series import Raw

__all__ = ["Transforms", "poses_of"]

_BASE = re.compile(r"(?:(?P<robot>.+)[/_])?base_(?:footprint|link)")
_LONGEST = 16  # transforms between a robot and the map

Array = NDArray[np.float64]


@dataclass
class Transforms:
    """Transforms of one namespace: what was read, by child frame and parent frame."""

    raws: dict[str, dict[str, Raw]]

    def add(self, place: int, record: int, each: tuple[str, str, int, float, float, float]) -> None:
        """Adds one."""
        parent, child, stamp, *values = each
        raw = self.raws.setdefault(child, {}).setdefault(parent, Raw(TRANSFORMS))
        raw.append(place, record, stamp, (values[0], values[1], values[2]))


def poses_of(namespace: str, transforms: Transforms, topic: str, findings: Findings) -> dict[str, Raw]:
    """Poses of the robots in a namespace, each in the outermost frame that its base hangs on.

    The pose has the stamps of the transform that moves most often; the others are those of that time, joined by
    straight lines and held beyond their ends.

    Args:
        namespace: Name of the robot; empty where the frames name the robots, or there is one.
        transforms: What was read.
        topic: For remarks.
        findings: Takes remarks.
    """
    tree = {
        child: max(parents.items(), key=lambda each: len(each[1].record)) for child, parents in transforms.raws.items()
    }
    for child, parents in transforms.raws.items():
        if len(parents) > 1:
            findings.count(f"{topic}, {child}", "several_publishers", len(parents) - 1)
    found: dict[str, tuple[int, Raw]] = {}
    for frame in tree:
        place = _BASE.fullmatch(frame)
        if place is None:
            continue
        robot = namespace or place["robot"] or "robot"
        pose, moves = _chain(frame, tree)
        if moves > found.get(robot, (0, None))[0]:
            found[robot] = (moves, pose)
    if not found:
        frames = ", ".join(sorted(tree)) or "none"
        findings.note(f"{topic}: no frame is a base_link or base_footprint; its frames are {frames}")
    return {robot: pose for robot, (_, pose) in sorted(found.items())}


def _chain(frame: str, tree: dict[str, tuple[str, Raw]]) -> tuple[Raw, int]:
    """The pose of a frame in the outermost one, and how many moving transforms are between."""
    links: list[Raw] = []
    while frame in tree and len(links) < _LONGEST:
        frame, raw = tree[frame]
        links.append(raw)
    lead = max(links, key=lambda raw: len(raw.record))
    time = np.frombuffer(lead.stamp, np.int64)
    pose = np.zeros((time.size, 3))
    for raw in links:
        pose = _after(_at(raw, time), pose)
    found = Raw(TRANSFORMS, frame)
    found.frames.add(frame)
    for name in ("record", "stamp", "place"):
        getattr(found, name).extend(getattr(lead, name))
    found.values.frombytes(np.ascontiguousarray(pose).tobytes())
    return found, sum(len(raw.record) > 1 for raw in links)


def _at(raw: Raw, time: NDArray[np.int64]) -> Array:
    """A transform at stamps (ns)."""
    stamp, values = np.frombuffer(raw.stamp, np.int64), np.frombuffer(raw.values, np.float64).reshape(-1, 3)
    if np.array_equal(stamp, time):
        return values.copy()
    order = np.argsort(stamp, kind="stable")
    first = int(stamp[order[0]])
    known, wanted = (1e-9 * (each - first).astype(float) for each in (stamp[order], time))
    columns = [*values[order, :2].T, np.unwrap(values[order, 2])]
    return np.column_stack([np.interp(wanted, known, column) for column in columns])


def _after(outer: Array, inner: Array) -> Array:
    """A pose in a frame's parent, from the pose in the frame and that of the frame."""
    cos, sin = np.cos(outer[:, 2]), np.sin(outer[:, 2])
    x = outer[:, 0] + cos * inner[:, 0] - sin * inner[:, 1]
    y = outer[:, 1] + sin * inner[:, 0] + cos * inner[:, 1]
    return np.column_stack([x, y, outer[:, 2] + inner[:, 2]])
