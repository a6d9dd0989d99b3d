"""Measured delays from files: samples and traces from CSV or text tables, histograms from XML."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from qocjax._reading import read_text
from qocjax.network.columns import UNITS, Columns, read_columns
from qocjax.network.empirical import Empirical, QuantileTable
from qocjax.network.period import SEND_TIMES, epoch_unit, header_unit, is_send_time, period_of
from qocjax.network.trace import Trace

__all__ = ["read_histogram", "read_samples", "read_trace"]

_MOST_GAPS = 100  # numbers per row of a sequence; above, it does not count loops


def read_samples(path: str | Path, column: str, unit: str, *, separator: str | None = None) -> Empirical:
    """Reads a column of delays as a law; their order does not matter.

    Args:
        path: CSV or text table with a line of names (see `read_columns`).
        column: Name of the column. An empty entry, `lost` and `inf` are a lost message.
        unit: Unit of the column: s, ms, us or ns.
        separator: One character, a blank for any run of blanks; None to see from the line of names.

    Raises:
        ValueError: The file, the column, the unit or an entry is not as expected, or every message is lost.
    """
    table = read_columns(path, [column], separator)
    return Empirical(table.delays(column, unit), source=str(path))


def read_trace(
    path: str | Path,
    column: str,
    unit: str,
    *,
    sequence: str | None = None,
    gaps_are_lost: bool = False,
    separator: str | None = None,
    period: float | None = None,
    stamp: str | None = None,
    stamp_unit: str | None = None,
    name: str | None = None,
) -> Trace:
    """Reads a measured trace, one row per loop.

    Of rows with the same sequence number the smallest delay counts, with a warning: the first answer is the loop's.
    Warns where nothing tells how often loops were measured.

    Args:
        path: CSV or text table with a line of names (see `read_columns`).
        column: Name of the column of loop times. An empty entry, `lost` and `inf` are a lost loop.
        unit: Unit of that column: s, ms, us or ns.
        sequence: Name of the column to sort by; None if the rows are in order.
        gaps_are_lost: Whether numbers missing from `sequence`, between the first and the last, are lost loops.
        separator: One character, a blank for any run of blanks; None to see from the line of names.
        period: Time between two loops of the measurement (s), for `Trace`; None for that of the send times, or one row
            per tick where there are none.
        stamp: Name of the column of send times; None for one with a usual name (`SEND_TIMES`).
        stamp_unit: Unit of that column; None for that in its name, such as `pub_time(ms)`, or of times since 1970.
        name: Name of the network; the file's, without its ending, by default.

    Raises:
        ValueError: The file, a column, the unit or an entry is not as expected, every loop is lost, or gaps are to be
            filled in no sequence, or in one that does not count loops.
    """
    if gaps_are_lost and sequence is None:
        raise ValueError("gaps_are_lost: got True without a sequence column, expected its name in `sequence`")
    wanted = dict.fromkeys(each for each in (column, sequence, stamp) if each is not None)
    look = is_send_time if period is None and stamp is None else None
    table = read_columns(path, list(wanted), separator, look)
    delays = table.delays(column, unit)
    origin = "given"
    if period is None:
        period, origin = _measured_period(table, column, sequence, stamp, stamp_unit)
    if sequence is not None:
        delays = _in_order(table, sequence, delays, gaps_are_lost)
    return Trace(delays, name or Path(path).stem, period, str(path), origin)


def _measured_period(
    table: Columns, column: str, sequence: str | None, stamp: str | None, unit: str | None
) -> tuple[float | None, str]:
    """The period that a column of send times tells, and which that is; warns where there is none."""
    named = [stamp] if stamp is not None else sorted(filter(is_send_time, set(table.texts) - {column}), key=_preference)
    for name in named:
        values = table.optional_numbers(name)
        values = sorted(values) if name == sequence else values  # type: ignore[type-var]
        own = unit or header_unit(name)[1] or epoch_unit([np.nan if v is None else v for v in values])
        own = own or ("s" if name == "source_stamp" else None)
        if stamp is not None and own not in UNITS:
            raise ValueError(f"stamp_unit: got {own!r} for column {name!r} of {table.path}, expected s, ms, us or ns")
        numbers = None if sequence in (None, name) else table.numbers(sequence)
        found = period_of(values, numbers if numbers is None or _counts(numbers) else None)
        if found is not None and own is not None:
            return found / UNITS[own], f"column {name!r}"
    warnings.warn(
        f"{table.path}: nothing tells how often loops were measured, a row is taken for each sampling period; expected "
        "period (s), or the name of a column of send times as stamp",
        stacklevel=3,
    )
    return None, ""


def _preference(name: str) -> int:
    plain = header_unit(name)[0].lower()
    return SEND_TIMES.index(plain) if plain in SEND_TIMES else len(SEND_TIMES)


def _counts(numbers: list[float]) -> bool:
    """Whether numbers count loops: they rise by one at most places."""
    return float(np.mean(np.diff(np.array([float(each - numbers[0]) for each in numbers])) == 1.0)) > 0.5


def read_histogram(path: str | Path) -> QuantileTable:
    """Reads a histogram of delays as a law that is uniform within each bin.

    The format is `<histogram><bin low="4.18ms">12</bin>...</histogram>`: the lower edge of a bin with its unit, and its
    count. A bin ends where the next begins, so the last must be empty, as must one that begins at `-inf`.

    Raises:
        ValueError: The file is not there or not of that format, the edges do not increase, a count is negative, there
            is no count at all, or one in a bin without two edges.
    """
    path = Path(path)
    try:
        bins = list(ElementTree.fromstring(read_text(path)).iter("bin"))
    except ElementTree.ParseError as error:
        raise ValueError(f"{path}: is no XML: {error}") from None
    if len(bins) < 2:
        raise ValueError(f"{path}: has {len(bins)} bins, expected two or more elements <bin low=...>count</bin>")
    edge = np.array([_edge(path, k, each.get("low", "")) for k, each in enumerate(bins)])
    counts = np.array([_count(path, k, each.text or "") for k, each in enumerate(bins)])
    for k in np.flatnonzero(np.diff(edge) <= 0.0)[:1]:
        raise ValueError(f"{path}, bin {k + 2}: begins at {edge[k + 1]:g} s, expected it above {edge[k]:g} s")
    for k in np.flatnonzero((counts > 0) & ~np.isfinite(np.append(np.diff(edge), np.inf)))[:1]:
        raise ValueError(f"{path}, bin {k + 1}: has {counts[k]} delays but not two finite edges, expected none")
    if counts.sum() == 0:
        raise ValueError(f"{path}: has no count above 0")
    return _law_of_bins(edge, counts, str(path))


def _law_of_bins(edge: np.ndarray, counts: np.ndarray, source: str) -> QuantileTable:
    """Uniform within each bin; the empty bins at either end are left out."""
    used = np.flatnonzero(counts)
    first, last = used[0], used[-1]
    if edge[first] < 0.0:
        raise ValueError(f"{source}, bin {first + 1}: has a count below 0 s, expected delays >= 0")
    probability = np.concatenate(([0], np.cumsum(counts[first : last + 1]))) / counts.sum()
    return QuantileTable(probability, edge[first : last + 2], source)


def _edge(path: Path, k: int, text: str) -> float:
    for unit in sorted(UNITS, key=len, reverse=True):
        if text.strip().endswith(unit):
            try:
                edge = float(text.strip().removesuffix(unit)) / UNITS[unit]
            except ValueError:
                break
            if math.isnan(edge):
                break
            return edge
    raise ValueError(f"{path}, bin {k + 1}: got low={text!r}, expected a number and a unit, such as '4.18ms'")


def _count(path: Path, k: int, text: str) -> int:
    if not text.strip().isdecimal():
        raise ValueError(f"{path}, bin {k + 1}: got {text!r}, expected a count, a whole number >= 0")
    return int(text)


def _in_order(table: Columns, sequence: str, delays: list[float], gaps_are_lost: bool) -> list[float]:
    """Delays by increasing sequence number, one each."""
    numbers = table.numbers(sequence)
    smallest: dict[float, float] = {}
    for row in sorted(range(len(numbers)), key=numbers.__getitem__):
        smallest[numbers[row]] = min(delays[row], smallest.get(numbers[row], math.inf))
    if repeated := len(numbers) - len(smallest):
        text = f"{table.path}: {repeated} rows repeat a number of {sequence!r}; of each the smallest delay counts"
        warnings.warn(text, stacklevel=3)
    return _fill_gaps(table, sequence, smallest) if gaps_are_lost else list(smallest.values())


def _fill_gaps(table: Columns, sequence: str, delays: dict[float, float]) -> list[float]:
    """Delays by sequence number, with the missing numbers as lost loops."""
    numbers = list(delays)
    if any(number != math.floor(number) for number in numbers):
        raise ValueError(f"{table.path}: column {sequence!r} has fractions, expected whole numbers where gaps are lost")
    span = int(numbers[-1] - numbers[0]) + 1
    if span > _MOST_GAPS * len(numbers):
        raise ValueError(
            f"{table.path}: column {sequence!r} spans {span} numbers in {len(numbers)} rows, expected a count of loops "
            "where gaps are lost"
        )
    filled = [math.inf] * span
    for number, delay in delays.items():
        filled[int(number - numbers[0])] = delay
    return filled
