"""SQLite's write-ahead log beside a bag: how much of what lies in it SQLite takes."""

from __future__ import annotations

import sqlite3
import struct
from pathlib import Path

__all__ = ["left_in_log"]

_HEADER, _FRAME = 32, 24  # bytes, of the log and of each page in it
_MOST_RESTARTS = 4  # of a log, whose old pages may lie behind the new ones


def left_in_log(base: sqlite3.Connection, log: Path) -> bool:
    """Puts a log into its file, and says whether pages of it were left because they are damaged or were never finished.

    A log that was begun anew has old pages behind the new ones, each with the marks of its time; those are none.

    Args:
        base: The open file, which may be written to.
        log: The log, as it was before it was opened.
    """
    content = log.read_bytes()
    _, taken, _ = base.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
    if len(content) < _HEADER:
        return len(content) > 0
    (page,) = struct.unpack_from(">I", content, 8)
    if page < 512 or page > 65536:
        return True
    places = range(_HEADER + max(taken, 0) * (_FRAME + page), len(content), _FRAME + page)
    marks = set()
    for place in places:
        if place + _FRAME + page > len(content):
            return True
        number, _, *mark = struct.unpack_from(">IIII", content, place)
        marks.add(tuple(mark))
        if not number or tuple(mark) == struct.unpack_from(">II", content, 16):
            return True
    return len(marks) > _MOST_RESTARTS or (taken <= 0 and bool(places))
