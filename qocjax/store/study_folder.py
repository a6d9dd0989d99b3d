"""The folder of a study while it runs: one configuration, one process, chunks that stay."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from qocjax._yaml import plain
from qocjax.store.checked import read_array, read_checked, write_checked
from qocjax.store.files import write_json
from qocjax.store.identity import differences
from qocjax.store.lock import locked
from qocjax.store.owner import owner_of, strangeness

__all__ = [
    "CHUNKS",
    "PARTS",
    "RECORD",
    "STUDY",
    "ChunkFolder",
    "command_of",
    "read_identity",
    "read_record",
    "study_folder",
    "written_by",
]

STUDY = "study.json"  # what the folder belongs to, written before anything is computed
CHUNKS = "chunks"
PARTS = "parts"  # studies that a fleet study is made of
RECORD = "record.json"  # what it came to, written when all else is

# Options that one command alone has, and which.
_OTHERS = {
    "tune": "tune", "search": "codesign", "fleet": "fleet", "advise": "advise", "validation": "validate",
    "show": "show", "qos": "qos", "studies": "compare", "clean": "ingest",
}  # fmt: skip

# The disk's fault: what is there stays good, so going on is possible.
_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO)


class ChunkFolder:
    """Results of chunks, a file each, by the chunk's name."""

    def __init__(
        self,
        folder: Path,
        note: Callable[[str], object] = lambda text: None,
        owner: Mapping[str, str] | None = None,
    ) -> None:
        """Holds what lies in `folder`; `note` is told of what a reader should know, `owner` is whose chunks count."""
        self.folder, self._note, self.owner = folder, note, dict(owner or {})
        self._headers: dict[str, dict[str, Any]] = {}

    def holds(self, name: str, description: Mapping[str, Any]) -> bool:
        """Whether the results of a chunk are there and whole; a damaged file is noted, and removed."""
        if not self._path(name).exists():
            return False
        if wrong := self.wrong(name, description):
            self._note(f"{self._path(name)}: {wrong}; it is computed again")
        return not wrong

    def wrong(self, name: str, description: Mapping[str, Any]) -> str:
        """What is wrong with the file of a chunk, empty where it is that chunk and whole; a damaged one is removed."""
        path = self._path(name)
        try:
            _, header = read_checked(path)
        except ValueError as error:
            path.unlink()
            return str(error).removeprefix(f"{path}: ")
        if header.get("chunk") != dict(description):
            return "holds another chunk"
        if strange := strangeness(header.get("owner"), self.owner):
            return f"computed with {strange}"
        self._headers[name] = {key: value for key, value in header.items() if key not in ("chunk", "owner")}
        return ""

    def put(
        self, name: str, description: Mapping[str, Any], arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]
    ) -> None:
        """Writes the results of a chunk."""
        write_checked(self._path(name), arrays, {"chunk": dict(description), "owner": self.owner, **header})
        self._headers[name] = dict(header)

    def array(self, name: str, variable: str) -> np.ndarray:
        """One array of a chunk that is there."""
        return read_array(self._path(name), variable)

    def arrays(self, name: str) -> dict[str, np.ndarray]:
        """All arrays of a chunk that is there."""
        return read_checked(self._path(name))[0]

    def header(self, name: str) -> dict[str, Any]:
        """What was written with a chunk that is there."""
        return self._headers[name]

    def names(self) -> list[str]:
        """Of the files that lie there, in order."""
        return sorted(path.stem for path in self.folder.glob("[!.]*.npz"))

    def remove(self, name: str) -> None:
        """Removes the file of a chunk, if there is one."""
        self._path(name).unlink(missing_ok=True)

    def tidy(self) -> None:
        """Removes what a process that was killed left half written."""
        for path in self.folder.glob(".*.npz"):
            path.unlink(missing_ok=True)

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.npz"


@contextmanager
def study_folder(
    folder: Path, identity: Mapping[str, Any], data: str, note: Callable[[str], object] = lambda text: None
) -> Iterator[ChunkFolder]:
    """Takes a folder for a study: a new one, or one that holds the same study, finished or not.

    Whoever stops it is told how to go on.

    Args:
        folder: Made where it is missing.
        identity: The options that results depend on, plain values.
        data: Digest of the measured data behind them.
        note: Told of what a reader should know, a line each.

    Raises:
        ValueError: It holds another study, or another process works in it.
        OSError: It cannot be written, or the disk is full; what was finished stays.
    """
    try:
        (folder / CHUNKS).mkdir(parents=True, exist_ok=True)
        with locked(folder):
            options = json.loads(json.dumps(dict(identity)))
            _begin(folder, options, data)
            chunks = ChunkFolder(folder / CHUNKS, note, owner_of(options, data))
            chunks.tidy()
            yield chunks
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"resume={folder} goes on") from None
    except OSError as error:
        if error.errno is None or error.errno not in _DISK:
            raise
        why = os.strerror(error.errno)
        text = f"{folder}: cannot be written ({why}); what is finished stays, and resume={folder} goes on"
        raise OSError(text) from error


def read_identity(folder: Path) -> dict[str, Any]:
    """What a folder says of its study: `configuration` and `data`.

    Raises:
        ValueError: It holds no study, or its record is damaged.
    """
    return _read(folder, STUDY, ("configuration", "data"), "the folder of a study")


def read_record(folder: Path) -> dict[str, Any]:
    """What a folder says of its finished study.

    Raises:
        ValueError: It holds no finished study, or its record is damaged.
    """
    if (other := written_by(folder)) is not None:
        raise ValueError(f"{folder}: got what python -m qocjax.{other} wrote, expected the folder of a study of "
                         "python -m qocjax.sweep")  # fmt: skip
    names = ("configuration", "chunks", "tables", "failures", "made_with", "j_med", "j_max")
    return _read(folder, RECORD, names, f"the folder of a finished study (resume={folder} goes on with another)")


def _read(folder: Path, name: str, keys: tuple[str, ...], expected: str) -> dict[str, Any]:
    path = folder / name
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        raise ValueError(f"{folder}: got no {name} there, expected {expected}") from None
    except ValueError:
        raise ValueError(f"{path}: damaged, expected JSON as it was written") from None
    missing = [key for key in keys if not isinstance(found, dict) or key not in found]
    if missing:
        raise ValueError(f"{path}: got no {', '.join(missing)} in it, expected {expected}")
    return found


def written_by(folder: Path) -> str | None:
    """Which command wrote a folder, where another than `sweep`; None for a study, or for what is not known.

    Raises:
        ValueError: It holds the folders of several runs.
    """
    found = command_of(folder)
    return None if found == "sweep" else found


def command_of(folder: Path) -> str | None:
    """Which command wrote a folder; None for what is not known.

    Raises:
        ValueError: It holds the folders of several runs.
    """
    if (folder / "multirun.yaml").is_file():
        raise ValueError(f"{folder}: got several runs, each in a folder of its own inside, expected one of them")
    try:
        options = plain((folder / "config.yaml").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError, yaml.YAMLError):
        return None
    if not isinstance(options, dict):
        return None
    found = [command for option, command in _OTHERS.items() if option in options]
    return found[0] if found else "sweep" if "sweep" in options else None


def _begin(folder: Path, identity: dict[str, Any], data: str) -> None:
    if not (folder / STUDY).exists() or not any((folder / CHUNKS).glob("[!.]*-*.npz")):  # nothing there to be lost
        write_json(folder / STUDY, {"configuration": identity, "data": data})
        return
    found = read_identity(folder)
    if other := differences(found["configuration"], identity):
        raise ValueError(f"{folder}: holds another study ({other}), expected the same configuration, or another folder")
    if found["data"] != data:
        raise ValueError(
            f"{folder}: holds a study of other data, expected the files of its network, map and law as they were"
        )
