"""Record times that contradict header stamps and the order of messages: where the recorder's clock was set.

Three witnesses say when a message came: its record time, its header stamp, and its place in the storage. Where record
times leap and the stamps of a topic do not, stamps and order agree, and the recorder's clock was set. Where both leap
together, robot and recorder may share a clock: then the poses tell whether time passed. A robot that drives and is
where it would be a moment later has not been away for three days.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from qocjax.recorded.findings import Findings
from qocjax.recorded.series import Raw
from qocjax.recorded.stamp_clock import mend_stamps
from qocjax.recorded.witnesses import (
    AHEAD,
    BACK,
    NEAR,
    Leap,
    Topic,
    goes_on,
    lasts,
    reordered,
    said_again,
    shares,
    stamps_go,
    usual_delay,
)  # fmt: skip

__all__ = ["mend"]

_FAR = 10.0  # s, from its neighbours, at which a single record time is wrong
_LONG, _SHARE = 60.0, 3.0  # s, and times the rest of the run: a longer leap is no part of a run


def mend(raws: Collection[Raw], findings: Findings) -> None:
    """Takes steps of the recorder's clock out of record times, and out of stamps that step with them.

    Args:
        raws: Messages of each topic, in the order of the storage; changed in place.
        findings: Takes a count and a remark for each step.
    """
    topics = [Topic(raw) for raw in raws if len(raw.place) > 1]
    topics.sort(key=lambda topic: -topic.place.size)
    _mend_single(topics, findings)
    found = [(leap, step) for leap in _leaps(topics) if (step := _step(leap, topics, findings)) is not None]
    found.sort(key=lambda each: each[0].first)
    if not found:
        mend_stamps(topics, findings)
        return
    every = topics + [Topic(raw) for raw in raws if len(raw.place) == 1]
    _apply(every, [leap for leap, _ in found], [step for _, step in found])
    findings.count("record times", "clock_set", len(found))
    mend_stamps(topics, findings)


def _mend_single(topics: list[Topic], findings: Findings) -> None:
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
        offset = usual_delay(topic, ~np.isin(topic.place, single))
        for row in rows:
            by_stamp = int(topic.stamp[row]) + offset if offset is not None and topic.stamped[row] else None
            if by_stamp is not None and abs(by_stamp - int(topic.record[row])) < 1e9 * AHEAD:
                continue  # its stamp agrees with its record time: it lies at another place
            between = middle[int(topic.place[row])]
            topic.record[row] = by_stamp if by_stamp is not None and abs(by_stamp - between) < 1e9 * _FAR else between
            findings.count("record times", "clock_set")
            findings.note(
                f"record times: that of message {int(topic.place[row]) + 1} is far from those around it; mended"
            )


def _leaps(topics: list[Topic]) -> list[Leap]:
    """Where the record times of every topic leap, at places that the topics with most messages span."""
    found: list[Leap] = []
    low, high = 0, -1
    for topic in topics:
        every = 1e-9 * np.diff(topic.record)
        for k in np.flatnonzero((every < -BACK) | (every > max(AHEAD, 5.0 * topic.usual()))):
            leap = Leap(*(int(each) for each in (*topic.place[k : k + 2], *topic.record[k : k + 2])))
            known = low <= leap.first and leap.last <= high
            if not known and lasts(topic, int(k), every[k]) and all(shares(leap, other) for other in topics):
                found.append(leap)
        low, high = (int(topic.place[0]), int(topic.place[-1])) if high < 0 else (
            min(low, int(topic.place[0])), max(high, int(topic.place[-1])))  # fmt: skip
    return found


def _step(leap: Leap, topics: list[Topic], findings: Findings) -> tuple[int, str] | None:
    """By how much the recorder's clock was set (ns), and what else was set with it; None where it was not."""
    lead = next(topic for topic in topics if leap.first in topic.place[np.searchsorted(topic.place, leap.first) :][:1])
    size = 1e-9 * (leap.after - leap.before)
    steady = [topic for topic in topics if stamps_go(leap, topic) == "steady"]
    way = "ahead" if size > 0 else "back"
    text = f"record times: go {way} by {abs(size):.6g} s after message {leap.first + 1}"
    if steady:
        findings.note(f"{text}, and header stamps do not; the recorder's clock was set, and its step is taken out")
        return _offset(leap, steady[0]), "record"
    gone = leap.after - leap.before - round(1e9 * lead.usual())
    poses = [topic for topic in topics if topic.pose is not None and topic.pair(leap.first, leap.last) is not None]
    onward = goes_on(leap, poses[0], abs(size)) if poses else None
    if size < 0 and said_again(leap, lead):
        return None
    if size < 0 and not reordered(leap, lead, onward, poses[0] if poses else None):
        findings.note(f"{text}, and nothing says that messages are out of order; the clock was set back, and its step "
                      "is taken out")  # fmt: skip
        return gone, "both"
    every = np.diff(lead.record)
    rest = 1e-9 * float(every[(every > 0) & (every < abs(leap.after - leap.before))].sum())
    if size > 0 and onward:
        findings.note(f"{text}, and poses go on as if no time had passed; the clock was set, and its step is taken out")
        return gone, "both"
    if size > max(_LONG, _SHARE * rest):
        findings.note(f"{text}; whether the clock was set or recording paused cannot be known; taken out")
        return gone, "both"
    return None


def _offset(leap: Leap, topic: Topic) -> int:
    """Step of the record times against a topic's stamps (ns), from the quickest messages on either side."""
    before, after = topic.pair(leap.first, leap.last) or (0, 0)
    delay = topic.record - topic.stamp
    sides = []
    for part in (slice(max(before + 1 - NEAR, 0), before + 1), slice(after, after + NEAR)):
        stuck = part.stop - part.start > 1 and np.ptp(topic.record[part]) == 0
        values = delay[part][topic.stamped[part]]
        sides.append(int(values[-1 if part.stop == before + 1 else 0] if stuck else values.min()))
    return sides[1] - sides[0]


def _apply(topics: list[Topic], leaps: list[Leap], steps: list[tuple[int, str]]) -> None:
    """Moves the pieces between leaps to where one of them is."""
    pieces = [_pieces(topic, leaps) for topic in topics]
    base = _base(topics, pieces, len(leaps) + 1, any(how == "record" for _, how in steps))
    total = np.append(0, np.cumsum([size for size, _ in steps]))  # exact: integers
    for topic, piece in zip(topics, pieces, strict=True):
        along = [
            how == "both" or stamps_go(leap, topic) == "along" for leap, (_, how) in zip(leaps, steps, strict=True)
        ]
        own = np.append(0, np.cumsum([size if with_it else 0 for (size, _), with_it in zip(steps, along, strict=True)]))
        offset = usual_delay(topic, piece == base)
        stamp_piece = _piece_of_stamps(topic, piece, np.diff(own), offset)
        topic.record -= (total - total[base])[piece]
        topic.stamp[topic.stamped] -= (own - own[base])[stamp_piece][topic.stamped]
        for k in range(len(leaps) + 1):
            rows = np.flatnonzero((piece == k) & topic.stamped)
            if offset is not None and rows.size > 1 and np.ptp(topic.record[rows]) == 0 < np.ptp(topic.stamp[rows]):
                topic.record[rows] = topic.stamp[rows] + offset  # a clock that stood still


def _piece_of_stamps(
    topic: Topic, piece: NDArray[np.intp], sizes: NDArray[np.int64], offset: int | None
) -> NDArray[np.intp]:
    """The piece that each stamp is of: a command that was under way bears one from before the leap."""
    if offset is None:
        return piece
    late = np.append(0, sizes)[piece]
    away = topic.record - topic.stamp - offset
    return piece - ((late != 0) & (np.abs(away) > np.abs(away - late)))


def _base(topics: list[Topic], pieces: list[NDArray[np.intp]], count: int, by_stamps: bool) -> int:
    """The piece that keeps its times: where record times are nearest to stamps that do not step, or the longest."""
    sizes = np.sum([np.bincount(piece, minlength=count) for piece in pieces], axis=0)
    if not by_stamps:
        return int(np.argmax(sizes))
    away = np.full(count, np.inf)
    for topic, piece in zip(topics, pieces, strict=True):
        for k in range(count):
            delay = usual_delay(topic, piece == k)
            if delay is not None and 2 * sizes[k] >= sizes.max():  # of pieces of some length
                away[k] = min(away[k], abs(delay))
    return int(np.argmin(away)) if np.isfinite(away).any() else int(np.argmax(sizes))


def _pieces(topic: Topic, leaps: list[Leap]) -> NDArray[np.intp]:
    """The piece between leaps that each message is of; one within a leap goes with the nearer time."""
    piece = np.zeros(topic.place.size, np.intp)
    for leap in leaps:
        nearer = np.abs(topic.record - leap.after) < np.abs(topic.record - leap.before)
        piece += (topic.place >= leap.last) | ((topic.place > leap.first) & nearer)
    return piece
