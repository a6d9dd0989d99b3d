"""Files written whole or not at all."""

from __future__ import annotations

import importlib.util
import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
from omegaconf import OmegaConf

__all__ = ["write_config", "write_json", "write_table", "write_text", "written"]


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
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
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
    """Writes a table as CSV, and as Parquet where pyarrow is installed."""
    paths = [written(stem.with_suffix(".csv"), lambda file: table.to_csv(file, index=False, float_format="%.9g"))]
    if importlib.util.find_spec("pyarrow") is not None:
        paths.append(written(stem.with_suffix(".parquet"), lambda file: table.to_parquet(file, index=False)))
    return paths


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
