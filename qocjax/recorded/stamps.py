"""Tables of a loop's four stamps: uplink send, edge receive, edge send, downlink receive; from CSV, Parquet or JSON."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from qocjax._reading import read_text
from qocjax.network.columns import UNITS, read_columns
from qocjax.network.numbering import number_loops
from qocjax.recorded.findings import Findings

__all__ = ["TABLES", "Stamps", "StampsFormat", "columns_of", "read_stamps"]

TABLES = (".csv", ".txt", ".parquet", ".json")
_STAMPS = ("uplink_send", "edge_receive", "edge_send", "downlink_receive")


@dataclass(frozen=True)
class StampsFormat:
    """How a table of stamps is laid out."""

    sequence: str | None = "sequence"  # column names; None where there is none
    uplink_send: str = "uplink_send"
    edge_receive: str | None = "edge_receive"
    edge_send: str | None = "edge_send"
    downlink_receive: str = "downlink_receive"
    robot: str | None = None  # column of the robot's name: a trace each
    session: str | None = None  # column of sessions: numbering and clocks begin anew in each
    unit: str = "s"
    files: str = "*"  # pattern of the file names of the robot's side
    edge_files: str | None = None  # pattern of the edge's own file, paired by the words in braces
    edge_columns: tuple[str, str, str] | None = None  # sequence, edge receive, edge send there
    records: str | None = None  # path to the list of records in JSON, such as run_results.frames
    separator: str | None = None


@dataclass(frozen=True)
class Stamps:
    """Stamps of one robot and session, in the order of the file; NaN where there is none."""

    robot: str
    session: str
    sequence: NDArray[np.float64]  # [n]
    uplink_send: NDArray[np.float64]  # [n] s since `epoch`, robot's clock
    edge_receive: NDArray[np.float64]  # [n] s, edge's clock
    edge_send: NDArray[np.float64]  # [n] s, edge's clock
    downlink_receive: NDArray[np.float64]  # [n] s, robot's clock
    epoch: float = 0.0  # s
    has_edge: bool = True
    numbered: bool = True  # whether the table has numbers of its own
    counted: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))  # [n] numbers that never begin anew


def read_stamps(path: Path, layout: StampsFormat, edge: Path | None, findings: Findings) -> list[Stamps]:
    """Reads a table, with the edge's own where there is one, as one part for each robot and session.

    Args:
        path: The robot's table, or the only one.
        layout: Its columns and unit.
        edge: The edge's table, joined by sequence number.
        findings: Takes the counts.

    Raises:
        ValueError: A file or column is not there or holds what is no number, or the unit is unknown.
    """
    if layout.unit not in UNITS:
        raise ValueError(f"stamps.unit: got {layout.unit!r}, expected one of {', '.join(UNITS)}")
    own = [name for name in (layout.sequence, *(getattr(layout, each) for each in _STAMPS)) if name]
    if edge is not None:
        own = [name for name in own if name not in (layout.edge_receive, layout.edge_send)]
    labels = [name for name in (layout.robot, layout.session) if name]
    table = _columns(path, own, labels, layout)
    count = len(next(iter(table.values())))
    if edge is not None:
        _join(table, path, edge, layout, findings)
    robots = table[layout.robot] if layout.robot else [""] * count
    sessions = table[layout.session] if layout.session else [""] * count
    groups: dict[tuple[str, str], list[int]] = {}
    for row, key in enumerate(zip(map(str, robots), map(str, sessions), strict=True)):
        groups.setdefault(key, []).append(row)
    return [_part(table, np.array(rows), key, layout) for key, rows in groups.items()]


def columns_of(path: Path, layout: StampsFormat) -> list[str]:
    """Names of a table's columns; none where it cannot be read as a table."""
    try:
        if path.suffix == ".parquet":
            return list(_parquet(path).read_schema(path).names)
        if path.suffix == ".json":
            return list(_records(path, layout.records)[0])
        line = next((text for text in read_text(path).split("\n") if text.strip() and text[0] != "#"), "")
    except (ValueError, OSError):
        return []
    mark = layout.separator or next((mark for mark in ",;\t" if mark in line), None)
    return [name.strip().strip('"') for name in line.split(mark)]


def _part(table: dict[str, Any], rows: NDArray[np.intp], key: tuple[str, str], layout: StampsFormat) -> Stamps:
    """One robot's session, its times as floats since a whole second near them: one in ns is too long."""
    scale = UNITS[layout.unit]
    values = {each: table.get(str(getattr(layout, each))) for each in _STAMPS}
    first = next((table[layout.uplink_send][k] for k in rows if _is_number(table[layout.uplink_send][k])), 0)
    epoch = math.floor(first / scale)
    origin = epoch * int(scale)
    parts = {}
    for each, column in values.items():
        given: list[Any] = [column[k] if column is not None else None for k in rows]
        parts[each] = np.array([(v - origin) / scale if _is_number(v) else math.nan for v in given], np.float64)
    sequence = table[layout.sequence] if layout.sequence else None
    numbers = [sequence[k] for k in rows] if sequence is not None else range(rows.size)
    return Stamps(
        robot=key[0], session=key[1], epoch=float(epoch), has_edge=values["edge_receive"] is not None,
        sequence=np.array([float(v) if _is_number(v) else math.nan for v in numbers]), numbered=sequence is not None,
        **parts,
    )  # fmt: skip


def _is_number(value: Any) -> bool:
    return value is not None and math.isfinite(value)


def _columns(path: Path, names: list[str], labels: list[str], layout: StampsFormat) -> dict[str, list]:
    """Columns as numbers with None where empty, and those of labels as text."""
    if path.suffix in (".parquet", ".json"):
        return _typed(path, names, labels, layout)
    found = read_columns(path, [*names, *labels], layout.separator)
    return {name: found.optional_numbers(name) for name in names} | {name: found.texts[name] for name in labels}


def _typed(path: Path, names: list[str], labels: list[str], layout: StampsFormat) -> dict[str, list]:
    """Columns of a file that knows types."""
    table: dict[str, list]
    if path.suffix == ".parquet":
        here = _parquet(path).read_schema(path).names
        _check_names(path, [*names, *labels], here)
        table = _parquet(path).read_table(path, columns=[*names, *labels]).to_pydict()
    else:
        records = _records(path, layout.records)
        _check_names(path, [*names, *labels], list(records[0]))
        table = {name: [record.get(name) for record in records] for name in (*names, *labels)}
    for name in names:
        for row, value in enumerate(table[name]):
            if value is not None and (isinstance(value, bool) or not isinstance(value, (int, float))):
                raise ValueError(f"{path}, row {row + 1}, column {name!r}: got {value!r}, expected a number")
    return table


def _parquet(path: Path) -> Any:
    try:
        import pyarrow.parquet
    except ImportError:
        raise ValueError(f"{path}: needs pyarrow to be read, expected it: pip install 'qocjax[parquet]'") from None
    try:
        pyarrow.parquet.read_schema(path)
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: cannot be read as Parquet: {str(error).splitlines()[0]}") from None
    return pyarrow.parquet


def _records(path: Path, place: str | None) -> list[dict[str, Any]]:
    """The list of records at a path such as `run_results.frames`."""
    try:
        here = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise ValueError(f"{path}, line {error.lineno}: is no JSON: {error.msg}") from None
    for name in place.split(".") if place else ():
        if not isinstance(here, dict) or name not in here:
            raise ValueError(f"{path}: has no {name!r} of stamps.records={place}, expected a path to a list of records")
        here = here[name]
    if not isinstance(here, list) or not here or not all(isinstance(record, dict) for record in here):
        raise ValueError(f"{path}: got {type(here).__name__} at stamps.records={place}, expected a list of records")
    return here


def _check_names(path: Path, names: list[str], here: list[str]) -> None:
    for name in names:
        if name not in here:
            listed = ", ".join(repr(each) for each in here)
            raise ValueError(f"{path}: has no column {name!r}; its columns are {listed}")


def _join(table: dict[str, list], path: Path, edge: Path, layout: StampsFormat, findings: Findings) -> None:
    """Adds the edge's stamps by sequence number; of a number that comes twice there, the first."""
    if not layout.sequence or not layout.edge_columns or not layout.edge_receive or not layout.edge_send:
        raise ValueError("stamps.edge_columns: expected names for sequence, edge receive and edge send with edge_files")
    number, receive, send = layout.edge_columns
    there = _columns(edge, [number, receive, send], [], layout)
    keys, own = _keys(there[number], table[layout.sequence], edge, path)
    stamps: dict[Any, tuple[Any, Any]] = {}
    for key, *both in zip(keys, there[receive], there[send], strict=True):
        stamps.setdefault(key, (both[0], both[1]))
    findings.count(edge.name, "duplicates", len(keys) - len(stamps))
    unknown = len(stamps.keys() - set(own))
    if unknown:
        findings.note(f"{edge.name}: {unknown} numbers are not in {path.name}; left out")
    found = [stamps.get(key, (None, None)) for key in own]
    table[layout.edge_receive], table[layout.edge_send] = ([pair[k] for pair in found] for k in (0, 1))


def _keys(there: list, here: list, edge: Path, path: Path) -> tuple[list, list]:
    """What the rows of both tables are joined by: numbers, or what they mean where they begin anew or wrap."""
    both = []
    for column in (there, here):
        rows = [k for k, each in enumerate(column) if _is_number(each)]
        found = number_loops([column[k] for k in rows]) if rows else None
        both.append((found, rows, min((column[k] for k in rows), default=0)))
    (far, *_), (near, *_) = both
    if near is None or far is None or not (near.restarts or near.wraps):
        return there, here
    if (far.restarts, far.wraps) != (near.restarts, near.wraps):
        raise ValueError(
            f"{edge}: its numbers begin anew {far.restarts} times and wrap {far.wraps} times, those of {path.name} "
            f"{near.restarts} and {near.wraps} times, expected the same: the rows cannot be joined"
        )
    keys: list[list] = []
    for (found, rows, low), column in zip(both, (there, here), strict=True):
        own: list = [None] * len(column)
        for k, row in enumerate(rows):
            own[row] = (int(found.session[k]), low + float(found.number[k]))  # type: ignore[union-attr]
        keys.append(own)
    return keys[0], keys[1]
