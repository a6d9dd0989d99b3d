"""What any command but `sweep` wrote, opened from its folder: its record, its options, its tables."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from qocjax._card import card
from qocjax._yaml import plain

__all__ = ["Results", "open_results"]

_RECORDS = ("record.json", "advice.yaml")  # of which each command writes one, last or first of its files
_TOLD = ("verdict", "method", "j_med", "j_max", "simulations")  # of a record, for those who look at it


@dataclass(frozen=True, repr=False)
class Results:
    """What a command found: tables for people, and the numbers of its record."""

    command: str  # such as `tune`
    tables: Mapping[str, pd.DataFrame]  # by the name of their file, without its ending
    record: Mapping[str, Any]
    configuration: Mapping[str, Any]  # every option with its value

    def __repr__(self) -> str:
        """What it is, in a line."""
        listed = ", ".join(f"{name} {len(table)} rows" for name, table in self.tables.items())
        return f"Results(of {self.command}: {listed})"

    def _repr_html_(self) -> str:
        """What it is, and what was chosen or recommended, for notebooks."""
        chosen = self.record.get("chosen") or self.record.get("recommended") or {}
        facts = {name: _text(self.record[name]) for name in _TOLD if self.record.get(name) is not None}
        tables = {"tables": ", ".join(f"{name} ({len(table)} rows)" for name, table in self.tables.items())}
        rows = chosen.items() if isinstance(chosen, Mapping) else []
        return card(self.command, facts | tables, pd.DataFrame(rows, columns=["chosen", "value"]))


def open_results(folder: Path, command: str) -> Results:
    """Opens the folder of a command.

    Args:
        folder: That of its results.
        command: Which wrote it.

    Raises:
        ValueError: Its record or all of its tables are missing, or a file is damaged; the message names it.
    """
    paths = [folder / name for name in _RECORDS if (folder / name).is_file()]
    tables = {path.stem: _table(path) for path in sorted(folder.glob("*.csv"))}
    if not paths or not tables:
        missing = "record" if not paths else "tables"
        raise ValueError(f"{folder}: got no {missing}, expected the finished results of python -m qocjax.{command}")
    return Results(command, tables, _plain(paths[0]), _plain(folder / "config.yaml"))


def _plain(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
        found = json.loads(text) if path.suffix == ".json" else plain(text)
    except (ValueError, RecursionError, yaml.YAMLError):
        found = None
    if not isinstance(found, dict):
        raise ValueError(f"{path}: damaged, expected it as it was written")
    return found


def _table(path: Path) -> pd.DataFrame:
    try:
        return pd.read_csv(path)
    except ValueError as error:  # of pandas' own, those of an empty file and of texts in no code among them
        raise ValueError(f"{path}: damaged ({error}), expected the table as it was written") from None


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
