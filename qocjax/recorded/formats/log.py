"""What a tool's log says of loops, and how its parts become stamps."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from qocjax.network.numbering import number_loops
from qocjax.network.period import period_of
from qocjax.recorded.findings import Findings
from qocjax.recorded.stamps import Stamps

__all__ = ["Array", "Head", "Log", "loops_of", "with_missing"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Head:
    """What is known of a file when its format is looked for."""

    path: Path
    text: str  # all of it
    lines: tuple[str, ...]  # the first that are not blank
    names: tuple[str, ...]  # of its columns, were it a table
    unit: str | None = None  # of its times, where somebody gave one


@dataclass(frozen=True)
class Log:
    """A log, read.

    One that has loops has `parts`; one of one-way delays has `one_way`, and one without delays has notes only.
    """

    parts: list[Stamps] = field(default_factory=list)
    one_way: Array | None = None  # [n] s, inf where lost
    period: float | None = None  # s, between two messages, where the log says so
    lost_uplink: int | None = None  # of the lost loops, those that did not reach the edge, where the log says so
    notes: tuple[str, ...] = ()
    computed: bool = False  # whether its loops hold a computation, as those of a controller do and those of ping do not


def loops_of(
    loop_time: Array,
    number: Array | None = None,
    send: Array | None = None,
    edge: tuple[Array, Array] | None = None,
    epoch: float = 0.0,
) -> Stamps:
    """Stamps of one robot from loop times.

    Args:
        loop_time: [n] s, inf where lost.
        number: [n] as in the file; None for rows in order.
        send: [n] s since `epoch`; None where the log has no send times.
        edge: Receive and send stamps of the edge, [n] s since `epoch` each, NaN for none.
        epoch: s.
    """
    rows = np.arange(loop_time.size, dtype=float)
    begin = rows if send is None else send
    none = np.full(loop_time.size, np.nan)
    receive, reply = edge if edge is not None else (none, none)
    return Stamps(
        robot="", session="", sequence=rows if number is None else number, uplink_send=begin, edge_receive=receive,
        edge_send=reply, downlink_receive=np.where(np.isfinite(loop_time), begin + loop_time, np.nan), epoch=epoch,
        has_edge=edge is not None, numbered=number is not None, timed=send is not None,
    )  # fmt: skip


def with_missing(
    number: Array,
    loop_time: Array,
    where: str,
    findings: Findings,
    first: int | None = None,
    count: int | None = None,
    send: Array | None = None,
) -> tuple[Array, Array, Array | None]:
    """Enters numbers that have no row as lost loops; of one that comes twice the first answer counts.

    For tools that print what comes back, so that what is not there was lost.

    Args:
        number: [n] as in the file; a counter of 16 bits may wrap.
        loop_time: [n] s, inf where lost.
        where: For the findings.
        findings: Takes the counts.
        first: The first number that the tool sends; None for the first that is there.
        count: How many it sent; None for up to the last that is there.
        send: [n] s, NaN where unknown; in between, they are interpolated.

    Returns:
        Numbers, loop times and send times of all loops, in order.

    Raises:
        ValueError: The numbers span far more than the rows.
    """
    found = number_loops(number.tolist())
    if found.restarts:
        raise ValueError(f"{where}: its numbers begin anew {found.restarts} times, expected the log of one run")
    counted = found.number + number.min()
    begin = int(counted.min() if first is None else min(first, counted.min()))
    end = int(max(counted.max() + 1, begin + count if count is not None else 0))
    if end - begin > 100 * number.size + 1000:
        raise ValueError(f"{where}: {number.size} answers to {end - begin} messages, expected a log of loops")
    every = np.full(end - begin, np.inf)
    times = np.full(end - begin, np.nan)
    place = (counted - begin).astype(int)
    np.minimum.at(every, place, loop_time)
    findings.count(where, "duplicates", number.size - np.unique(place).size)
    findings.count(where, "unordered", found.late)
    findings.count(where, "wraps", found.wraps)
    numbers = begin + np.arange(end - begin, dtype=float)
    if send is None or np.isfinite(send).sum() < 2:
        return numbers, every, None
    times[place[::-1]] = send[::-1]
    known = np.isfinite(times)
    step = period_of(times) or 0.0
    inner = np.interp(numbers, numbers[known], times[known])
    low, high = np.flatnonzero(known)[[0, -1]]
    outer = np.where(numbers < numbers[low], (numbers - numbers[low]) * step, (numbers - numbers[high]) * step)
    outside = (numbers < numbers[low]) | (numbers > numbers[high])
    return numbers, every, np.where(known, times, inner + np.where(outside, outer, 0.0))
