"""A folder of runs: which files make which run, and the labels of each."""

from __future__ import annotations

import fnmatch
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from qocjax.recorded.bags import is_bag
from qocjax.recorded.patterns import filled, matched
from qocjax.recorded.run import RunFiles
from qocjax.recorded.stamps import TABLES, StampsFormat, columns_of, is_table

__all__ = ["Labels", "find_runs"]

_POSES = {"time", "robot", "x", "y"}


@dataclass(frozen=True)
class Labels:
    """Labels of runs, such as D_cfg and the QoS profile."""

    pattern: str | None = None  # of a run's name, a label in each place in braces
    table: pd.DataFrame | None = None  # column run: name or pattern with * and ?; the others are labels

    @classmethod
    def of(cls, pattern: str | None, file: str | Path | None) -> Labels:
        """Labels from a pattern and a CSV file.

        Raises:
            ValueError: The file cannot be read, or has no column `run`.
        """
        if file is None:
            return cls(pattern)
        try:
            table = pd.read_csv(file, dtype={"run": str})
        except (OSError, ValueError, pd.errors.ParserError) as error:
            raise ValueError(f"{file}: cannot be read as CSV: {str(error).splitlines()[0]}") from None
        if "run" not in table:
            raise ValueError(f"{file}: has no column 'run'; its columns are {', '.join(map(repr, table))}")
        return cls(pattern, table)

    def __call__(self, name: str) -> dict[str, str | float]:
        """Labels of a run; what reads as a number is one. The file's win over the pattern's."""
        found: dict[str, str | float] = {}
        for key, text in (matched(self.pattern, name) or {} if self.pattern else {}).items():
            found[key] = _number(text)
        if self.table is not None:
            for row in self.table.to_dict("records"):
                if fnmatch.fnmatchcase(name, row.pop("run")):
                    found |= {str(key): value for key, value in row.items() if not pd.isna(value)}
        return found


def _number(text: str) -> str | float:
    try:
        return float(text)
    except ValueError:
        return text


def find_runs(path: Path, stamps: StampsFormat) -> list[RunFiles]:
    """The runs at a path: a bag, a table, or a folder with any number of them at any depth.

    A bag is a run, with the tables of stamps that lie in its folder. In a folder without a bag, a table of poses and
    the tables of stamps beside it are a run; tables of stamps alone are a run each. Names are paths within the folder.

    Raises:
        ValueError: There is nothing at the path, or no run in it.
    """
    if not path.exists():
        raise ValueError(f"path: got {path}, which is not there, expected a bag, a table or a folder of them")
    if path.is_file():
        if is_table(path):
            return _in_folder(path.parent, path.parent, stamps, [path])
        if not is_bag(path) and path.suffix != ".bag":  # of those, what opens bags knows what to say
            raise ValueError(f"path: got {path}, expected a bag (.db3, .mcap) or a table ({', '.join(TABLES)})")
        return [RunFiles(path.stem, bag=path)]
    folders = [path, *sorted(folder for folder in path.rglob("*") if folder.is_dir())]
    found = [run for folder in folders for run in _in_folder(path, folder, stamps)]
    if not found:
        wanted = f"{stamps.files} with the columns {stamps.uplink_send} and {stamps.downlink_receive}"
        raise ValueError(
            f"path: got {path}, which holds no run, expected rosbag2 folders, tables of poses, or of stamps ({wanted})"
        )
    return found


def _in_folder(root: Path, folder: Path, layout: StampsFormat, only: list[Path] | None = None) -> list[RunFiles]:
    """Runs directly in a folder."""
    name = folder.relative_to(root).as_posix() if folder != root else folder.resolve().name
    tables = only or sorted(file for file in folder.iterdir() if file.is_file() and is_table(file))
    poses = [file for file in tables if file.suffix != ".json" and set(columns_of(file, layout)) >= _POSES]
    stamps = _pairs([file for file in tables if file not in poses], layout, chosen=only is not None)
    if only is None and is_bag(folder):
        return [RunFiles(name, bag=folder, stamps=tuple(stamps))]
    prefix = "" if folder == root else f"{name}/"
    if len(poses) == 1 and only is None:
        return [RunFiles(name, poses=poses[0], stamps=tuple(stamps))]
    runs = [RunFiles(f"{prefix}{file.stem}", poses=file) for file in poses]
    return runs + [RunFiles(f"{prefix}{file.stem}", stamps=((file, edge),)) for file, edge in stamps]


def _pairs(tables: list[Path], layout: StampsFormat, chosen: bool) -> list[tuple[Path, Path | None]]:
    """Tables of stamps, each with the edge's own where the layout has one.

    Raises:
        ValueError: A table lacks columns although it was chosen by name, or not exactly one edge table fits.
    """
    found: list[tuple[Path, Path | None]] = []
    for file in tables:
        places = matched(layout.files, file.name)
        if places is None and not chosen:
            continue
        if layout.edge_files is None:
            if chosen or {layout.uplink_send, layout.downlink_receive} <= set(columns_of(file, layout)):
                found.append((file, None))
            continue
        wanted = filled(layout.edge_files, places or {})
        edges = [other for other in sorted(file.parent.iterdir()) if fnmatch.fnmatchcase(other.name, wanted)]
        if len(edges) != 1:
            raise ValueError(f"{file}: {len(edges)} files are its edge's ({wanted}), expected one")
        found.append((file, edges[0]))
    return found
