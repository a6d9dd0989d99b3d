"""Whether what was received had crossed the emulated radio: each message is looked for in the frames delivered."""

from __future__ import annotations

import bisect
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.dds_testbed.link import SIDES

__all__ = ["Crossed", "ReceivedBy", "past_the_radio"]

_ETHERNET, _UDP, _TCP_PROTOCOL = 14, 8, 6


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
    marks: np.ndarray  # [K] bytes that were on the wire

    @classmethod
    def read(cls, path: Path) -> ReceivedBy:
        """As a side has written it."""
        with np.load(path) as file:
            return cls(file["rows"], file["marks"])


class _Heard:
    """All bytes that were delivered to one end of a link, with the time of each."""

    def __init__(self) -> None:
        self.content = bytearray()
        self._begins: list[int] = []
        self._times: list[int] = []

    def add(self, time: int, payload: bytes) -> None:
        self._begins.append(len(self.content))
        self._times.append(time)
        self.content += payload

    def had(self, mark: bytes, by: int) -> bool:
        """Whether a mark had come by a time (ns)."""
        at = self.content.find(mark)
        return at >= 0 and self._times[bisect.bisect(self._begins, at + len(mark) - 1) - 1] <= by


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
    """Payloads by link and side: of datagrams as they came, of streams put together by their sequence numbers."""
    heard: dict[tuple[int, int], _Heard] = defaultdict(_Heard)
    streams: dict[tuple[int, int, bytes], list[tuple[int, int, bytes]]] = defaultdict(list)
    for time, link, side, frame in frames:
        if len(frame) < _ETHERNET + 20:
            continue
        at = _ETHERNET + 4 * (frame[_ETHERNET] & 0x0F)
        end = _ETHERNET + int.from_bytes(frame[_ETHERNET + 2 : _ETHERNET + 4], "big")
        if frame[_ETHERNET + 9] == _TCP_PROTOCOL:
            number, begin = int.from_bytes(frame[at + 4 : at + 8], "big"), at + 4 * (frame[at + 12] >> 4)
            streams[link, side, frame[at : at + 4]].append((number, time, frame[begin : end or None]))
        else:
            heard[link, side].add(time, frame[at + _UDP : end or None])
    for (link, side, _), segments in streams.items():
        _join(heard[link, side], segments)
    return heard


def _join(heard: _Heard, segments: list[tuple[int, int, bytes]]) -> None:
    """Adds the bytes of a stream in their order, each with the time at which it first came."""
    first = segments[0][0]
    offsets = [((number - first + 2**31) % 2**32 - 2**31, time, payload) for number, time, payload in segments]
    upto: int | None = None
    for offset, time, payload in sorted(offsets):
        fresh = payload if upto is None else payload[max(upto - offset, 0) :]
        upto = max(upto or offset, offset + len(payload)) if upto is not None else offset + len(payload)
        if fresh:
            heard.add(time, fresh)
