"""Whether what was received had crossed the emulated radio: each message is looked for in the frames delivered."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.dds_testbed.link import SIDES

__all__ = ["Crossed", "ReceivedBy", "past_the_radio"]

_ETHERNET, _UDP, _TCP_PROTOCOL = 14, 8, 6
_MORE, _OFFSET = 0x2000, 0x1FFF  # of a fragment: whether others follow, and where it stands, in eight bytes
_HALF = 2**31  # of the sequence numbers of TCP


class Crossed(NamedTuple):
    """A frame that the emulator has delivered."""

    time: int  # ns, just before
    link: int
    side: int  # to which
    frame: bytes


@dataclass(frozen=True)
class ReceivedBy:
    """What one side has received."""

    rows: np.ndarray  # [K, 3] robot, sequence, when (ns)
    speeds: np.ndarray  # [K, 2] nu, omega; of the robot where it is a state
    marks: np.ndarray  # [K] bytes that were on the wire

    @classmethod
    def read(cls, path: Path) -> ReceivedBy:
        """As a side has written it."""
        with np.load(path) as file:
            return cls(file["rows"], file["speeds"], file["marks"])


class _Heard:
    """All bytes that were delivered to one end of a link, with the time of each."""

    def __init__(self) -> None:
        self._content: list[bytes] = []
        self._times: list[np.ndarray] = []

    def add(self, times: np.ndarray | int, payload: bytes) -> None:
        self._content.append(payload)
        self._times.append(np.broadcast_to(times, len(payload)))

    @cached_property
    def _all(self) -> tuple[bytes, np.ndarray]:
        return b"".join(self._content), np.concatenate([*self._times, np.zeros(0, np.int64)])

    def had(self, mark: bytes, by: int) -> bool:
        """Whether the whole of a mark had come by a time (ns), at any of the times that it was sent."""
        content, times = self._all
        at = content.find(mark)
        while at >= 0:
            if times[at : at + len(mark)].max() <= by:
                return True
            at = content.find(mark, at + 1)
        return False


def past_the_radio(frames: Iterable[Crossed], by_side: list[ReceivedBy]) -> list[str]:
    """What is to be said against a run in which messages came some other way; nothing if all have crossed.

    Args:
        frames: All that were delivered, in order.
        by_side: What each side received.
    """
    heard = _heard(frames)
    said = []
    for side, what in zip(SIDES, ("commands", "states"), strict=True):
        rows, marks = by_side[side].rows, by_side[side].marks
        past = sum(
            not heard[robot, side].had(mark.tobytes(), stamp)
            for (robot, _, stamp), mark in zip(rows.tolist(), marks, strict=True)
        )
        if past:
            said.append(f"{past} of {len(rows)} {what} came past the emulated radio, expected each in a frame")
    return said


def _heard(frames: Iterable[Crossed]) -> dict[tuple[int, int], _Heard]:
    """Payloads by link and side: of datagrams as they came, of fragments and streams put together by their numbers."""
    heard: dict[tuple[int, int], _Heard] = defaultdict(_Heard)
    streams: dict[tuple[int, int, bytes], list[tuple[int, int, bytes]]] = defaultdict(list)
    for time, link, side, frame in frames:
        if len(frame) < _ETHERNET + 20:
            continue
        at = _ETHERNET + 4 * (frame[_ETHERNET] & 0x0F)
        end = _ETHERNET + int.from_bytes(frame[_ETHERNET + 2 : _ETHERNET + 4], "big")
        fragment = int.from_bytes(frame[_ETHERNET + 6 : _ETHERNET + 8], "big")
        if fragment & (_MORE | _OFFSET):
            of = frame[_ETHERNET + 4 : _ETHERNET + 6]
            streams[link, side, of].append((8 * (fragment & _OFFSET), time, frame[at : end or None]))
        elif frame[_ETHERNET + 9] == _TCP_PROTOCOL:
            number, begin = int.from_bytes(frame[at + 4 : at + 8], "big"), at + 4 * (frame[at + 12] >> 4)
            streams[link, side, frame[at : at + 4]].append((number, time, frame[begin : end or None]))
        else:
            heard[link, side].add(time, frame[at + _UDP : end or None])
    for (link, side, _), segments in streams.items():
        _join(heard[link, side], segments)
    return heard


def _join(heard: _Heard, segments: list[tuple[int, int, bytes]]) -> None:
    """Adds the bytes of a stream in their order, each with the time at which it first came."""
    base = segments[0][0]
    offsets = [(number - base + _HALF) % (2 * _HALF) - _HALF for number, *_ in segments]  # numbers begin anew
    first, last = min(offsets), max(offset + len(each[2]) for offset, each in zip(offsets, segments, strict=True))
    content, times = bytearray(last - first), np.full(last - first, np.iinfo(np.int64).max)
    for offset, (_, time, payload) in zip(offsets, segments, strict=True):
        span = slice(offset - first, offset - first + len(payload))
        content[span], times[span] = payload, np.minimum(times[span], time)
    heard.add(times, bytes(content))
