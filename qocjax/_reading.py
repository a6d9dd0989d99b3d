"""Files of others: opened only where they are regular files, and whatever a decoder raises told in one line."""

from __future__ import annotations

import gzip
import os
import stat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

__all__ = ["check_regular", "decoding", "open_regular", "read_bytes", "read_text", "told"]

_KINDS = {
    stat.S_IFDIR: "a folder", stat.S_IFIFO: "a named pipe", stat.S_IFSOCK: "a socket", stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}  # fmt: skip
_GZIP = b"\x1f\x8b"
_LEAST, _RATIO = 16 * 2**20, 200  # what gzip may unpack to: bytes in any case, and times the size of the file
_BOMS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}  # as PowerShell's `ping > ping.txt` writes


def check_regular(path: str | Path) -> int:
    """Returns the size (bytes) of a regular file, for libraries that open files themselves.

    Raises:
        ValueError: It is not there, may not be looked at, or is no regular file: to open a pipe would wait for ever.
    """
    try:
        found = os.stat(path)
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # a name with a NUL is a ValueError
        raise ValueError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(found.st_mode):
        kind = _KINDS.get(stat.S_IFMT(found.st_mode), "no regular file")
        raise ValueError(f"{path}: cannot be read: is {kind}, expected a regular file")
    return found.st_size


@contextmanager
def open_regular(path: str | Path) -> Iterator[BinaryIO]:
    """Opens a regular file to read its bytes; never waits.

    Raises:
        ValueError: As `check_regular`, or reading it fails.
    """
    check_regular(path)
    try:
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        with os.fdopen(handle, "rb") as file:
            if not stat.S_ISREG(os.fstat(handle).st_mode):  # put in its place since
                raise ValueError(f"{path}: cannot be read: expected a regular file")
            yield file
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror or error}") from None


def read_bytes(path: str | Path) -> bytes:
    """Reads a regular file, unpacked where it is packed by gzip.

    Raises:
        ValueError: As `open_regular`, or what is packed is damaged or unpacks to far more than packed tables do.
    """
    with open_regular(path) as file:
        content = file.read()
    if content[:2] != _GZIP:
        return content
    most = _LEAST + _RATIO * len(content)
    with open_regular(path) as file, decoding(path, "what gzip packed"), gzip.GzipFile(fileobj=file) as packed:
        unpacked = packed.read(most + 1)
    if len(unpacked) > most:
        raise ValueError(f"{path}: unpacks to more than {most >> 20} MiB, expected a table or log")
    return unpacked


def read_text(path: str | Path, most: int | None = None) -> str:
    """Reads a text file in UTF-8, or UTF-16 where it begins with its mark, unpacked where it is packed by gzip.

    Args:
        path: The file.
        most: Bytes of whole lines to read of what is not packed; None for all.

    Raises:
        ValueError: As `read_bytes`, or it is no text.
    """
    content = _beginning(path, most) if most is not None else read_bytes(path)
    code = _BOMS.get(content[:2], "utf-8-sig")
    try:
        return content.decode(code).replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        place = f"line {content.count(10, 0, error.start) + 1}" if code == "utf-8-sig" else f"byte {error.start + 1}"
        raise ValueError(f"{path}, {place}: is no text in {code[:6].upper().rstrip('-')}") from None


def _beginning(path: str | Path, most: int) -> bytes:
    """Whole lines at the beginning of a file; all of it where it is packed, or its letters have two bytes."""
    with open_regular(path) as file:
        content = file.read(most)
    if content[:2] == _GZIP or content[:2] in _BOMS:
        return read_bytes(path)
    end = content.rfind(b"\n") + 1
    return content[:end] if len(content) == most and end else content


@contextmanager
def decoding(path: str | Path, what: str, *, let: type[Exception] | tuple[type[Exception], ...] = ()) -> Iterator[None]:
    """Turns whatever is raised while a file is decoded into one line that begins with the file.

    What already names the file passes, as do warnings, a library that is not there, and what stops a program.
    Everything else is damage: integers too large for a float, data nested too deep, sizes beyond the memory, broken
    packing.

    Args:
        path: Of the file.
        what: That is expected, for the message, such as `an MCAP file`.
        let: Exceptions that pass, for a caller that tells more of them.

    Raises:
        ValueError: Anything was raised.
    """
    try:
        yield
    except (Warning, ImportError):
        raise
    except let:
        raise
    except Exception as error:
        if isinstance(error, ValueError) and str(path) in str(error):
            raise
        raise ValueError(f"{path}: cannot be read as {what}: {told(error)}") from None


def told(error: Exception) -> str:
    """An exception of a decoder in a few plain words."""
    known = {
        MemoryError: "a size in it is beyond the memory", RecursionError: "it is nested too deep",
        OverflowError: "a number in it is too large", EOFError: "it ends early", zlib.error: "its packing is damaged",
    }  # fmt: skip
    for kind, words in known.items():
        if isinstance(error, kind):
            return words
    text = getattr(error, "strerror", None) or " ".join(str(error).split())
    return f"{text[:200]}" if text and not isinstance(error, KeyError) else f"{type(error).__name__} {text}".strip()
