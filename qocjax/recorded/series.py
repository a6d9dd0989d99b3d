"""A topic's messages as clean series on one clock: poses of a robot, or its commands."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from qocjax.recorded.clocks import lower_envelope
from qocjax.recorded.findings import Findings
from qocjax.recorded.messages import STAMPLESS

__all__ = ["Cleaning", "Raw", "Series", "clean"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cleaning:
    """From where on something counts as wrong."""

    gap: float = 3.0  # times the usual interval
    least_gap: float = 0.5  # s; a shorter interval is no gap
    restart: float = 1.0  # s, that a stamp goes back, or ahead of its clock
    max_speed: float = 1.5  # m/s
    max_turn_rate: float = 6.0  # rad/s
    window: float = 30.0  # s, of the clocks' envelopes


@dataclass
class Raw:
    """What is read of a topic, in the order of the storage and in little memory: 48 bytes a message, 64 of odometry."""

    kind: str
    frame: str = ""
    record: array[int] = field(default_factory=lambda: array("q"))  # ns
    stamp: array[int] = field(default_factory=lambda: array("q"))  # ns, 0 for none, STAMPLESS where the type has none
    values: array[float] = field(default_factory=lambda: array("d"))  # three a message
    place: array[int] = field(default_factory=lambda: array("q"))  # in the storage, among all that is read
    frames: set[str] = field(default_factory=set)  # that messages name
    speeds: array[float] = field(default_factory=lambda: array("d"))  # of odometry, nu and omega of each message

    def append(self, place: int, record: int, stamp: int, values: tuple[float, ...]) -> None:
        """Adds a message: three numbers, and of odometry two more."""
        self.place.append(place)
        self.record.append(record)
        self.stamp.append(stamp)
        self.values.extend(values[:3])
        self.speeds.extend(values[3:])

    def driven(self) -> Raw:
        """The speeds of odometry as messages of their own, at the same times."""
        both = np.frombuffer(self.speeds, np.float64).reshape(-1, 2)
        values = array("d", np.column_stack([both, np.zeros(len(both))]).tobytes())
        return Raw(self.kind, self.frame, self.record, self.stamp, values, self.place)


@dataclass(frozen=True)
class Series:
    """Messages in order of time, on the recorder's clock."""

    time: Array  # [n] s; of poses that bear stamps, the stamp on the recorder's clock
    record: Array  # [n] s, when the recorder had them
    stamp: Array  # [n] s, as in the header; NaN for none
    late: Array  # [n] s, delay above the envelope of the clock; NaN without a stamp
    values: Array  # [n, 3]
    kind: str
    frame: str


def clean(raw: Raw, begin: int, where: str, cleaning: Cleaning, findings: Findings) -> Series:
    """Cleans a topic's messages and counts what was found.

    Stamps are put on the recorder's clock by the drifting envelope of `record - stamp`, anew after each restart: that
    takes the varying part of the delay out of the times, and leaves the smallest delay in.

    Args:
        raw: As read.
        begin: Record time that counts as 0 (ns).
        where: Name of the topic, for the findings.
        cleaning: What counts as wrong.
        findings: Takes the counts.
    """
    record: Array = 1e-9 * (np.frombuffer(raw.record, np.int64) - begin).astype(np.float64)
    stamp_ns = np.frombuffer(raw.stamp, np.int64)
    values = np.frombuffer(raw.values, np.float64).reshape(-1, 3)
    stamped = (stamp_ns != 0) & (stamp_ns != STAMPLESS)
    stamp = np.where(stamped, 1e-9 * (stamp_ns - begin), np.nan)
    if raw.kind != "geometry_msgs/msg/Twist":  # the one type that has no stamp
        findings.count(where, "no_stamp", int((stamp_ns == 0).sum()))
    keep = np.isfinite(values).all(axis=1)
    findings.count(where, "not_finite", int((~keep).sum()))
    keep &= ~_repeated(stamp_ns, values, stamped & keep)
    findings.count(where, "duplicates", int(np.isfinite(values).all(axis=1).sum() - keep.sum()))
    record, stamp, values = record[keep], stamp[keep], values[keep]
    late = _lateness(record, stamp, where, cleaning, findings)
    time = np.where(np.isfinite(late), record - late, record)
    findings.count(where, "unordered", int((np.diff(time) < 0.0).sum()))
    order = np.argsort(time, kind="stable")
    return Series(time[order], record[order], stamp[order], late[order], values[order], raw.kind, raw.frame)


def _repeated(stamp: NDArray[np.int64], values: Array, stamped: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Messages that say again, with the same stamp, what an earlier one said."""
    found = np.zeros(stamp.size, bool)
    rows = np.flatnonzero(stamped)
    if rows.size:
        together = np.column_stack([stamp[rows], values[rows].view(np.int64)])
        _, first = np.unique(together, axis=0, return_index=True)
        found[rows] = True
        found[rows[first]] = False
    return found


def _lateness(record: Array, stamp: Array, where: str, cleaning: Cleaning, findings: Findings) -> Array:
    """How much later than the quickest message each was recorded."""
    late = np.full(record.size, np.nan)
    rows = np.flatnonzero(np.isfinite(stamp))
    if not rows.size:
        return late
    delay = (record - stamp)[rows]
    pieces = _pieces(stamp[rows], delay, cleaning.restart)
    findings.count(where, "restarts", len(pieces) - 1)
    for piece in pieces:
        knots, envelope, _ = lower_envelope(record[rows[piece]], delay[piece], cleaning.window)
        late[rows[piece]] = delay[piece] - np.interp(record[rows[piece]], knots, envelope)
    findings.count(where, "ahead_of_clock", int((late < -1e-3).sum()))
    return late


def _pieces(stamp: Array, delay: Array, least: float) -> list[NDArray[np.intp]]:
    """Messages between restarts: a stamp goes far back, or far ahead of the quickest message so far.

    A late message is neither, and nor is the first in time after late ones.
    """
    found = []
    for piece in np.split(np.arange(stamp.size), np.flatnonzero(np.diff(stamp) < -least) + 1):
        while piece.size:
            quickest = np.minimum.accumulate(delay[piece])
            ahead = np.flatnonzero(np.diff(quickest) < -least)
            end = int(ahead[0]) + 1 if ahead.size else piece.size
            found.append(piece[:end])
            piece = piece[end:]
    return found
