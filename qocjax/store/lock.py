"""One process at a time in a folder."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import IO

__all__ = ["locked"]

_NAME = ".lock"
_held: ContextVar[frozenset[Path]] = ContextVar("held", default=frozenset())  # by whoever runs here


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Holds a folder; the system lets go of it when the process ends, however it ends.

    The file stays, with who held it last: removing it would let two processes hold files of one name. A part of what
    holds it may hold it too.

    Raises:
        ValueError: Another process holds it; the message says which.
        OSError: The folder cannot be written.
    """
    place = folder.resolve()
    if place in _held.get():
        yield
        return
    with open(folder / _NAME, "a+", encoding="utf-8") as file:
        try:
            _take(file)
        except OSError:
            file.seek(0)
            owner = file.read(200).strip() or "another process"
            raise ValueError(f"{folder}: in use by {owner}, expected a folder that nothing else writes to") from None
        file.truncate(0)
        file.write(f"process {os.getpid()} on {socket.gethostname()}\n")
        file.flush()
        before = _held.set(_held.get() | {place})
        try:
            yield
        finally:
            _held.reset(before)


if sys.platform == "win32":
    import msvcrt

    def _take(file: IO[str]) -> None:
        file.seek(1 << 20)  # far beyond the text, which others are to read
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)

else:
    import fcntl

    def _take(file: IO[str]) -> None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
