"""Record times that contradict header stamps and the order of messages: where the recorder's clock was set, and by how much.

Three witnesses say when a message came: its record time, its header stamp, and its place in the storage. Where record
times leap and the stamps of a topic do not, stamps and order agree, and the recorder's clock was set. Where both leap
together, robot and recorder may share a clock: then the poses tell whether time passed. A robot that drives and is
where it would be a moment later has not been away for three days.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qocjax.recorded.findings import Findings
from qocjax.recorded.messages import COMMANDS, STAMPLESS
from qocjax.recorded.series import Raw

__all__ = ["mend"]

Array = NDArray[np.float64]

_BACK, _AHEAD = 0.1, 1.0  # s, from where on record times leap; less is disorder, or a pause
_FAR = 10.0  # s, from its neighbours, at which a single record time is wrong
_LONG, _SHARE = 60.0, 3.0  # s, and times the rest of the run: a longer leap is no part of a run
_NEAR = 50  # messages on either side that say how a clock stood
_MOVING, _RESOLUTION = 0.05, 0.1  # m/s and m, from where on a robot drives, and has moved


class _Topic:
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
class _Leap:
    """Where record times leap: between two places, from one time to another (ns)."""

    first: int
    last: int
    before: int
    after: int


def mend(raws: Collection[Raw], findings: Findings) -> None:
    """Takes steps of the recorder's clock out of record times, and out of stamps that step with them.

    Args:
        raws: Messages of each topic, in the order of the storage; changed in place.
        findings: Takes a count and a remark for each step.
    """
    topics = [_Topic(raw) for raw in raws if len(raw.place) > 1]
    topics.sort(key=lambda topic: -topic.place.size)
    _mend_single(topics, findings)
    found = [(leap, step) for leap in _leaps(topics) if (step := _step(leap, topics, findings)) is not None]
    found.sort(key=lambda each: each[0].first)
    if not found:
        return
    _apply(topics + [_Topic(raw) for raw in raws if len(raw.place) == 1], [leap for leap, _ in found], [step for _, step in found])
    findings.count("record times", "clock_set", len(found))


def _mend_single(topics: list[_Topic], findings: Findings) -> None:
    """Record times that are far from those of the messages before and after, which are near each other."""
    if not topics:
        return
    place = np.concatenate([topic.place for topic in topics])
    order = np.argsort(place, kind="stable")
    record = np.concatenate([topic.record for topic in topics])[order]
    before, here, after = record[:-2], record[1:-1], record[2:]
    away = np.minimum(np.abs(here - before), np.abs(here - after))
    found = np.flatnonzero((away > 1e9 * _FAR) & (np.abs(after - before) < away / 2))
    single = place[order][1:-1][found]
    middle = dict(zip(single.tolist(), ((before + after) // 2)[found].tolist(), strict=True))
    for topic in topics if single.size else ():
        rows = np.flatnonzero(np.isin(topic.place, single))
        offset = _common_delay(topic, ~np.isin(topic.place, single))
        for row in rows:
            by_stamp = int(topic.stamp[row]) + offset if offset is not None and topic.stamped[row] else None
            if by_stamp is not None and abs(by_stamp - int(topic.record[row])) < 1e9 * _AHEAD:
                continue  # its stamp agrees with its record time: it lies at another place
            between = middle[int(topic.place[row])]
            topic.record[row] = by_stamp if by_stamp is not None and abs(by_stamp - between) < 1e9 * _FAR else between
            findings.count("record times", "clock_set")
            findings.note(f"record times: that of message {int(topic.place[row]) + 1} is far from those around it; mended")


def _leaps(topics: list[_Topic]) -> list[_Leap]:
    """Where the record times of every topic leap, at places that the topics with most messages span."""
    found: list[_Leap] = []
    low, high = 0, -1
    for topic in topics:
        every = 1e-9 * np.diff(topic.record)
        for k in np.flatnonzero((every < -_BACK) | (every > max(_AHEAD, 5.0 * topic.usual()))):
            leap = _Leap(*(int(each) for each in (*topic.place[k : k + 2], *topic.record[k : k + 2])))
            known = low <= leap.first and leap.last <= high
            if not known and _lasts(topic, int(k), every[k]) and all(_shares(leap, other) for other in topics):
                found.append(leap)
        low, high = (int(topic.place[0]), int(topic.place[-1])) if high < 0 else (
            min(low, int(topic.place[0])), max(high, int(topic.place[-1])))  # fmt: skip
    return found


def _lasts(topic: _Topic, row: int, size: float) -> bool:
    """Whether messages come as usual before and after a leap; among messages out of order they do not."""
    usual = topic.usual()
    count = int(np.clip(abs(size) / usual, 3, 20)) if usual > 0.0 else 3
    every = 1e-9 * np.diff(topic.record[max(row - count, 0) : row + count + 2])
    others = np.delete(every, min(row, count))
    share = float(((others > -0.5 * usual) & (others < max(5.0 * usual, 0.5 * abs(size)))).mean()) if others.size else 1.0
    return share > 0.8 if abs(size) >= _AHEAD else share == 1.0


def _shares(leap: _Leap, topic: _Topic) -> bool:
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


def _step(leap: _Leap, topics: list[_Topic], findings: Findings) -> tuple[int, str] | None:
    """By how much the recorder's clock was set (ns), and what else was set with it; None where it was not."""
    lead = next(topic for topic in topics if leap.first in topic.place[np.searchsorted(topic.place, leap.first) :][:1])
    size = 1e-9 * (leap.after - leap.before)
    steady = [topic for topic in topics if _stamps(leap, topic) == "steady"]
    way = "ahead" if size > 0 else "back"
    text = f"record times: go {way} by {abs(size):.6g} s after message {leap.first + 1}"
    if steady:
        findings.note(f"{text}, and header stamps do not; the recorder's clock was set, and its step is taken out")
        return _offset(leap, steady[0]), "record"
    gone = leap.after - leap.before - round(1e9 * lead.usual())
    poses = [topic for topic in topics if topic.pose is not None and topic.pair(leap.first, leap.last) is not None]
    goes_on = _goes_on(leap, poses[0], abs(size)) if poses else None
    if size < 0 and _again(leap, lead):
        return None
    if size < 0 and not _reordered(leap, lead, goes_on, poses[0] if poses else None):
        findings.note(f"{text}, and nothing says that messages are out of order; the clock was set back, and its step "
                      "is taken out")  # fmt: skip
        return gone, "both"
    every = np.diff(lead.record)
    rest = 1e-9 * float(every[(every > 0) & (every < abs(leap.after - leap.before))].sum())
    if size > 0 and goes_on:
        findings.note(f"{text}, and poses go on as if no time had passed; the clock was set, and its step is taken out")
        return gone, "both"
    if size > max(_LONG, _SHARE * rest):
        findings.note(f"{text}; whether the clock was set or recording paused cannot be known; taken out")
        return gone, "both"
    return None


def _stamps(leap: _Leap, topic: _Topic) -> str:
    """How a topic's stamps go over a leap: `steady`, `along` with it, or neither."""
    pair = topic.pair(leap.first, leap.last)
    if pair is None or not topic.stamped[list(pair)].all():
        return ""
    size, moved = leap.after - leap.before, int(topic.stamp[pair[1]]) - int(topic.stamp[pair[0]])
    usual = round(1e9 * topic.usual())
    if abs(moved - size) <= 0.1 * abs(size) + min(2 * usual, 0.3 * abs(size)):
        return "along"
    return "steady" if abs(moved) <= 0.1 * abs(size) + min(5 * usual, 0.3 * abs(size)) else ""


def _offset(leap: _Leap, topic: _Topic) -> int:
    """Step of the record times against a topic's stamps (ns), from the quickest messages on either side."""
    before, after = topic.pair(leap.first, leap.last) or (0, 0)
    delay = topic.record - topic.stamp
    sides = []
    for part in (slice(max(before + 1 - _NEAR, 0), before + 1), slice(after, after + _NEAR)):
        stuck = part.stop - part.start > 1 and np.ptp(topic.record[part]) == 0
        values = delay[part][topic.stamped[part]]
        sides.append(int(values[-1 if part.stop == before + 1 else 0] if stuck else values.min()))
    return sides[1] - sides[0]


def _goes_on(leap: _Leap, topic: _Topic, size: float) -> bool | None:
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


def _again(leap: _Leap, lead: _Topic) -> bool:
    """Whether what comes after a leap is what came before it, once more."""
    _, after = lead.pair(leap.first, leap.last) or (0, 0)
    here = [_key(lead, k) for k in range(after, min(after + _NEAR, lead.place.size))]
    low = int(np.searchsorted(np.sort(lead.record[:after]), min(each[0] for each in here)))
    rows = np.argsort(lead.record[:after], kind="stable")[low : low + 2 * _NEAR]
    return len(set(here) & {_key(lead, int(k)) for k in rows}) > len(here) // 2


def _key(topic: _Topic, row: int) -> tuple[float, ...]:
    return (int(topic.record[row]), int(topic.stamp[row]), *map(float, topic.values[row]))


def _reordered(leap: _Leap, lead: _Topic, goes_on: bool | None, poses: _Topic | None) -> bool:
    """Whether messages after a leap back were recorded before those that lie before it: their times fit together."""
    pair = lead.pair(leap.first, leap.last)
    assert pair is not None
    every = np.diff(lead.record)
    leaps = np.flatnonzero(np.abs(every) > 1e9 * max(_AHEAD, 5.0 * lead.usual()))
    start = max((int(k) + 1 for k in leaps if k < pair[0]), default=0)
    stop = min((int(k) + 1 for k in leaps if k >= pair[1]), default=lead.record.size)
    first, second = lead.record[start : pair[1]], lead.record[pair[1] : stop]
    apart = 1e-9 * (int(first.min()) - int(second.max()))
    if apart < -2.0 * lead.usual():
        small = 1e-9 * (leap.before - leap.after) < _AHEAD
        return second.size == 1 or (small and (poses is None or not _smoother_as_stored(leap, poses)))
    return apart <= max(_AHEAD, 5.0 * lead.usual()) or goes_on is False


def _smoother_as_stored(leap: _Leap, poses: _Topic) -> bool:
    """Whether the way around a leap is shorter in the order of the storage than in that of the record times."""
    assert poses.pose is not None
    before, after = poses.pair(leap.first, leap.last) or (0, 0)
    part = slice(max(before - _NEAR, 0), after + _NEAR)
    way, order = poses.pose[part], np.argsort(poses.record[part], kind="stable")
    stored, timed = (float(np.hypot(*np.diff(each, axis=0).T).sum()) for each in (way, way[order]))
    return stored < 0.95 * timed


def _apply(topics: list[_Topic], leaps: list[_Leap], steps: list[tuple[int, str]]) -> None:
    """Moves the pieces between leaps to where one of them is."""
    pieces = [_pieces(topic, leaps) for topic in topics]
    base = _base(topics, pieces, len(leaps) + 1, any(how == "record" for _, how in steps))
    total = np.append(0, np.cumsum([size for size, _ in steps]))  # exact: integers
    for topic, piece in zip(topics, pieces, strict=True):
        along = [how == "both" or _stamps(leap, topic) == "along" for leap, (_, how) in zip(leaps, steps, strict=True)]
        own = np.append(0, np.cumsum([size if with_it else 0 for (size, _), with_it in zip(steps, along, strict=True)]))
        offset = _common_delay(topic, piece == base)
        topic.record -= (total - total[base])[piece]
        topic.stamp[topic.stamped] -= (own - own[base])[piece][topic.stamped]
        for k in range(len(leaps) + 1):
            rows = np.flatnonzero((piece == k) & topic.stamped)
            if offset is not None and rows.size > 1 and np.ptp(topic.record[rows]) == 0 < np.ptp(topic.stamp[rows]):
                topic.record[rows] = topic.stamp[rows] + offset  # a clock that stood still


def _base(topics: list[_Topic], pieces: list[NDArray[np.intp]], count: int, by_stamps: bool) -> int:
    """The piece that keeps its times: where record times are nearest to stamps that do not step, or the longest."""
    sizes = np.sum([np.bincount(piece, minlength=count) for piece in pieces], axis=0)
    if not by_stamps:
        return int(np.argmax(sizes))
    away = np.full(count, np.inf)
    for topic, piece in zip(topics, pieces, strict=True):
        for k in range(count):
            delay = _common_delay(topic, piece == k)
            if delay is not None and 2 * sizes[k] >= sizes.max():  # of pieces of some length
                away[k] = min(away[k], abs(delay))
    return int(np.argmin(away)) if np.isfinite(away).any() else int(np.argmax(sizes))


def _common_delay(topic: _Topic, rows: NDArray[np.bool_]) -> int | None:
    rows = rows & topic.stamped
    return int(np.median((topic.record - topic.stamp)[rows])) if rows.any() else None


def _pieces(topic: _Topic, leaps: list[_Leap]) -> NDArray[np.intp]:
    """The piece between leaps that each message is of; one within a leap goes with the nearer time."""
    piece = np.zeros(topic.place.size, np.intp)
    for leap in leaps:
        nearer = np.abs(topic.record - leap.after) < np.abs(topic.record - leap.before)
        piece += (topic.place >= leap.last) | ((topic.place > leap.first) & nearer)
    return piece
