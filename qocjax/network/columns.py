"""Tables from files, as columns: text with any usual separator, JSON, JSON lines and Parquet, packed or not."""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from qocjax._reading import read_text
from qocjax.network.records import RECORDS, Rows, read_records
from qocjax.network.values import UNITS, Columns, own_name

__all__ = ["UNITS", "Columns", "names_of", "read_columns", "table_of_text"]

_BLANK = " "
_HEAD = 2**16  # bytes in which the names of columns stand


def read_columns(
    path: str | Path,
    columns: Sequence[str],
    separator: str | None = None,
    also: Callable[[str], bool] | None = None,
    records: str | None = None,
) -> Columns:
    """Reads columns by name from a table: text, JSON, JSON lines or Parquet, packed by gzip or not.

    A text table has one line of names, then one row a line; blank lines and lines that begin with `#` are skipped. In
    one separated by blanks, fields beyond the names are left out, with a warning. A name that is not there stands for
    the only one that is the same but for a unit, as `delay` for `delay(ms)`.

    Args:
        path: The file.
        columns: Names of the columns wanted; in JSON such as `timestamps.client.send.wall` for what is nested.
        separator: One character; a blank stands for any run of blanks and tabs. None takes the first of comma,
            semicolon and tab that the line of names has, else blanks.
        also: Tells by its name whether another column is read as well.
        records: In JSON, where the list of records is, such as `results.frames`.

    Returns:
        The columns under the names that the table has.

    Raises:
        ValueError: The file cannot be read, a column is missing or named twice, a row has too few or too many fields,
            or there is no row.
    """
    path = Path(path)
    if path.suffix == ".parquet" or path.name.removesuffix(".gz").endswith(RECORDS):
        return _wanted(path, read_records(path, records), columns, also)
    return table_of_text(path, read_text(path), columns, separator, also)


def names_of(path: Path, separator: str | None = None, records: str | None = None) -> list[str]:
    """Names of the columns of a table.

    Raises:
        ValueError: The file cannot be read as one.
    """
    if path.suffix == ".parquet" or path.name.removesuffix(".gz").endswith(RECORDS):
        return read_records(path, records).names
    return next(_rows(path, read_text(path, _HEAD), separator, 1), (0, []))[1]


def table_of_text(
    path: Path,
    text: str,
    columns: Sequence[str],
    separator: str | None = None,
    also: Callable[[str], bool] | None = None,
    first: int = 1,
) -> Columns:
    """As `read_columns`, of what was read already.

    Args:
        path: For errors.
        text: Of the table.
        columns: See there.
        separator: See there.
        also: See there.
        first: Line of the file at which the text begins.
    """
    rows = _rows(path, text, separator, first)
    _, names = next(rows, (0, []))
    return _wanted(path, Rows(names, rows, _mark(text, separator), "line"), columns, also)


def _wanted(path: Path, rows: Rows, columns: Sequence[str], also: Callable[[str], bool] | None) -> Columns:
    names = rows.names
    own = [own_name(path, column, names) for column in columns]
    more = [name for name in names if also is not None and also(name) and names.count(name) == 1]
    index = {column: names.index(column) for column in (*own, *more)}
    found = Columns(path, [], {column: [] for column in index}, tuple(names), rows.separator, rows.place)
    longest, places = len(names), [(found.texts[column], k) for column, k in index.items()]
    for line, fields in rows.rows:
        longest = max(longest, len(fields))
        found.lines.append(line)
        for texts, k in places:
            texts.append(fields[k].strip())
    if not found.lines:
        raise ValueError(f"{path}: has no row below its line of names")
    if longest > len(names):
        text = f"{path}: has rows of {longest} fields for {len(names)} names; the last are left out"
        warnings.warn(text, stacklevel=2)
    return found


def _mark(text: str, separator: str | None) -> str:
    line = next((line for line in text.split("\n") if line.strip() and not line.startswith("#")), "")
    return separator or next((mark for mark in ",;\t" if mark in line), _BLANK)


def _rows(path: Path, text: str, separator: str | None, first: int) -> Iterator[tuple[int, list[str]]]:
    """The rows with their lines; the first is the line of names."""
    if separator is not None and len(separator) != 1:
        raise ValueError(f"separator: got {separator!r}, expected one character, a blank for blanks, or None")
    width = 0
    separator = _mark(text, separator)
    for number, line in enumerate(text.split("\n"), start=first):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            fields = _split(line, separator, width)
        except csv.Error as error:
            raise ValueError(f"{path}, line {number}: is no row of a table: {error}") from None
        if not width:
            fields = [field.strip() for field in fields]
            width = len(fields)
        if len(fields) < width or (len(fields) > width and separator != _BLANK):
            raise ValueError(f"{path}, line {number}: has {len(fields)} fields, expected {width}, one for each name")
        yield number, fields


def _split(line: str, separator: str, width: int) -> list[str]:
    """The fields of a line, without empty ones beyond `width`."""
    if separator != _BLANK and '"' not in line:
        fields = line.split(separator)
    elif separator == _BLANK:
        fields = line.split()
    else:
        fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    if len(fields) == width:
        return fields
    if len(fields) < width and separator == _BLANK:  # two blanks may enclose an empty field
        single = re.split(r"[ \t]", line)
        fields = single if not any(single[width:]) else fields
    while width and len(fields) > width and not fields[-1].strip():
        fields.pop()
    return fields
