"""Tables that know types, as rows of text: JSON, JSON lines and Parquet."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from qocjax._reading import check_regular, decoding, read_text
from qocjax._room import check_room

__all__ = ["RECORDS", "Rows", "parsed_json", "read_records"]

RECORDS = (".json", ".jsonl", ".ndjson")


@dataclass(frozen=True)
class Rows:
    """A table before columns are chosen."""

    names: list[str]
    rows: Iterable[tuple[int, list[str]]]  # with their places in the file
    separator: str = ","
    place: str = "record"  # what the places count


def parsed_json(path: Path, text: str) -> Any:
    """The content of a JSON file.

    Raises:
        ValueError: It is no JSON, nested too deep, or holds a number that is too long.
    """
    try:
        with decoding(path, "JSON"):
            return json.loads(text)
    except ValueError as error:
        where = getattr(error.__context__, "lineno", None)
        if where is None:
            raise
        message = getattr(error.__context__, "msg", "")
        raise ValueError(f"{path}, line {where}: is no JSON: {message}") from None


def read_records(path: Path, place: str | None = None) -> Rows:
    """Reads a list of records, or a Parquet table; what is nested gets names such as `client.send`.

    Args:
        path: The file.
        place: In JSON, where the list of records is, such as `results.frames`.

    Raises:
        ValueError: The file cannot be read or holds no list of records.
    """
    if path.suffix == ".parquet":
        return _parquet(path)
    text = read_text(path)
    lines = [(number, line) for number, line in enumerate(text.split("\n"), start=1) if line.strip()]
    if (
        place is None
        and len(lines) > 0
        and all(line.lstrip().startswith("{") for _, line in lines)
        and (len(lines) > 1 or not path.name.removesuffix(".gz").endswith(".json"))
    ):
        found = [(number, _line(path, number, line)) for number, line in lines]
        return _rows(path, found, "line")
    return _rows(path, list(enumerate(_listed(path, parsed_json(path, text), place), start=1)), "record")


def _line(path: Path, number: int, line: str) -> dict[str, Any]:
    with decoding(f"{path}, line {number}", "JSON"):
        found = json.loads(line)
    if not isinstance(found, dict):
        raise ValueError(f"{path}, line {number}: got {type(found).__name__}, expected an object")
    return found


def _listed(path: Path, here: Any, place: str | None) -> list[dict[str, Any]]:
    for name in place.split(".") if place else ():
        if not isinstance(here, dict) or name not in here:
            raise ValueError(f"{path}: has no {name!r} of stamps.records={place}, expected a path to a list of records")
        here = here[name]
    if not isinstance(here, list) or not here or not all(isinstance(record, dict) for record in here):
        raise ValueError(f"{path}: got {type(here).__name__} at stamps.records={place}, expected a list of records")
    return here


def _rows(path: Path, records: list[tuple[int, dict[str, Any]]], place: str) -> Rows:
    with decoding(path, "a list of records"):
        flat = [(number, _flat(record)) for number, record in records]
    names = list(dict.fromkeys(name for _, record in flat for name in record))
    return Rows(names, [(number, [record.get(name, "") for name in names]) for number, record in flat], place=place)


def _flat(record: dict[str, Any], above: str = "") -> dict[str, str]:
    found: dict[str, str] = {}
    for name, value in record.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{above}{name}.")
        else:
            found[above + name] = "" if value is None else str(value)
    return found


_CELL = 50  # bytes of a text, at least


def _parquet(path: Path) -> Rows:
    check_regular(path)
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise ValueError(f"{path}: needs pyarrow to be read, expected it: pip install 'qocjax[parquet]'") from None
    with decoding(path, "Parquet"):
        about = pq.read_metadata(path)
        many, packed = about.num_rows * about.num_columns, [about.row_group(k) for k in range(about.num_row_groups)]
        check_room(str(path), f"{about.num_rows} rows of {about.num_columns} columns",
                   max(_CELL * many, sum(group.total_byte_size for group in packed)), "a part of them")  # fmt: skip
        table = pq.read_table(path)
        columns = []
        for column in table.columns:
            if pa.types.is_timestamp(column.type):
                column = column.cast(pa.timestamp("ns")).to_pandas()
                columns.append(["" if each else str(stamp) for each, stamp in zip(column.isna(), column, strict=True)])
            else:
                columns.append(["" if value is None else str(value) for value in column.to_pylist()])
        rows = [(number, list(fields)) for number, fields in enumerate(zip(*columns, strict=True), start=1)]
        return Rows([str(name) for name in table.column_names], rows, place="row")
