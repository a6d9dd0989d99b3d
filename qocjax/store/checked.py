"""Arrays in a file with a checksum: a plain .npz, so that NumPy alone reads it, without pickle."""

from __future__ import annotations

import errno
import hashlib
import io
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED

import numpy as np
from numpy.lib.npyio import NpzFile

from qocjax.store.files import written

__all__ = ["read_array", "read_checked", "write_checked"]

_HEADER = "header"  # the entry that holds the header as JSON text, UTF-8 bytes


def write_checked(path: Path, arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]) -> Path:
    """Writes arrays and a header of plain values, whole or not at all.

    The same content gives the same bytes: nothing in the file tells the time.

    Raises:
        OSError: The folder cannot be written, or the disk is full.
    """
    text = json.dumps(dict(header) | {"checksum": _checksum(arrays, header)}, ensure_ascii=False)
    content = io.BytesIO()  # so that the disk sees one write, and a full one cannot confuse the archive
    np.savez(content, allow_pickle=False, **{_HEADER: np.frombuffer(text.encode(), np.uint8)}, **arrays)
    return written(path, lambda file: file.write_bytes(content.getbuffer()))


def read_checked(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Reads all arrays and the header, and checks them.

    Raises:
        ValueError: The file is damaged; the message names it.
        OSError: It cannot be read at all.
    """
    with _opened(path) as file:
        arrays = {name: file[name] for name in file.files}
        header = json.loads(arrays.pop(_HEADER).tobytes())
        checksum = header.pop("checksum")
    if checksum != _checksum(arrays, header):
        raise ValueError(f"{path}: damaged (its checksum is another), expected the file as it was written")
    return arrays, header


def read_array(path: Path, name: str) -> np.ndarray:
    """Reads one array; what was damaged since the file was checked shows by the archive's own check.

    Raises:
        ValueError: The file is damaged; the message names it.
        OSError: It cannot be read at all.
    """
    with _opened(path) as file:
        return np.asarray(file[name])


@contextmanager
def _opened(path: Path) -> Iterator[NpzFile]:
    """An archive of arrays as they are written here: not packed, so that it holds no more than its size."""
    with _damage_named(path), open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
        if any(each.compress_type != ZIP_STORED for each in file.zip.infolist()):
            raise ValueError("packed")
        yield file


@contextmanager
def _damage_named(path: Path) -> Iterator[None]:
    """Turns whatever a damaged archive makes its readers raise into one clear error; the disk's own stay."""
    try:
        yield
    except Exception as error:
        if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):
            raise
        text = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path}: damaged ({text}), expected the file as it was written") from None


def _checksum(arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]) -> str:
    digest = hashlib.blake2b(digest_size=16)
    digest.update(json.dumps({k: header[k] for k in sorted(header) if k != "checksum"}, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
