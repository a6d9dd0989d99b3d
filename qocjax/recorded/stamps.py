"""Tables of a loop's four stamps: uplink send, edge receive, edge send, downlink receive; from CSV, Parquet or JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from qocjax.network.columns import names_of, read_columns
from qocjax.network.numbering import number_loops
from qocjax.network.period import epoch_unit
from qocjax.network.values import UNITS, header_unit
from qocjax.recorded.findings import Findings

__all__ = ["STAMPS", "TABLES", "Stamps", "StampsFormat", "columns_of", "is_table", "read_stamps"]

TABLES = (".csv", ".tsv", ".txt", ".log", ".parquet", ".json", ".jsonl", ".ndjson")
_LATEST = 1e11  # s; beyond, a unit cannot be right
STAMPS = ("uplink_send", "edge_receive", "edge_send", "downlink_receive")


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
    unit: str | None = None  # None for that in the names, of times since 1970, or s
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
    timed: bool = True  # whether the send stamps are times; else they only order the loops
    counted: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))  # [n] numbers that never begin anew


def read_stamps(path: Path, layout: StampsFormat, edge: Path | None, findings: Findings) -> list[Stamps]:
    """Reads a table, with the edge's own where there is one, as one part for each robot and session.

    Args:
        path: The robot's table, or the only one.
        layout: Its columns and unit.
        edge: The edge's table, joined by sequence number.
        findings: Takes the counts.

    Raises:
        ValueError: A file or column is not there or holds what is no number, or the unit is unknown or contradicts the
            stamps.
    """
    if layout.unit is not None and layout.unit not in UNITS:
        raise ValueError(f"stamps.unit: got {layout.unit!r}, expected one of {', '.join(UNITS)}")
    own = [name for name in (layout.sequence, *(getattr(layout, each) for each in STAMPS)) if name]
    if edge is not None:
        own = [name for name in own if name not in (layout.edge_receive, layout.edge_send)]
    labels = [name for name in (layout.robot, layout.session) if name]
    table, scales = _columns(path, own, labels, layout)
    count = len(next(iter(table.values())))
    if edge is not None:
        scales |= _join(table, path, edge, layout, findings)
    robots = table[layout.robot] if layout.robot else [""] * count
    sessions = table[layout.session] if layout.session else [""] * count
    groups: dict[tuple[str, str], list[int]] = {}
    for row, key in enumerate(zip(map(str, robots), map(str, sessions), strict=True)):
        groups.setdefault(key, []).append(row)
    lost = sum(_zeros_are_lost(table, layout))
    findings.count(path.name, "zero_stamps", lost)
    return [_part(table, scales, np.array(rows), key, layout) for key, rows in groups.items()]


def columns_of(path: Path, layout: StampsFormat) -> list[str]:
    """Names of a table's columns; none where it cannot be read as a table."""
    try:
        return names_of(path, layout.separator, layout.records)
    except ValueError:
        return []


def is_table(path: Path) -> bool:
    """Whether a file is called as tables are, packed or not."""
    return path.name.removesuffix(".gz").endswith(TABLES)


def _part(
    table: dict[str, Any], scales: dict[str, float], rows: NDArray[np.intp], key: tuple[str, str], layout: StampsFormat
) -> Stamps:
    """One robot's session, its times as floats since a whole second near them: one in ns is too long."""
    values = {each: table.get(str(getattr(layout, each))) for each in STAMPS}
    send = table[layout.uplink_send]
    first = next((send[k] for k in rows if _is_number(send[k])), 0)
    epoch = math.floor(first / scales[layout.uplink_send])
    parts: dict[str, Any] = {}
    for each, column in values.items():
        scale = scales.get(str(getattr(layout, each)), 1.0)
        origin = epoch * int(scale)
        given: list[Any] = [column[k] if column is not None else None for k in rows]
        parts[each] = np.array([(v - origin) / scale if _is_number(v) else math.nan for v in given], np.float64)
    sequence = table[layout.sequence] if layout.sequence else None
    numbers = [sequence[k] for k in rows] if sequence is not None else range(rows.size)
    return Stamps(
        robot=key[0], session=key[1], epoch=float(epoch), has_edge=values["edge_receive"] is not None,
        sequence=np.array([float(v) if _is_number(v) else math.nan for v in numbers]), numbered=sequence is not None,
        **parts,
    )  # fmt: skip


def _zeros_are_lost(table: dict[str, Any], layout: StampsFormat) -> list[bool]:
    """Empties receive stamps of 0 beside later send stamps, as OWAMP has them; which rows are lost by that."""
    send, receive = table[layout.uplink_send], table[layout.downlink_receive]
    lost = [value == 0 and _is_number(sent) and sent > 0 for value, sent in zip(receive, send, strict=True)]
    table[layout.downlink_receive] = [None if gone else value for gone, value in zip(lost, receive, strict=True)]
    for name in (layout.edge_receive, layout.edge_send):
        if name in table:
            table[name] = [None if v == 0 and gone else v for gone, v in zip(lost, table[name], strict=True)]
    return lost


def _is_number(value: Any) -> bool:
    return value is not None and math.isfinite(value)


def _columns(
    path: Path, names: list[str], labels: list[str], layout: StampsFormat
) -> tuple[dict[str, list], dict[str, float]]:
    """Columns as numbers with None where empty, those of labels as text; and units of the stamps that make a second."""
    found = read_columns(path, [*names, *labels], layout.separator, records=layout.records)
    table: dict[str, list] = {}
    units: dict[str, float | None] = {}
    for name in names:
        own = found.own_name(name)
        if name == layout.sequence:
            table[name] = found.optional_numbers(own)
        else:
            table[name], units[name] = found.times(own)
            units[name] = units[name] or _named(path, own, layout.unit)
    table |= {name: list(found.texts[found.own_name(name)]) for name in labels}
    usual = (
        epoch_unit([math.nan if v is None else v for v in table[layout.uplink_send]])
        if layout.uplink_send in table
        else None
    )
    scales = {name: unit or UNITS[layout.unit or usual or "s"] for name, unit in units.items()}
    for name, scale in scales.items():
        largest = max((abs(v) for v in table[name] if _is_number(v)), default=0.0) / scale
        if largest > _LATEST:
            unit = next(unit for unit, each in UNITS.items() if each == scale)
            raise ValueError(
                f"stamps.unit: got {unit!r} for column {name!r} of {path}, of which the largest would be {largest:.3g} "
                f"s, expected {epoch_unit([largest * scale]) or 'another'!r}"
            )
    return table, scales


def _named(path: Path, name: str, unit: str | None) -> float | None:
    """The unit in a column's name.

    Raises:
        ValueError: Another was given.
    """
    own = header_unit(name)[1]
    if own is not None and unit is not None and own != unit:
        raise ValueError(f"stamps.unit: got {unit!r} for column {name!r} of {path}, expected {own!r}, as it is called")
    return None if own is None else UNITS[own]


def _join(table: dict[str, list], path: Path, edge: Path, layout: StampsFormat, findings: Findings) -> dict[str, float]:
    """Adds the edge's stamps by sequence number; of a number that comes twice there, the first. Returns their units."""
    if not layout.sequence or not layout.edge_columns or not layout.edge_receive or not layout.edge_send:
        raise ValueError("stamps.edge_columns: expected names for sequence, edge receive and edge send with edge_files")
    number, receive, send = layout.edge_columns
    far = replace(layout, sequence=number, uplink_send=receive, downlink_receive=send)
    there, scales = _columns(edge, [number, receive, send], [], far)
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
    return {layout.edge_receive: scales[receive], layout.edge_send: scales[send]}


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
