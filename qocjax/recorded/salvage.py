"""What can still be read of a bag that was cut off: complete messages, in the order in which they were written."""

from __future__ import annotations

import importlib
import sqlite3
import struct
import sys
from collections.abc import Collection, Iterator
from contextlib import closing
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

__all__ = ["Found", "salvage", "salvaged_topics", "zstd_decompress"]

_MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x03, 0x04, 0x05, 0x06
_CHUNK_HEAD = 64  # bytes, that hold what is said of a chunk
_LARGEST = 2**28  # bytes of a record; a larger one is no record but noise
_ZSTD = b"\x28\xb5\x2f\xfd"  # begins a message that was compressed on its own

Found = dict[int, tuple[str, str, str]]
"""Name, type and offered QoS (as YAML) of each topic by its number."""


def salvaged_topics(path: Path) -> Found:
    """Topics of a damaged file.

    Raises:
        ValueError: Nothing of it can be read.
    """
    if path.suffix == ".mcap":
        found: Found = {}
        for _ in _mcap(path, found, None):
            pass
        return found
    try:
        with closing(_connect(path)) as base:
            names = [row[1] for row in base.execute("PRAGMA table_info(topics)")]
            qos = "offered_qos_profiles" if "offered_qos_profiles" in names else "''"
            rows = base.execute(f"SELECT id, name, type, {qos} FROM topics").fetchall()
    except sqlite3.Error as error:
        raise ValueError(f"{path}: cannot be read as a rosbag2 SQLite3 file: {error}") from None
    return {number: (name, kind, profile) for number, name, kind, profile in rows}


def salvage(path: Path, topics: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
    """Yields number of the topic, record time (ns) and data of complete messages, as far as the file goes."""
    for number, time, data in _mcap(path, {}, topics) if path.suffix == ".mcap" else _sqlite(path, topics):
        yield number, time, zstd_decompress(data) if data[:4] == _ZSTD else data


def _sqlite(path: Path, topics: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
    with closing(_connect(path)) as base:
        marks = ",".join("?" * len(topics))
        try:
            yield from base.execute(
                f"SELECT topic_id, timestamp, data FROM messages NOT INDEXED WHERE topic_id IN ({marks}) ORDER BY id",
                tuple(topics),
            )
        except sqlite3.Error:
            return  # the first page beyond the cut


def _connect(path: Path) -> sqlite3.Connection:
    base = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    base.execute("PRAGMA writable_schema=ON")  # otherwise a file with fewer pages than its header says is refused whole
    return base


def _mcap(path: Path, found: Found, topics: Collection[int] | None) -> Iterator[tuple[int, int, bytes]]:
    """Goes through the records, fills in the topics, and yields the messages of those wanted (None for no message)."""
    with path.open("rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise ValueError(f"{path}: is no MCAP file: it does not begin with the mark of one")
        schemas: dict[int, str] = {}
        for code, record in _records(file):
            inner = _records(BytesIO(_unpacked(record))) if code == _CHUNK else iter([(code, record)])
            for kind, data in inner:
                if kind == _SCHEMA:
                    (number,) = struct.unpack_from("<H", data)
                    schemas[number] = _text(data, 2)[0]
                elif kind == _CHANNEL:
                    number, schema = struct.unpack_from("<HH", data)
                    name, end = _text(data, 4)
                    found[number] = (name, schemas.get(schema, ""), _profile(data, _text(data, end)[1]))
                elif kind == _MESSAGE and topics is not None:
                    number, _, time = struct.unpack_from("<HIQ", data)
                    if number in topics:
                        yield number, time, data[22:]


def _records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Records up to the first that is not whole, or that is the footer."""
    while len(head := file.read(9)) == 9:
        code, size = struct.unpack("<BQ", head)
        if code in (0x02, 0x0F):  # footer, end of the data
            return
        if code not in (_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK):
            file.seek(size, 1)
            continue
        data = file.read(min(size, _LARGEST))
        if len(data) == size or (code == _CHUNK and len(data) > _CHUNK_HEAD):  # the beginning of a chunk is good too
            yield code, data
        if len(data) < size:
            return


def _unpacked(chunk: bytes) -> bytes:
    """Records of a chunk, as far as it decompresses."""
    method, place = _text(chunk, 28)
    data = chunk[place + 8 :]
    try:
        if method == "lz4":
            return importlib.import_module("lz4.frame").LZ4FrameDecompressor().decompress(data)
        return zstd_decompress(data) if method else data
    except Exception:  # each library has errors of its own, and all of them mean the same here
        return b""


def zstd_decompress(data: bytes) -> bytes:
    """Decompresses Zstandard data as far as it goes, with the library that rosbags brings along."""
    module: Any = importlib.import_module("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")
    return module.ZstdDecompressor().decompress(data)


def _text(data: bytes, place: int) -> tuple[str, int]:
    (size,) = struct.unpack_from("<I", data, place)
    return data[place + 4 : place + 4 + size].decode("utf-8", "replace"), place + 4 + size


def _profile(data: bytes, place: int) -> str:
    """The offered QoS among a channel's remarks."""
    (size,) = struct.unpack_from("<I", data, place)
    end = place + 4 + size
    place += 4
    while place < end:
        key, place = _text(data, place)
        value, place = _text(data, place)
        if key == "offered_qos_profiles":
            return value
    return ""
