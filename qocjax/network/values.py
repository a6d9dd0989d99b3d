"""Columns of a table as numbers, delays and times, with the place of every entry for errors."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

__all__ = ["UNITS", "Columns", "header_unit", "listed", "own_name"]

UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
"""Units of time, as how many of them make a second."""

_LOST = ("", "lost", "nan", "none", "null", "na", "n/a")
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
        return own_name(self.path, column, list(self.names))

    def numbers(self, column: str) -> list[float]:
        """Returns a column as finite numbers; whole ones stay integers, of any length.

        Raises:
            ValueError: An entry is no number, NaN or infinite.
        """
        texts = self._pointed(column)
        quick = _quick(texts)
        if quick is not None and not any(value != value for value in quick):
            return quick
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
        quick = _quick(texts)
        if quick is not None and min(quick) >= 0.0:
            scale = UNITS[unit]
            values = [value / scale if value == value else math.inf for value in quick]
        else:
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
        if (quick := _quick(texts)) is not None:
            return [value if value == value else None for value in quick]
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
            raise ValueError(f"{got} {listed(UNITS)}")
        if unit is not None and own is not None and own != unit:
            raise ValueError(f"{got} {own!r}, as it is called")
        if unit is None and own is None:
            given = [text for text in self.texts[column] if text.lower() not in (*_LOST, "inf")]
            if not all(_WITH_UNIT.fullmatch(text) for text in given):
                raise ValueError(f"{got} {listed(UNITS)}, which its name does not say")
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


def own_name(path: Path, column: str, names: list[str]) -> str:
    """What a table calls a column: its name, or the only one that is the same but for a unit.

    Raises:
        ValueError: There is none, or more than one.
    """
    if names.count(column) == 1:
        return column
    alike = [name for name in names if header_unit(name) == (column, header_unit(name)[1])]
    if column not in names and len(alike) == 1:
        return alike[0]
    state = "more than one" if column in names or alike else "no"
    raise ValueError(f"{path}: has {state} column {column!r}; its columns are {listed(names)}")


def listed(words: Iterable[str]) -> str:
    """Names in quotes, for an error."""
    words = list(words)
    return ", ".join(repr(word[:60]) for word in words[:40]) + (", ..." if len(words) > 40 else "")


def _quick(texts: list[str]) -> list[float] | None:
    """Numbers of texts that are plain ones throughout, NaN where empty; None where each must be looked at."""
    try:
        if "_" in "".join(texts):
            return None
        if all(map(str.isdigit, texts)) and max(map(len, texts)) < 300:
            return list(map(int, texts))
        if any(len(text) > 15 and text.isdigit() for text in texts):
            return None  # more digits than a float has
        values = np.array([text or "nan" for text in texts], np.float64)
    except ValueError:
        return None
    odd = np.flatnonzero(~np.isfinite(values)).tolist()
    return None if any(texts[row].lower() not in ("", "nan") for row in odd) else values.tolist()
