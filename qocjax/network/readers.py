"""Measured delays from tables: samples, and traces in the order of their loops."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from qocjax.network.columns import read_columns
from qocjax.network.empirical import Empirical
from qocjax.network.numbering import Numbering, number_loops
from qocjax.network.period import SEND_TIMES, epoch_unit, is_send_time, period_of, unlikely
from qocjax.network.trace import Trace
from qocjax.network.values import UNITS, Columns, header_unit

__all__ = ["read_samples", "read_trace", "send_times"]

_MOST_GAPS = 100  # numbers per row of a sequence; above, it does not count loops


def read_samples(path: str | Path, column: str, unit: str | None = None, *, separator: str | None = None) -> Empirical:
    """Reads a column of delays as a law; their order does not matter.

    Args:
        path: CSV or text table with a line of names (see `read_columns`).
        column: Name of the column. An empty entry, `lost`, NaN and `inf` are a lost message.
        unit: Unit of the column: s, ms, us or ns; None for that in its name, such as `delay(ms)`, or at each number.
        separator: One character, a blank for any run of blanks; None to see from the line of names.

    Raises:
        ValueError: The file, the column, the unit or an entry is not as expected, or every message is lost.
    """
    table = read_columns(path, [column], separator)
    return Empirical(table.delays(table.own_name(column), unit), source=str(path))


def read_trace(
    path: str | Path,
    column: str,
    unit: str | None = None,
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
        column: Name of the column of loop times. An empty entry, `lost`, NaN and `inf` are a lost loop.
        unit: Unit of that column: s, ms, us or ns; None for that in its name, such as `delay(ms)`, or at each number.
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
    table = read_columns(path, list(wanted), separator, is_send_time if stamp is None else None)
    column = table.own_name(column)
    sequence, stamp = (None if each is None else table.own_name(each) for each in (sequence, stamp))
    delays = table.delays(column, unit)
    times = send_times(table, column, stamp, stamp_unit)
    order, loops = np.arange(len(delays)), None
    if sequence is not None:
        delays, order, loops = _in_order(table, sequence, delays, None if times is None else times[1], gaps_are_lost)
    origin = "given" if period is not None else ""
    if period is None and times is not None:
        name_of, values = times
        period = period_of(values[order], loops)
        origin = f"column {name_of!r}"
    if period is None:
        warnings.warn(
            f"{path}: nothing tells how often loops were measured, a row is taken for each sampling period; expected "
            "period (s), or the name of a column of send times as stamp",
            stacklevel=2,
        )
        origin = ""
    if (doubt := unlikely(delays, None if period is None else period * len(delays))) is not None:
        warnings.warn(f"{path}, column {column!r}: {doubt}", stacklevel=2)
    return Trace(delays, name or Path(path).stem, period, str(path), origin)


def send_times(
    table: Columns, column: str, stamp: str | None, unit: str | None
) -> tuple[str, NDArray[np.float64]] | None:
    """The column of send times and its values in s since the first, NaN for none; None where the table has none.

    Raises:
        ValueError: The unit of the one that was asked for is not known.
    """
    named = [stamp] if stamp is not None else sorted(filter(is_send_time, set(table.texts) - {column}), key=_preference)
    for name in named:
        values, known = table.times(name)
        first = next((each for each in values if each is not None), None)
        if first is None:
            continue
        own = unit or header_unit(name)[1] or epoch_unit([np.nan if v is None else v for v in values])
        own = own or ("s" if name == "source_stamp" else None)
        scale = known or UNITS.get(own or "")
        if scale is not None:
            return name, np.array([np.nan if v is None else (v - first) / scale for v in values])
        if stamp is not None:
            raise ValueError(f"stamp_unit: got {own!r} for column {name!r} of {table.path}, expected s, ms, us or ns")
    return None


def _preference(name: str) -> int:
    plain = header_unit(name)[0].lower()
    return SEND_TIMES.index(plain) if plain in SEND_TIMES else len(SEND_TIMES)


def _in_order(
    table: Columns, sequence: str, delays: list[float], times: NDArray[np.float64] | None, gaps_are_lost: bool
) -> tuple[list[float], NDArray[np.intp], list[float] | None]:
    """Delays in the order of loops, one each; rows in that order; and their numbers if they count loops.

    What begins anew or wraps goes on.
    """
    numbers = table.numbers(sequence)
    stamps = times if times is not None and np.isfinite(times).all() else None
    found = number_loops(numbers, stamps, None if stamps is None else np.array(delays))
    loops: list[dict[float, float]] = [{} for _ in range(found.restarts + 1)]
    for row in found.order.tolist():
        number, loop = float(found.number[row]), loops[found.session[row]]
        loop[number] = min(delays[row], loop.get(number, math.inf))
    _tell(table, sequence, len(numbers) - sum(map(len, loops)), found)
    if gaps_are_lost:
        ordered = [delay for loop in loops for delay in _fill_gaps(table, sequence, loop, min(numbers))]
    else:
        ordered = [delay for loop in loops for delay in loop.values()]
    counted = found.number[found.order]
    return ordered, found.order, counted.tolist() if np.mean(np.diff(counted) == 1.0) > 0.5 else None


def _tell(table: Columns, sequence: str, repeated: int, found: Numbering) -> None:
    """Warns of what was found in the numbering."""
    if repeated:
        text = f"{repeated} rows repeat a number of {sequence!r}; of each the smallest delay counts"
        warnings.warn(f"{table.path}: {text}", stacklevel=4)
    if found.restarts or found.wraps:
        text = f"{sequence!r} begins anew {found.restarts} times and wraps {found.wraps} times; the rows' order counts"
        warnings.warn(f"{table.path}: {text}", stacklevel=4)


def _fill_gaps(table: Columns, sequence: str, delays: dict[float, float], low: float) -> list[float]:
    """Delays by sequence number, with the missing numbers as lost loops."""
    numbers = list(delays)
    if low != math.floor(low) or any(number != math.floor(number) for number in numbers):
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
