"""Witnesses of when a message came: its record time, its header stamp, its place in the storage, and the poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qocjax.recorded.messages import COMMANDS, STAMPLESS
from qocjax.recorded.series import Raw

__all__ = [
    "AHEAD",
    "BACK",
    "NEAR",
    "Leap",
    "Topic",
    "goes_on",
    "lasts",
    "reordered",
    "said_again",
    "shares",
    "stamps_go",
    "usual_delay",
]

BACK, AHEAD = 0.1, 1.0  # s, from where on times leap; less is disorder, or a pause
NEAR = 50  # messages on either side that say how a clock stood
_UNDER_WAY = 10  # messages that may have been under way when the clock was set
_MOVING, _RESOLUTION = 0.05, 0.1  # m/s and m, from where on a robot drives, and has moved


class Topic:
    """One topic's messages as arrays over their own memory."""

    def __init__(self, raw: Raw) -> None:
        self.place, self.record = (np.frombuffer(each, np.int64) for each in (raw.place, raw.record))
        self.stamp = np.frombuffer(raw.stamp, np.int64)
        self.stamped = (self.stamp != 0) & (self.stamp != STAMPLESS)
        self.values = np.frombuffer(raw.values, np.float64).reshape(-1, 3)
        self.pose = None if raw.kind in COMMANDS else self.values[:, :2]

    def usual(self) -> float:
        """The usual interval (s)."""
        every = np.diff(self.record)
        return 1e-9 * float(np.median(every[every > 0])) if (every > 0).any() else 0.0

    def pair(self, first: int, last: int) -> tuple[int, int] | None:
        """The messages before and after what lies between two places."""
        after = int(np.searchsorted(self.place, last))
        before = int(np.searchsorted(self.place, first, side="right")) - 1
        return (before, after) if before >= 0 and after < self.place.size else None


@dataclass(frozen=True)
class Leap:
    """Where record times leap: between two places, from one time to another (ns)."""

    first: int
    last: int
    before: int
    after: int


def lasts(topic: Topic, row: int, size: float) -> bool:
    """Whether messages come as usual before and after a leap; among messages out of order they do not."""
    usual = topic.usual()
    count = int(np.clip(abs(size) / usual, 3, 20)) if usual > 0.0 else 3
    every = 1e-9 * np.diff(topic.record[max(row - count, 0) : row + count + 2])
    others = np.delete(every, min(row, count))
    share = (
        float(((others > -0.5 * usual) & (others < max(5.0 * usual, 0.5 * abs(size)))).mean()) if others.size else 1.0
    )
    return share > 0.8 if abs(size) >= AHEAD else share == 1.0


def shares(leap: Leap, topic: Topic) -> bool:
    """Whether a topic's record times leap as those of another, or it has no messages on both sides."""
    between = slice(np.searchsorted(topic.place, leap.first), np.searchsorted(topic.place, leap.last, side="right"))
    pair = topic.pair(leap.first, leap.last)
    if pair is None:
        return True
    inside = topic.record[between]
    size = leap.after - leap.before
    away = np.minimum(np.abs(inside - leap.before), np.abs(inside - leap.after))
    moved = topic.record[pair[1]] - topic.record[pair[0]]
    slack = 0.3 * abs(size) + 5e9 * topic.usual()
    return bool((away <= slack).all() and abs(moved - size) <= slack)


def stamps_go(leap: Leap, topic: Topic) -> str:
    """How a topic's stamps go over a leap: `steady`, `along` with it, or neither."""
    pair = topic.pair(leap.first, leap.last)
    if pair is None:
        return ""
    before, after = max(pair[0] - _UNDER_WAY, 0), min(pair[1] + _UNDER_WAY, topic.place.size - 1)
    if not (topic.stamped[before] and topic.stamped[after]):
        return ""
    usual = round(1e9 * topic.usual())
    between = (after - before - 1) * usual
    size, moved = leap.after - leap.before, int(topic.stamp[after]) - int(topic.stamp[before]) - between
    if abs(moved - size) <= 0.1 * abs(size) + min(2 * usual, 0.3 * abs(size)):
        return "along"
    return "steady" if abs(moved) <= 0.1 * abs(size) + min(5 * usual, 0.3 * abs(size)) else ""


def goes_on(leap: Leap, topic: Topic, size: float) -> bool | None:
    """Whether a robot that drives is after a leap where it would be a moment later; None for one that stands."""
    assert topic.pose is not None
    before, after = topic.pair(leap.first, leap.last) or (0, 0)
    speeds = []
    for part in (slice(max(before - 10, 0), before + 1), slice(after, after + 11)):
        time = 1e-9 * np.ptp(topic.record[part])
        speeds.append(float(np.hypot(*(topic.pose[part][-1] - topic.pose[part][0]))) / time if time > 0 else 0.0)
    if min(speeds) < _MOVING:
        return None
    near = _RESOLUTION + 3.0 * max(speeds) * topic.usual()
    moved = float(np.hypot(*(topic.pose[after] - topic.pose[before])))
    return moved <= near < min(speeds) * size


def said_again(leap: Leap, lead: Topic) -> bool:
    """Whether what comes after a leap is what came before it, once more."""
    _, after = lead.pair(leap.first, leap.last) or (0, 0)
    here = [_key(lead, k) for k in range(after, min(after + NEAR, lead.place.size))]
    low = int(np.searchsorted(np.sort(lead.record[:after]), min(each[0] for each in here)))
    rows = np.argsort(lead.record[:after], kind="stable")[low : low + 2 * NEAR]
    return len(set(here) & {_key(lead, int(k)) for k in rows}) > len(here) // 2


def _key(topic: Topic, row: int) -> tuple[float, ...]:
    return (int(topic.record[row]), int(topic.stamp[row]), *map(float, topic.values[row]))


def reordered(leap: Leap, lead: Topic, onward: bool | None, poses: Topic | None) -> bool:
    """Whether messages after a leap back were recorded before those that lie before it: their times fit together."""
    pair = lead.pair(leap.first, leap.last)
    assert pair is not None
    every = np.diff(lead.record)
    leaps = np.flatnonzero(np.abs(every) > 1e9 * max(AHEAD, 5.0 * lead.usual()))
    start = max((int(k) + 1 for k in leaps if k < pair[0]), default=0)
    stop = min((int(k) + 1 for k in leaps if k >= pair[1]), default=lead.record.size)
    first, second = lead.record[start : pair[1]], lead.record[pair[1] : stop]
    apart = 1e-9 * (int(first.min()) - int(second.max()))
    if apart < -2.0 * lead.usual():
        small = 1e-9 * (leap.before - leap.after) < AHEAD
        return second.size == 1 or (small and (poses is None or not _smoother_as_stored(leap, poses)))
    return apart <= max(AHEAD, 5.0 * lead.usual()) or onward is False


def _smoother_as_stored(leap: Leap, poses: Topic) -> bool:
    """Whether the way around a leap is shorter in the order of the storage than in that of the record times."""
    assert poses.pose is not None
    before, after = poses.pair(leap.first, leap.last) or (0, 0)
    part = slice(max(before - NEAR, 0), after + NEAR)
    way, order = poses.pose[part], np.argsort(poses.record[part], kind="stable")
    stored, timed = (float(np.hypot(*np.diff(each, axis=0).T).sum()) for each in (way, way[order]))
    return stored < 0.95 * timed


def usual_delay(topic: Topic, rows: NDArray[np.bool_]) -> int | None:
    """Median of record time less stamp (ns) of some rows; None where none has a stamp."""
    rows = rows & topic.stamped
    return int(np.median((topic.record - topic.stamp)[rows])) if rows.any() else None
