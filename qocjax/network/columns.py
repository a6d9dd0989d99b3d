"""Columns of a table, with the place of every entry, so that an error can say where it is."""

from __future__ import annotations

import csv
import math
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from qocjax._reading import read_text
from qocjax.network.records import RECORDS, Rows, read_records

__all__ = ["UNITS", "Columns", "header_unit", "names_of", "read_columns", "table_of_text"]

UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
"""Units of time, as how many of them make a second."""

_LOST = ("", "lost", "nan", "none", "null", "na", "n/a")
_BLANK = " "
_UNIT = r"sec|msec|usec|nsec|seconds|s|ms|us|µs|μs|ns"
_WITH_UNIT = re.compile(rf"([+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*({_UNIT})")
_NAMED_UNIT = re.compile(rf"(.*?)\s*(?:[(\[]\s*({_UNIT})\s*[)\]]|[_.](ms|us|ns))")
_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")


def header_unit(name: str) -> tuple[str, str | None]:
    """Splits `pub_time(ms)`, `delay [us]` or `rtt_ms` into the name and its unit, None where it has none."""
    found = _NAMED_UNIT.fullmatch(name.strip())
    if found is None or not found[1]:
        return name.strip(), None
    return found[1], _unit(found[2] or found[3])


def _unit(text: str) -> str:
    short = text.replace("µ", "u").replace("μ", "u").removesuffix("ec")
    return "s" if short.startswith("s") else short


@dataclass(frozen=True)
class Columns:
    """Some columns of a table."""

    path: Path
    lines: list[int]  # of each row in the file, counted from 1
    texts: dict[str, list[str]]  # by column
    names: tuple[str, ...] = ()  # of all columns
    separator: str = ","
    place: str = "line"  # what `lines` counts

    def where(self, row: int, column: str) -> str:
        """Names the place of an entry, for an error."""
        return f"{self.path}, {self.place} {self.lines[row]}, column {column!r}"

    def own_name(self, column: str) -> str:
        """What the table calls a column that it has."""
        return _own_name(self.path, column, list(self.names))

    def numbers(self, column: str) -> list[float]:
        """Returns a column as finite numbers; whole ones stay integers, of any length.

        Raises:
            ValueError: An entry is no number, NaN or infinite.
        """
        texts = self._pointed(column)
        values = [self._number(row, column, text) for row, text in enumerate(texts)]
        for row, value in enumerate(values):
            if math.isinf(value):
                raise ValueError(f"{self.where(row, column)}: got {texts[row]!r}, expected a finite number")
        return values

    def delays(self, column: str, unit: str | None) -> list[float]:
        """Returns a column of delays in s; an empty entry, `lost`, NaN and infinity are a lost message: infinity.

        Args:
            column: Its name.
            unit: s, ms, us or ns; None for that in the name, or at each number.

        Raises:
            ValueError: The unit is unknown or another than the name says, an entry is no number or negative, or all
                messages are lost.
        """
        unit = self._unit_of(column, unit)
        texts = self._pointed(column)
        values = [self._delay(row, column, text, unit) for row, text in enumerate(texts)]
        if not any(math.isfinite(value) for value in values):
            raise ValueError(f"{self.path}, column {column!r}: all {len(values)} are lost, expected at least one delay")
        return values

    def optional_numbers(self, column: str) -> list[float | None]:
        """Returns a column as numbers, None where an entry is empty, `lost`, NaN or infinite.

        Raises:
            ValueError: An entry is no number.
        """
        blank = (*_LOST, "inf", "-inf")
        texts = self._pointed(column)
        return [None if text.lower() in blank else self._number(row, column, text) for row, text in enumerate(texts)]

    def times(self, column: str) -> tuple[list[float | None], float | None]:
        """Returns a column of times, None where there is none, and how many of their units make a second.

        That is 1e9 for timestamps such as `2026-01-08 17:22:58.123456` (without a zone they count as UTC), and None for
        plain numbers, which do not say.

        Raises:
            ValueError: An entry is neither a number nor a timestamp.
        """
        texts = self.texts[column]
        first = next((text for text in texts if text.lower() not in (*_LOST, "nat")), "")
        if not re.match(r"\d{4}-?\d\d-?\d\d[T ]\d", first):
            return self.optional_numbers(column), None
        return [
            None if text.lower() in (*_LOST, "nat") else self._stamp(row, column) for row, text in enumerate(texts)
        ], 1e9

    def _stamp(self, row: int, column: str) -> int:
        import pandas as pd

        try:
            found = pd.Timestamp(self.texts[column][row])
            return int((found if found.tz else found.tz_localize("UTC")).as_unit("ns").value)
        except (ValueError, OverflowError):
            text = self.texts[column][row]
            raise ValueError(f"{self.where(row, column)}: got {text!r}, expected a timestamp") from None

    def _unit_of(self, column: str, unit: str | None) -> str:
        own, got = header_unit(column)[1], f"unit: got {unit!r} for column {column!r} of {self.path}, expected"
        if unit is not None and unit not in UNITS:
            raise ValueError(f"{got} {_listed(UNITS)}")
        if unit is not None and own is not None and own != unit:
            raise ValueError(f"{got} {own!r}, as it is called")
        if unit is None and own is None:
            given = [text for text in self.texts[column] if text.lower() not in (*_LOST, "inf")]
            if not all(_WITH_UNIT.fullmatch(text) for text in given):
                raise ValueError(f"{got} {_listed(UNITS)}, which its name does not say")
        return unit or own or "s"

    def _pointed(self, column: str) -> list[str]:
        """The texts of a column, with a decimal point where it has decimal commas throughout."""
        texts = self.texts[column]
        if self.separator == "," or not any("," in text for text in texts):
            return texts
        commas = [text for text in texts if "," in text]
        if any("." in text for text in texts) or not all(_COMMA.fullmatch(text) for text in commas):
            return texts
        return [text.replace(",", ".") for text in texts]

    def _delay(self, row: int, column: str, text: str, unit: str) -> float:
        if text.lower() in _LOST:
            return math.inf
        own = _WITH_UNIT.fullmatch(text)
        if own is not None:
            text, unit = own[1], _unit(own[2])
        delay = self._number(row, column, text)
        if delay < 0:
            raise ValueError(f"{self.where(row, column)}: got {text}, expected a delay >= 0")
        return delay / UNITS[unit]

    def _number(self, row: int, column: str, text: str) -> float:
        for kind in (int, float):
            try:
                value = kind(text)
                float(value)
            except (ValueError, OverflowError):
                continue
            too_large = math.isinf(value) and "inf" not in text.lower()
            if "_" not in text and not math.isnan(value) and not too_large:
                return value
        raise ValueError(f"{self.where(row, column)}: got {text[:60]!r}, expected a number")


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
    return next(_rows(path, read_text(path), separator, 1), (0, []))[1]


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
    own = [_own_name(path, column, names) for column in columns]
    more = [name for name in names if also is not None and also(name) and names.count(name) == 1]
    index = {column: names.index(column) for column in (*own, *more)}
    found = Columns(path, [], {column: [] for column in index}, tuple(names), rows.separator, rows.place)
    longest = len(names)
    for line, fields in rows.rows:
        longest = max(longest, len(fields))
        found.lines.append(line)
        for column, k in index.items():
            found.texts[column].append(fields[k])
    if not found.lines:
        raise ValueError(f"{path}: has no row below its line of names")
    if longest > len(names):
        text = f"{path}: has rows of {longest} fields for {len(names)} names; the last are left out"
        warnings.warn(text, stacklevel=2)
    return found


def _own_name(path: Path, column: str, names: list[str]) -> str:
    """What the table calls a column."""
    if names.count(column) == 1:
        return column
    alike = [name for name in names if header_unit(name) == (column, header_unit(name)[1])]
    if column not in names and len(alike) == 1:
        return alike[0]
    state = "more than one" if column in names or alike else "no"
    raise ValueError(f"{path}: has {state} column {column!r}; its columns are {_listed(names)}")


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
        width = width or len(fields)
        if len(fields) < width or (len(fields) > width and separator != _BLANK):
            raise ValueError(f"{path}, line {number}: has {len(fields)} fields, expected {width}, one for each name")
        yield number, fields


def _split(line: str, separator: str, width: int) -> list[str]:
    """The fields of a line, without empty ones beyond `width`."""
    fields = (
        line.split() if separator == _BLANK else next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    )
    if len(fields) < width and separator == _BLANK:  # two blanks may enclose an empty field
        single = re.split(r"[ \t]", line)
        fields = single if not any(single[width:]) else fields
    while width and len(fields) > width and not fields[-1].strip():
        fields.pop()
    return [field.strip() for field in fields]


def _listed(words: Iterable[str]) -> str:
    words = list(words)
    return ", ".join(repr(word[:60]) for word in words[:40]) + (", ..." if len(words) > 40 else "")
