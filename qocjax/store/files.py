"""Files written whole or not at all, and still there after a power cut."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omegaconf import OmegaConf

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["digest_of", "write_config", "write_json", "write_table", "write_text", "written"]


def written(path: Path, write: Callable[[Path], object]) -> Path:
    """Lets `write` fill a temporary file beside `path`, then puts it in place in one step.

    Raises:
        OSError: The folder cannot be written, or the disk is full; what stood at `path` stays as it was.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        write(temporary)
        temporary.chmod(0o666 & ~_umask())
        _to_disk(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    _to_disk(path.parent)
    return path


def write_text(path: Path, text: str) -> Path:
    """Writes a text file."""
    return written(path, lambda file: file.write_text(text, encoding="utf-8"))


def write_config(folder: Path, values: dict[str, Any]) -> Path:
    """Writes all options of a run as `config.yaml`."""
    return write_text(folder / "config.yaml", OmegaConf.to_yaml(OmegaConf.create(values)))


def write_json(path: Path, values: dict[str, Any]) -> Path:
    """Writes plain values as JSON."""
    return write_text(path, json.dumps(values, indent=2, ensure_ascii=False) + "\n")


def write_table(stem: Path, table: pd.DataFrame) -> list[Path]:
    """Writes a table as CSV, and as Parquet, with the table's attributes, where pyarrow is installed."""
    paths = [written(stem.with_suffix(".csv"), lambda file: table.to_csv(file, index=False, float_format="%.9g"))]
    if importlib.util.find_spec("pyarrow") is not None:
        paths.append(written(stem.with_suffix(".parquet"), lambda file: table.to_parquet(file, index=False)))
    return paths


def digest_of(path: Path) -> str:
    """Digest of a file's content."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()


def _to_disk(path: Path) -> None:
    """Waits until the content of a file, or the names in a folder, are on the disk."""
    if path.is_dir() and os.name == "nt":  # folders cannot be opened there
        return
    handle = os.open(path, os.O_RDONLY if os.name != "nt" else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
