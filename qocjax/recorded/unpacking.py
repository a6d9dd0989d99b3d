"""Compressed chunks, messages and files, each as far as it goes, in memory that the compressed size bounds."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from qocjax._reading import check_regular, open_regular

__all__ = ["ZSTD", "unpacked", "unpacked_file"]

ZSTD = b"\x28\xb5\x2f\xfd"  # what Zstandard data begins with
_PIECE = 1 << 16  # bytes that are fed at once where something is broken
_BLOCK = 1 << 20
_FLOOR, _RATIO = 1 << 26, 256  # bytes that anything may unpack to, and how many times its size beyond


def unpacked(method: str, data: bytes, declared: int | None = None) -> tuple[bytes, bool]:
    """What compressed data holds, and whether all of it.

    Args:
        method: `zstd` or `lz4`; empty for data as it is.
        data: The data.
        declared: Bytes that it says it unpacks to, where it says so.

    Returns:
        The bytes up to the first that is broken or absent, and whether that is none.
    """
    if not method:
        return data, declared is None or len(data) == declared
    limit = max(_FLOOR, _RATIO * len(data))
    limit = limit if declared is None else min(limit, declared)
    try:
        make = _decompressor(method)
        whole = make()
        found = whole.decompress(data, limit)
        done = whole.eof or limit == declared == len(found)
    except Exception:  # each library has errors of its own, and all of them mean the same here
        return _pieces(method, data, limit), False
    return found, done and (declared is None or len(found) == declared)


def _pieces(method: str, data: bytes, limit: int) -> bytes:
    """What comes before the place that cannot be unpacked."""
    found = bytearray()
    try:
        part = _decompressor(method)()
        for place in range(0, len(data), _PIECE):
            found += part.decompress(data[place : place + _PIECE], limit - len(found))
            if part.eof or len(found) >= limit:
                break
    except Exception:
        pass
    return bytes(found)


def _decompressor(method: str) -> Callable[[], Any]:
    """A library's decompressor; the one for Zstandard is what rosbags brings along.

    Raises:
        ValueError: The method is unknown.
    """
    if method == "lz4":
        return importlib.import_module("lz4.frame").LZ4FrameDecompressor
    if method != "zstd":
        raise ValueError(f"compression: got {method!r}, expected zstd or lz4")
    module = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
    return importlib.import_module(module).ZstdDecompressor


def unpacked_file(packed: Path, place: Path) -> bool:
    """Writes what a .zstd file holds to another file; returns whether all of it could be had.

    What unpacks to far more than recordings do is left off where it does.
    """
    part, room = _decompressor("zstd")(), max(_FLOOR, _RATIO * check_regular(packed))
    with open_regular(packed) as source, place.open("wb") as target:
        try:
            while block := source.read(_BLOCK):
                while block or not (part.eof or part.needs_input):
                    if part.eof:  # files may be several frames, one after the other
                        part = _decompressor("zstd")()
                    room -= target.write(part.decompress(block, _BLOCK))
                    if room < 0:
                        return False
                    block = part.unused_data if part.eof else b""
        except Exception as error:
            if isinstance(error, OSError):
                raise
            return False
    return bool(part.eof)
