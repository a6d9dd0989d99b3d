"""Columns of a text table, with the line of every entry, so that an error can say where it is."""

from __future__ import annotations

import csv
import math
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from qocjax._reading import read_text

__all__ = ["UNITS", "Columns", "read_columns"]

UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
"""Units of time, as how many of them make a second."""

_LOST = ("", "lost")
_BLANK = " "


@dataclass(frozen=True)
class Columns:
    """Some columns of a table."""

    path: Path
    lines: list[int]  # of each row in the file, counted from 1
    texts: dict[str, list[str]]  # by column
    names: tuple[str, ...] = ()  # of all columns

    def where(self, row: int, column: str) -> str:
        """Names the place of an entry, for an error."""
        return f"{self.path}, line {self.lines[row]}, column {column!r}"

    def numbers(self, column: str) -> list[float]:
        """Returns a column as finite numbers; whole ones stay integers, of any length.

        Raises:
            ValueError: An entry is no number, NaN or infinite.
        """
        values = [self._number(row, column) for row in range(len(self.lines))]
        for row, value in enumerate(values):
            if math.isinf(value):
                text = self.texts[column][row]
                raise ValueError(f"{self.where(row, column)}: got {text!r}, expected a finite number")
        return values

    def delays(self, column: str, unit: str) -> list[float]:
        """Returns a column of delays in s; an empty entry, `lost` and `inf` are a lost message: infinity.

        Raises:
            ValueError: The unit is unknown, an entry is no number, NaN or negative, or all messages are lost.
        """
        if unit not in UNITS:
            raise ValueError(f"unit: got {unit!r} for column {column!r} of {self.path}, expected {_listed(UNITS)}")
        values = [self._delay(row, column) / UNITS[unit] for row in range(len(self.lines))]
        if not any(math.isfinite(value) for value in values):
            raise ValueError(f"{self.path}, column {column!r}: all {len(values)} are lost, expected at least one delay")
        return values

    def optional_numbers(self, column: str) -> list[float | None]:
        """Returns a column as numbers, None where an entry is empty or `lost`; infinity and NaN count as empty.

        Raises:
            ValueError: An entry is no number.
        """
        blank = (*_LOST, "nan", "inf", "-inf")
        texts = self.texts[column]
        return [None if text.lower() in blank else self._number(row, column) for row, text in enumerate(texts)]

    def _delay(self, row: int, column: str) -> float:
        if self.texts[column][row].lower() in _LOST:
            return math.inf
        delay = self._number(row, column)
        if delay < 0:
            raise ValueError(f"{self.where(row, column)}: got {self.texts[column][row]}, expected a delay >= 0")
        return delay

    def _number(self, row: int, column: str) -> float:
        text = self.texts[column][row]
        for kind in (int, float):
            try:
                value = kind(text)
            except ValueError:
                continue
            if "_" not in text and not math.isnan(value):
                return value
        raise ValueError(f"{self.where(row, column)}: got {text!r}, expected a number")


def read_columns(
    path: str | Path,
    columns: Sequence[str],
    separator: str | None = None,
    also: Callable[[str], bool] | None = None,
) -> Columns:
    """Reads columns by name from a text table: one line of names, then one row a line.

    Blank lines and lines that begin with `#` are skipped. In a table separated by blanks, fields beyond the names are
    left out, with a warning.

    Args:
        path: The file.
        columns: Names of the columns wanted.
        separator: One character; a blank stands for any run of blanks and tabs. None takes the first of comma,
            semicolon and tab that the line of names has, else blanks.
        also: Tells by its name whether another column is read as well.

    Raises:
        ValueError: The file cannot be read, a column is missing or named twice, a row has too few or too many fields,
            or there is no row.
    """
    path = Path(path)
    rows = _rows(path, separator)
    _, names = next(rows, (0, []))
    for column in columns:
        if names.count(column) != 1:
            state = "more than one" if column in names else "no"
            raise ValueError(f"{path}: has {state} column {column!r}; its columns are {_listed(names)}")
    more = [name for name in names if also is not None and also(name) and names.count(name) == 1]
    index = {column: names.index(column) for column in (*columns, *more)}
    found = Columns(path, [], {column: [] for column in index}, tuple(names))
    longest = len(names)
    for line, fields in rows:
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


def _rows(path: Path, separator: str | None) -> Iterator[tuple[int, list[str]]]:
    """The rows with their lines; the first is the line of names."""
    if separator is not None and len(separator) != 1:
        raise ValueError(f"separator: got {separator!r}, expected one character, a blank for blanks, or None")
    width = 0
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        separator = separator or next((mark for mark in ",;\t" if mark in line), _BLANK)
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
    return ", ".join(repr(word) for word in words)
