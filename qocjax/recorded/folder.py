"""A folder of runs: which files make which run, and the labels of each."""

from __future__ import annotations

import fnmatch
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from qocjax._reading import check_regular, decoding
from qocjax.network.columns import names_of
from qocjax.network.values import header_unit, listed
from qocjax.recorded.bags import is_bag
from qocjax.recorded.formats import FORMATS, found_format
from qocjax.recorded.patterns import filled, matched
from qocjax.recorded.pose_tables import PosesFormat
from qocjax.recorded.run import RunFiles
from qocjax.recorded.stamps import STAMPS, TABLES, StampsFormat, columns_of, is_table

__all__ = ["Labels", "find_runs"]

_OWN = ("sequence", "uplink_send", "downlink_receive", "records", "edge_files")  # of a layout that was chosen

# Delays that are counted tell no order of loops, and are a law of one way.
_HISTOGRAM = ("; a histogram of delays is a law: network=loop delay@network.uplink.delay=histogram "
              "network.uplink.delay.path={}")  # fmt: skip


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
        check_regular(file)
        with decoding(file, "CSV"):
            table = pd.read_csv(file, dtype={"run": str})
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

    def check(self, names: Sequence[str]) -> None:
        """Checks that they say something of some run.

        Raises:
            ValueError: The pattern or the table fits none of the names.
        """
        if self.pattern and not any(matched(self.pattern, name) for name in names):
            raise ValueError(f"labels.pattern: got {self.pattern}, which fits none of the {len(names)} runs, such as "
                             f"{names[0]}")  # fmt: skip
        rows = [] if self.table is None else self.table["run"].dropna().tolist()
        if self.table is not None and not any(fnmatch.fnmatchcase(name, row) for name in names for row in rows):
            raise ValueError(f"labels.file: got runs {listed(rows[:3])}, which fit none of the {len(names)} runs, such "
                             f"as {names[0]}")  # fmt: skip


def _number(text: str) -> str | float:
    try:
        return float(text)
    except ValueError:
        return text


def find_runs(path: Path, stamps: StampsFormat, poses: PosesFormat | None = None, kind: str = "auto") -> list[RunFiles]:
    """The runs at a path: a bag, a table, a log of a tool, or a folder with any number of them at any depth.

    A bag is a run, with the tables of stamps that lie in its folder. In a folder without a bag, a table of poses and
    the tables of stamps beside it are a run; tables of stamps and logs are a run each. Names are paths within the
    folder.

    Args:
        path: Of a file or folder.
        stamps: How tables of stamps are laid out; a table that has its columns is one.
        poses: How tables of poses are laid out.
        kind: Format of other files: `auto` for what is in them, or one of `FORMATS`.

    Raises:
        ValueError: There is nothing at the path, or no run in it.
    """
    find = _Finder(stamps, poses or PosesFormat(), kind)
    if not path.exists():
        raise ValueError(f"path: got {path}, which is not there, expected a bag, a table or a folder of them")
    if not path.is_dir():
        check_regular(path)
        return [find.file(path)]
    folders = [path, *sorted(folder for folder in path.rglob("*") if folder.is_dir())]
    found = _told_apart([run for folder in folders for run in find.folder(path, folder)])
    if not found:
        wanted = f"{stamps.files} with the columns {stamps.uplink_send} and {stamps.downlink_receive}"
        raise ValueError(
            f"path: got {path}, which holds no run, expected rosbag2 folders, tables of poses, logs of tools, or "
            f"tables of stamps ({wanted})"
        )
    return found


def _told_apart(runs: list[RunFiles]) -> list[RunFiles]:
    """Runs of different names: files that differ in their ending alone are called by it too."""
    often = Counter(run.name for run in runs)
    return [replace(run, name=f"{run.name}{run.ending}") if often[run.name] > 1 else run for run in runs]


def _stem(path: Path) -> str:
    """The name of a run of one file."""
    return Path(path.name.removesuffix(".gz")).stem


@dataclass(frozen=True)
class _Finder:
    """What a file is."""

    stamps: StampsFormat
    poses: PosesFormat
    kind: str

    def file(self, path: Path) -> RunFiles:
        """The run of a file that was chosen by name.

        Raises:
            ValueError: It is nothing that is known.
        """
        if self.kind != "auto":
            return RunFiles(_stem(path), log=(path, self.kind))
        if is_bag(path) or path.suffix == ".bag":  # of those, what opens bags knows what to say
            return RunFiles(path.stem, bag=path)
        if self._has_poses(path):
            return RunFiles(_stem(path), poses=path)
        if not self._has_stamps(path) and (name := self._format(path)) is not None:
            return RunFiles(_stem(path), log=(path, name))
        if not is_table(path):
            raise ValueError(
                f"path: got {path}, expected a bag (.db3, .mcap) or a table ({', '.join(TABLES)}), or the log of a "
                f"tool: {', '.join(FORMATS)}" + (_HISTOGRAM.format(path) if path.suffix == ".xml" else "")
            )
        return RunFiles(_stem(path), stamps=tuple(_pairs([path], self.stamps, chosen=True)))

    def folder(self, root: Path, folder: Path) -> list[RunFiles]:
        """Runs directly in a folder."""
        name = folder.relative_to(root).as_posix() if folder != root else folder.resolve().name
        tables = sorted(file for file in folder.iterdir() if file.is_file() and is_table(file))
        poses = [file for file in tables if self._has_poses(file)]
        stamps = _pairs([file for file in tables if file not in poses], self.stamps, chosen=False)
        if is_bag(folder):
            return [RunFiles(name, bag=folder, stamps=tuple(stamps))]
        prefix = "" if folder == root else f"{name}/"
        paired = {each for pair in stamps for each in pair}
        others = [(file, self._format(file)) for file in tables if file not in poses and file not in paired]
        logs = [
            RunFiles(f"{prefix}{_stem(file)}", log=(file, kind)) for file, kind in others if kind not in (None, "table")
        ]
        faults = {file: self._fault(file) for file, kind in others if kind in (None, "table")}
        logs += [
            RunFiles(f"{prefix}{_stem(file)}", log=(file, ""), fault=fault) for file, fault in faults.items() if fault
        ]
        if len(poses) == 1:
            return [RunFiles(name, poses=poses[0], stamps=tuple(stamps)), *logs]
        runs = [RunFiles(f"{prefix}{_stem(file)}", poses=file) for file in poses]
        return runs + [RunFiles(f"{prefix}{_stem(file)}", stamps=((file, edge),)) for file, edge in stamps] + logs

    def _fault(self, path: Path) -> str:
        """What keeps a table in a folder from being a run; empty where it was not meant as one, such as a list."""
        try:
            names = names_of(path, self.stamps.separator, self.stamps.records)
        except (ValueError, OSError) as error:
            return str(error)
        if not names:
            return f"{path}: is empty, expected a table"
        wanted = [getattr(self.stamps, each) for each in STAMPS if getattr(self.stamps, each)]
        held = {header_unit(name)[0] for name in names} | set(names)
        missing = [name for name in wanted if name not in held]
        if len(missing) == len(wanted):
            return ""
        return f"{path}: has no column {missing[0]!r}; its columns are {listed(names)}" if missing else ""

    def _has_poses(self, path: Path) -> bool:
        return self.poses.found_in(columns_of(path, self.stamps))

    def _chosen(self) -> bool:
        """Whether somebody chose the layout of tables of stamps."""
        usual = StampsFormat()
        return any(getattr(self.stamps, each) != getattr(usual, each) for each in _OWN)

    def _has_stamps(self, path: Path) -> bool:
        names = columns_of(path, self.stamps)
        return {self.stamps.uplink_send, self.stamps.downlink_receive} <= {
            header_unit(name)[0] for name in names
        } | set(names)

    def _format(self, path: Path) -> str | None:
        """The format of a log of a tool, where none is looked for in vain."""
        return None if self._chosen() else found_format(path)


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
