"""rosbag2's SQLite3 files as they are: whole, killed before a checkpoint, cut off, or with broken pages."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Collection, Iterator
from contextlib import closing, suppress
from pathlib import Path

from qocjax._reading import check_regular, decoding
from qocjax.recorded.findings import Findings
from qocjax.recorded.numbering import Rows
from qocjax.recorded.storage import Channel, Message
from qocjax.recorded.wal import left_in_log

__all__ = ["SqliteFile"]

_BESIDE = ("-wal", "-journal")  # what SQLite has not yet put into the file, or would take back from it
_BEFORE_ALL = -(2**63)  # before the smallest key that SQLite has
_LARGEST = 2**40  # keys that are looked at behind a broken row
_MOST_BARREN, _FEW = 8, 4  # broken places one after the other with few rows between, where all that follows is noise
_ERRORS = (sqlite3.Error, OverflowError, UnicodeError, MemoryError)


class SqliteFile:
    """An open file; a `StorageFile`."""

    def __init__(self, path: Path, findings: Findings, name: str | None = None) -> None:
        """Opens a file and reads its topics.

        Args:
            path: The file.
            findings: Takes what is found wrong.
            name: How the file is called in findings.

        Raises:
            ValueError: It is no such file, or its topics cannot be read.
        """
        self.path, self._findings, self.name, self.lost = path, findings, name or path.name, 0
        self.promised: dict[int, int] | None = None
        check_regular(path)
        self._folder: tempfile.TemporaryDirectory | None = None
        try:
            self._place, self._options, log = self._placed()
            with decoding(path, "a rosbag2 SQLite3 file"), closing(self._connect()) as base:
                if log is not None and left_in_log(base, log):
                    findings.count(self.name, "damaged")
                    findings.note(f"{self.name}: its -wal file holds pages that are damaged or were never finished")
                self.channels = self._topics(base)
                self.total = self._count(base)
        except BaseException:
            self.close()
            raise
        if self._cut():
            findings.count(self.name, "truncated")

    def close(self) -> None:
        """Removes the copy where there is one."""
        if self._folder is not None:
            self._folder.cleanup()

    def messages(self, numbers: Collection[int]) -> Iterator[Message]:
        """Yields messages in the order of their rows; a page that cannot be read costs the rows on it."""
        seen, keys = 0, Rows()
        for key, number, time, data in self._rows(numbers):
            seen += 1
            keys.take(key)
            if number in self.channels and number not in numbers:
                continue
            if number in numbers and isinstance(time, int) and isinstance(data, bytes):
                yield number, time, data
            else:
                self._findings.count(self.name, "unreadable")
        if self.total is not None and seen > self.total:
            self._findings.count(self.name, "damaged")
            self._findings.note(f"{self.name}: its index holds {self.total} of {seen} messages; all of them are read")
        self.lost = max((self.total or 0) - seen, keys.missing, 0)

    def _rows(self, numbers: Collection[int]) -> Iterator[tuple[int, int, int, bytes]]:
        """Rows of every topic, with the data of those wanted only."""
        marks = ",".join("?" * len(numbers))
        text = (
            f"SELECT id, topic_id, timestamp, CASE WHEN topic_id IN ({marks}) THEN data END "
            "FROM messages NOT INDEXED WHERE id > ? ORDER BY id"
        )
        start: int | None = _BEFORE_ALL
        barren = 0
        with closing(self._connect()) as base:
            while start is not None and barren < _MOST_BARREN:
                furthest, count = start, 0
                try:
                    for key, number, time, data in base.execute(text, (*numbers, start)):
                        furthest, count = max(furthest, key), count + 1  # keys of a broken tree may go back
                        yield key, number, time, data
                    return
                except _ERRORS:
                    barren = barren + 1 if count < _FEW else 0
                    start = _beyond(base, furthest)
                    if start is not None or not self._cut():
                        self._findings.count(self.name, "damaged")

    def _placed(self) -> tuple[Path, str, Path | None]:
        """The file, how to open it, and its log; a copy where SQLite would repair it, so that nothing is written."""
        beside = [self.path.with_name(self.path.name + end) for end in _BESIDE]
        beside = [each for each in beside if each.is_file() and each.stat().st_size]
        if not beside:
            return self.path, "mode=ro&immutable=1", None
        self._folder = tempfile.TemporaryDirectory(prefix="qocjax")
        for each in (self.path, *beside):
            shutil.copyfile(each, Path(self._folder.name) / each.name)
        return (
            Path(self._folder.name) / self.path.name,
            "mode=rw",
            next((f for f in beside if f.suffix.endswith("-wal")), None),
        )

    def _connect(self) -> sqlite3.Connection:
        base = sqlite3.connect(f"{self._place.resolve().as_uri()}?{self._options}", uri=True)
        largest = min(max(self._place.stat().st_size, 1 << 16), 10**9)  # bytes of a value: no more than there are
        base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, largest)
        base.execute("PRAGMA writable_schema=ON")  # else a file with fewer pages than its header says is refused whole
        return base

    @staticmethod
    def _topics(base: sqlite3.Connection) -> dict[int, Channel]:
        names = [row[1] for row in base.execute("PRAGMA table_info(topics)")]
        qos = "offered_qos_profiles" if "offered_qos_profiles" in names else "''"
        rows = base.execute(f"SELECT id, name, type, serialization_format, {qos} FROM topics").fetchall()
        return {
            number: Channel(name, kind, encoding, profile if isinstance(profile, str) else "")
            for number, name, kind, encoding, profile in rows
            if isinstance(number, int) and all(isinstance(each, str) for each in (name, kind, encoding))
        }

    @staticmethod
    def _count(base: sqlite3.Connection) -> int | None:
        """Messages according to the index that rosbag2 makes; None where it is not there or cannot be read."""
        with suppress(sqlite3.Error):
            return int(base.execute("SELECT count(*) FROM messages INDEXED BY timestamp_idx").fetchone()[0])
        return None

    def _cut(self) -> bool:
        """Whether the file has fewer pages than its head says."""
        if self._folder is not None:
            return False
        with self.path.open("rb") as data:
            head = data.read(100)
        page = int.from_bytes(head[16:18], "big")
        return self.path.stat().st_size < (65536 if page == 1 else page) * int.from_bytes(head[28:32], "big")


def _beyond(base: sqlite3.Connection, last: int) -> int | None:
    """The key before the first row that can be read again after one that cannot; None for no such row."""

    def readable(key: int) -> int | None:
        with suppress(*_ERRORS):
            row = base.execute(
                "SELECT id, length(data) FROM messages NOT INDEXED WHERE id >= ? ORDER BY id LIMIT 1", (key,)
            ).fetchone()
            return None if row is None else int(row[0])
        return None

    low, step = max(last, 0) + 1, 1
    while readable(low + step) is None:
        low, step = low + step, 2 * step
        if step > _LARGEST:
            return None
    high = low + step
    while low + 1 < high:
        middle = (low + high) // 2
        low, high = (low, middle) if readable(middle) is not None else (middle, high)
    return max(high - 1, last + 1)
