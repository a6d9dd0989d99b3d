"""Records of MCAP one after the other, and how to find the next one behind a broken one."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Collection, Iterator
from typing import BinaryIO

__all__ = ["CHANNEL", "CHUNK", "DATA_END", "FOOTER", "HEADER", "MESSAGE", "SCHEMA", "records"]

HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_LEAST = {
    HEADER: 8, FOOTER: 20, SCHEMA: 14, CHANNEL: 16, MESSAGE: 22, CHUNK: 40, 0x07: 6, 0x08: 60, 0x09: 36, 0x0A: 48,
    0x0B: 46, 0x0C: 8, 0x0D: 20, 0x0E: 17, DATA_END: 4,
}  # fmt: skip
"""Bytes that a record of each kind has at least."""
_PRIVATE = 0x80  # codes from here on are those of applications
_HEAD = struct.Struct("<BQ")
_LIKELY = re.compile(rb"(?=[\x01-\x0f].{4}\x00{4})", re.DOTALL)  # a code and a size below 2^32
_BLOCK = 1 << 20
_CHAIN = 3  # records that must follow each other for the first to be one


def records(
    file: BinaryIO, place: int, end: int, damaged: Callable[[str], None], kinds: Collection[int] | None = None,
    skip: Collection[int] = (),
) -> Iterator[tuple[int, int, bytes]]:  # fmt: skip
    """Yields code, place and content of records from a place to an end.

    Where a record cannot be one, the next that can is looked for. A chunk that the end cuts is yielded as far as it
    goes.

    Args:
        file: Where to read.
        place: Of the first record.
        end: Where the last one ends.
        damaged: Told `cut` where the end cuts a record and `record` where one is broken.
        kinds: Codes of those to read; None for all.
        skip: Places of records that are not read.
    """
    searched = place  # where to look for the next record if this one is broken
    while place < end:
        if file.tell() != place:
            file.seek(place)
        head = file.read(_HEAD.size)
        code, size = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
        if not _sound(code, size, end - place - _HEAD.size):
            whole = _size_of_chunk(file, place, end) if code == CHUNK else None
            if whole == size:  # a sound chunk that the end cuts
                damaged("cut")
                file.seek(place + _HEAD.size)
                yield code, place, file.read(end - place - _HEAD.size)
                return
            found = _next(file, searched, end) if whole is None else place
            damaged("cut" if found is None else "record")
            if found is None:
                return
            if whole is None:
                place, searched = found, found + 1
                continue
            size = whole
            file.seek(place + _HEAD.size)
        here, place = place, place + _HEAD.size + size
        searched = place if code == CHUNK else here + _HEAD.size  # a size that was too large has swallowed others
        if (kinds is None or code in kinds) and here not in skip:
            yield code, here, file.read(size)
            if code in (FOOTER, DATA_END):
                return


def _sound(code: int, size: int, left: int) -> bool:
    return _LEAST.get(code, 0 if code >= _PRIVATE else left + 1) <= size <= left


def _size_of_chunk(file: BinaryIO, place: int, end: int) -> int | None:
    """Size of a chunk by what it says of its own parts; None where nothing follows there, but for the end."""
    file.seek(place + _HEAD.size)
    head = file.read(64)
    if len(head) < 48:
        return None
    (length,) = struct.unpack_from("<I", head, 28)
    if length not in (0, 3, 4):  # nothing, lz4, zstd
        return None
    (packed,) = struct.unpack_from("<Q", head, 32 + length)
    size = 40 + length + packed
    beyond = place + _HEAD.size + size
    return size if beyond > end or _begins(file, beyond, end) else None


def _next(file: BinaryIO, place: int, end: int) -> int | None:
    """The first place from one on where records follow each other; None where there is none."""
    while place < end:
        file.seek(place)
        block = file.read(min(_BLOCK, end - place))
        for found in _LIKELY.finditer(block):
            code, size = _HEAD.unpack_from(block, found.start())
            here = place + found.start()
            if _sound(code, size, end - here - _HEAD.size) and _begins(file, here, end):
                return here
        if len(block) < _BLOCK:
            return None
        place += len(block) - _HEAD.size
    return None


def _begins(file: BinaryIO, place: int, end: int) -> bool:
    """Whether a few records follow each other from a place on, or end at the end."""
    for _ in range(_CHAIN):
        if place == end:
            return True
        file.seek(place)
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return False
        code, size = _HEAD.unpack(head)
        if not _sound(code, size, end - place - _HEAD.size):
            return False
        place += _HEAD.size + size
    return True
