"""A run's folder while it runs: nobody else's, and without what an earlier run left."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from qocjax.store.lock import locked
from qocjax.store.study_folder import CHUNKS, PARTS, STUDY, command_of

__all__ = ["claimed"]

_WRITTEN = ".written.json"  # names of what the last run wrote, so that the next one knows what is stale
# What a process that was killed had under way.
_HALF_WRITTEN = re.compile(r"\..+(\.[0-9a-f]{32}|-[a-z0-9_]{8})\.(png|pdf|gif|mp4|csv|parquet|json|yaml|html|txt)")
_KEPT = (CHUNKS, STUDY, PARTS)  # what work goes on with


@contextmanager
def claimed(folder: Path, command: str) -> Iterator[None]:
    """Holds a folder for a run of a command.

    What an earlier run left half written goes, and in the end what one of the same command wrote and this one did not.

    Raises:
        ValueError: Another process works there, or another command's results are there.
        OSError: The folder cannot be written.
    """
    with locked(folder):
        other = command_of(folder)
        if other not in (None, command):
            raise ValueError(f"hydra.run.dir: got {folder}, with results of python -m qocjax.{other}, expected "
                             "a folder of its own")  # fmt: skip
        for path in folder.rglob(".*"):
            if _HALF_WRITTEN.fullmatch(path.name):
                path.unlink(missing_ok=True)
        told, before = _read(folder / _WRITTEN), _files(folder)
        yield
        after = _files(folder)
        fresh = [name for name, changed in after.items() if before.get(name) != changed]
        for name in set(told) - set(fresh):
            (folder / name).unlink(missing_ok=True)
        (folder / _WRITTEN).write_text(json.dumps(sorted(fresh)), encoding="utf-8")


def _files(folder: Path) -> dict[str, int]:
    """When each file was last changed, by its name in the folder; without what work goes on with."""
    found = (path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("."))
    names = {path.relative_to(folder): path for path in found}
    return {str(name): path.stat().st_mtime_ns for name, path in names.items() if name.parts[0] not in _KEPT}


def _read(path: Path) -> list[str]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return []
    names = found if isinstance(found, list) else []
    return [name for name in names if isinstance(name, str) and not Path(name).is_absolute() and ".." not in name]
