"""Bags in the layouts that recorders leave behind: MCAP in its variants, SQLite killed before a checkpoint, packed."""

from __future__ import annotations

import shutil
import sqlite3
import sys
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from bags import EPOCH, STORE, Message, write_bag
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

PROFILE = "- history: keep_last\n  depth: 10\n  reliability: reliable\n"
COMPRESSIONS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}


def data_of(kind: str, message: Any) -> bytes:
    return message if isinstance(message, bytes) else bytes(STORE.serialize_cdr(message, kind))


def write_mcap(
    path: Path, messages: Iterable[Message], *, profile: str = "ros2", encoding: str = "cdr", channels: int = 1,
    publishers: int = 1, left_out: Collection[int] = (), **options: Any,
) -> Path:  # fmt: skip
    """Writes messages in the order given, but for those left out; `options` are those of mcap's writer."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile=profile, library="tests")
        known: dict[tuple[str, str], list[int]] = {}
        for k, (record, topic, kind, message) in enumerate(messages):
            if (topic, kind) not in known:
                schema = writer.register_schema(kind, "ros2msg", b"")
                known[topic, kind] = [
                    writer.register_channel(topic, encoding, schema, {"offered_qos_profiles": PROFILE * publishers})
                    for _ in range(channels)
                ]
            if k in left_out:
                continue
            time = EPOCH + round(record * 1e9)
            numbers = known[topic, kind]
            writer.add_message(numbers[k % len(numbers)], time, data_of(kind, message), time, k)
        writer.finish()
    return path


def write_wal(path: Path, messages: list[Message], checkpoint: int) -> Path:
    """A folder as Foxy's recorder leaves it when killed: what came after a checkpoint is in the -wal file alone."""
    path.mkdir(parents=True)
    work = path.parent / "work.db3"
    base = sqlite3.connect(work, isolation_level=None)
    base.execute("PRAGMA journal_mode=WAL")
    base.execute("PRAGMA wal_autocheckpoint=0")
    base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
                 "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)")  # fmt: skip
    base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
                 "timestamp INTEGER NOT NULL, data BLOB NOT NULL)")  # fmt: skip
    base.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
    topics: dict[str, int] = {}
    base.execute("BEGIN")
    for k, (record, topic, kind, message) in enumerate(messages):
        if k == checkpoint:
            base.execute("COMMIT")
            base.execute("PRAGMA wal_checkpoint(FULL)")
            base.execute("BEGIN")
        if topic not in topics:
            topics[topic] = len(topics) + 1
            base.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', ?)", (topics[topic], topic, kind, PROFILE))
        row = (topics[topic], EPOCH + round(record * 1e9), data_of(kind, message))
        base.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", row)
    base.execute("COMMIT")
    for end in ("", "-wal", "-shm"):
        shutil.copy(f"{work}{end}", path / f"{path.name}_0.db3{end}")
    base.close()
    for file in path.parent.glob("work.db3*"):
        file.unlink()
    return path


def packed(path: Path) -> Path:
    """Puts a .zstd in the place of a file."""
    target = path.with_name(f"{path.name}.zstd")
    target.write_bytes(zstd.compress(path.read_bytes()))
    path.unlink()
    return target


def split_bag(path: Path, parts: list[list[Message]], storage: str) -> Path:
    """A folder of splits without metadata, named as rosbag2 names them."""
    path.mkdir(parents=True)
    for number, part in enumerate(parts):
        whole = write_bag(path.parent / f"{path.name}_work", part, storage)
        (file,) = (each for each in whole.iterdir() if each.name != "metadata.yaml")
        shutil.move(file, path / f"{path.name}_{number}{file.suffix}")
        shutil.rmtree(whole)
    return path


def write_packed_messages(path: Path, messages: list[Message]) -> Path:
    """SQLite whose messages are packed one by one."""
    return write_bag(path, messages, compression=(CompressionMode.MESSAGE, CompressionFormat.ZSTD))
