"""MCAP files as they are: any layout that the format allows, cut off, or with broken chunks and records."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from qocjax._reading import open_regular
from qocjax.recorded.findings import Findings
from qocjax.recorded.mcap_contents import Contents, text_at
from qocjax.recorded.numbering import Sequence
from qocjax.recorded.records import CHANNEL, CHUNK, DATA_END, FOOTER, HEADER, MESSAGE, SCHEMA, records
from qocjax.recorded.storage import Message
from qocjax.recorded.unpacking import unpacked

__all__ = ["McapFile"]

_MAGIC = b"\x89MCAP0\r\n"
_FOOTER = struct.Struct("<BQQQI")  # code, size, where summary and its offsets begin, checksum


class McapFile:
    """An open file; a `StorageFile`."""

    def __init__(self, path: Path, findings: Findings, name: str | None = None) -> None:
        """Opens a file and finds its channels: in its summary, or in its data where that does not name all.

        Args:
            path: The file.
            findings: Takes what is found wrong.
            name: How the file is called in findings.

        Raises:
            ValueError: It is no such file.
        """
        self.path, self._findings, self.name, self.lost = path, findings, name or path.name, 0
        with open_regular(path) as file:
            self._size = os.fstat(file.fileno()).st_size
            self._begin(file)
            self._end, found = self._summary(file)
            if not found.complete:
                promised = found.promised
                found = Contents()
                for code, data in self._walk(file, None):
                    found.take(code, data)
                found.promised = promised
        self.channels, self.promised, self._chunks = found.channels, found.promised, found.chunks
        self.total = None if found.promised is None else sum(found.promised.values())

    def close(self) -> None:
        """Nothing stays open between two readings."""

    def messages(self, numbers: Collection[int]) -> Iterator[Message]:
        """Yields messages in the order of the file; of what is broken, what comes before and after."""
        wanted, unknown, known = frozenset(numbers), 0, Contents()
        counted = {number: Sequence() for number in wanted}
        unpack = struct.Struct("<HIQ").unpack_from
        with open_regular(self.path) as file:
            for code, data in self._walk(file, wanted):
                if code == MESSAGE:
                    number, sequence, time = unpack(data)
                    if number in wanted:
                        counted[number].take(sequence)
                        yield number, time, data[22:]
                    elif number not in self.channels:
                        unknown += 1
                else:
                    known.take(code, data)
        for number, numbering in counted.items():
            if number in self.channels:
                self._findings.count(self.channels[number].name, "missing_numbers", numbering.missing())
        if unknown:
            self._findings.count(self.name, "unreadable", unknown)
            self._findings.note(f"{self.name}: {unknown} messages are of no topic that it names")
        for number in known.channels.keys() & self.channels.keys():
            here, there = known.channels[number], self.channels[number]
            if (here.name, here.kind, here.encoding) != (there.name, there.kind, there.encoding):
                self._findings.count(self.name, "damaged")
                self._findings.note(f"{self.name}: calls a topic {there.name} in its summary and {here.name} before")

    def _begin(self, file: BinaryIO) -> None:
        head = file.read(len(_MAGIC) + 1)
        if head[:-1] == _MAGIC:
            return
        if self._tail(file)[-len(_MAGIC) :] != _MAGIC and head[-1:] != bytes([HEADER]):
            raise ValueError(f"{self.path}: is no MCAP file: it does not begin with the mark of one")
        self._findings.count(self.name, "damaged")

    def _tail(self, file: BinaryIO) -> bytes:
        file.seek(max(self._size - _FOOTER.size - len(_MAGIC), 0))
        return file.read()

    def _summary(self, file: BinaryIO) -> tuple[int, Contents]:
        """Where the data ends, and what the summary says; nothing where it is broken or there is none."""
        tail, empty = self._tail(file), Contents()
        if len(tail) < _FOOTER.size + len(_MAGIC) or tail[:9] != bytes([FOOTER]) + struct.pack("<Q", 20):
            whole = tail[-len(_MAGIC) :] == _MAGIC
            self._findings.count(self.name, "damaged" if whole else "truncated")
            return self._size - len(_MAGIC) * whole, empty
        if tail[-len(_MAGIC) :] != _MAGIC:
            self._findings.count(self.name, "damaged")
        end = self._size - len(tail)
        _, _, start, _, checksum = _FOOTER.unpack_from(tail)
        if not start:
            return end, empty
        found = Contents()
        if not len(_MAGIC) < start <= end:
            self._findings.count(self.name, "damaged")
            return end, empty
        file.seek(start)
        summary = file.read(end - start)
        sound = not checksum or zlib.crc32(summary + tail[:25]) == checksum
        broken: list[str] = []
        for code, _, data in records(BytesIO(summary), 0, len(summary), lambda why: broken.append(why)):
            sound &= found.take(code, data)
        if not sound or broken:
            self._findings.count(self.name, "damaged")
            self._findings.note(f"{self.name}: its summary is damaged; the file is read without it")
            return end, empty
        return start, found

    def _walk(self, file: BinaryIO, wanted: frozenset[int] | None) -> Iterator[tuple[int, bytes]]:
        """Records of the data, also in chunks; without messages, or with them but for chunks without any wanted."""

        def damaged(why: str) -> None:
            if wanted is not None and not (why == "cut" and self._end == self._size):
                self._findings.count(self.name, "damaged")

        kinds = {SCHEMA, CHANNEL, CHUNK, DATA_END} | ({MESSAGE} if wanted is not None else set())
        for code, place, data in records(file, len(_MAGIC), self._end, damaged, kinds, self._unwanted(wanted)):
            if code != CHUNK:
                yield code, data
                continue
            inner, whole = _chunk(data)
            cut = place + 9 + len(data) >= self._end == self._size
            if not whole and not cut:
                damaged("chunk")
            told = damaged if whole else _ignored  # a broken chunk is one broken piece, not several
            yield from ((kind, each) for kind, _, each in records(BytesIO(inner), 0, len(inner), told, kinds))

    def _unwanted(self, wanted: frozenset[int] | None) -> frozenset[int]:
        """Where chunks begin that, by the summary's index, hold nothing wanted."""
        if wanted is None:
            return frozenset()
        return frozenset(place for place, numbers in self._chunks.items() if numbers and not numbers & wanted)


def _ignored(why: str) -> None:
    """Takes no notice."""


def _chunk(data: bytes) -> tuple[bytes, bool]:
    """Records of a chunk, as far as it unpacks, and whether they are what was written."""
    try:
        size, checksum = struct.unpack_from("<QI", data, 16)
        method, place = text_at(data, 28)
        (packed,) = struct.unpack_from("<Q", data, place)
    except (struct.error, IndexError):
        return b"", False
    body = data[place + 8 :]
    inner, whole = unpacked(method, body, size)
    if checksum and whole:
        whole = zlib.crc32(inner) == checksum
    return inner, whole and packed == len(body)
