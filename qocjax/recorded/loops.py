"""From the stamps of loops to a loop trace (model, sections 4 and 10), with what was found wrong on the way."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from qocjax.network.numbering import number_loops
from qocjax.network.period import unlikely
from qocjax.recorded.clocks import Clock, steps, two_way_clock
from qocjax.recorded.findings import Findings
from qocjax.recorded.series import Cleaning
from qocjax.recorded.stamps import Stamps

__all__ = ["COLUMNS", "ClockRules", "LoopTrace", "loop_trace"]

COLUMNS = ["sequence", "session", "number", "source_stamp", "uplink", "compute", "downlink", "loop_time", "lost"]
"""Columns of a trace; times in s, `source_stamp` since the first, `number` as in the file."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ClockRules:
    """How the edge's clock is related to the robot's."""

    same: bool = False  # one clock stamps all four
    window: float = 30.0  # s, of the drifting envelopes
    largest_uncertainty: float = 0.02  # s; above, the offset counts as unknown
    step: float = 0.02  # s, smallest step of a clock that counts
    missing_are_lost: bool = False  # whether numbers that are not there are lost loops


@dataclass(frozen=True)
class LoopTrace:
    """One robot's loops in order, and the clocks they were measured with."""

    robot: str
    table: pd.DataFrame  # COLUMNS
    epoch: float  # s, clock time at which source_stamp is 0
    lost_uplink: int | None  # of the lost loops, those that did not reach the edge; None where unknown
    clocks: tuple[Clock, ...]  # of each stretch between sessions and steps; knots in s as source_stamp
    apparent: pd.DataFrame  # source_stamp, uplink, downlink (s) before correction


def loop_trace(
    parts: list[Stamps], where: str, rules: ClockRules, cleaning: Cleaning, findings: Findings,
    period: float | None = None,
) -> LoopTrace:  # fmt: skip
    """Makes one robot's trace of its sessions.

    T_net = downlink receive - uplink send and T_C = edge send - edge receive need one clock each. T_UL and T_DL need
    the offset between both, which is estimated for each session and each stretch between steps of a clock; where it
    cannot be known they are left out, and the rest stays.

    Args:
        parts: The stamps of each session.
        where: For the findings.
        rules: How the clocks are related.
        cleaning: What counts as a gap.
        findings: Takes the counts.
        period: Of loops without send times (s), as their log says; None where it does not.

    Raises:
        ValueError: No loop is left, or none of them came back.
    """
    tables, apparent, clocks, lost_uplink, epoch, next_number = [], [], [], 0, parts[0].epoch, 0
    for part in parts:
        ordered, session = _in_order(part, where, findings)
        if not ordered.sequence.size:
            continue
        table = _times(ordered, where, findings)
        table["session"] = session if len(parts) == 1 else part.session
        shift = part.epoch - epoch
        found = _legs(table, ordered, where, rules, findings)
        clocks += [replace(clock, knots=clock.knots + shift) for clock in found]
        lost_uplink += int((table["lost"] & np.isnan(ordered.edge_receive)).sum())
        apparent.append(pd.DataFrame({
            "source_stamp": ordered.uplink_send + shift, "uplink": ordered.edge_receive - ordered.uplink_send,
            "downlink": ordered.downlink_receive - ordered.edge_send,
        }))  # fmt: skip
        table = _numbered(table, session, ordered.numbered, next_number, where, rules, findings)
        if table.empty:  # no loop that could be
            continue
        table["source_stamp"] += shift
        next_number = int(table["sequence"].iloc[-1]) + 1
        every = table["source_stamp"].diff() if part.timed else pd.Series(dtype=float)
        findings.count(where, "gaps", int((every > max(cleaning.gap * every.median(), cleaning.least_gap)).sum()))
        tables.append(table)
    if not tables:
        raise ValueError(f"{where}: holds no loop, expected rows with a sequence number and an uplink send stamp")
    whole = pd.concat(tables, ignore_index=True)
    if whole["lost"].all():
        raise ValueError(f"{where}: all {len(whole)} loops are lost, expected at least one that came back")
    if not parts[0].timed:  # an even period, or none
        whole["source_stamp"] = np.nan if period is None else whole["sequence"] * period
    span = None if whole["source_stamp"].isna().all() else float(np.ptp(whole["source_stamp"]))
    if (doubt := unlikely(whole["loop_time"].to_numpy(), span)) is not None:
        findings.note(f"{where}: {doubt}")
    first = float(whole["source_stamp"].iloc[0])
    whole["source_stamp"] -= first
    seen = pd.concat(apparent, ignore_index=True)
    seen["source_stamp"] -= first
    return LoopTrace(
        parts[0].robot, whole[COLUMNS], epoch + first, lost_uplink if parts[0].has_edge else None,
        tuple(replace(clock, knots=clock.knots - first) for clock in clocks), seen,
    )  # fmt: skip


def _in_order(part: Stamps, where: str, findings: Findings) -> tuple[Stamps, NDArray[np.int64]]:
    """Sorted, each loop once, numbers that never begin anew; and how often the numbering has begun anew before each."""
    keep = np.isfinite(part.sequence) & np.isfinite(part.uplink_send)
    findings.count(where, "no_source_stamp", int((~keep).sum()))
    part = _take(replace(part, counted=part.sequence), np.flatnonzero(keep))
    if not part.sequence.size:
        return part, np.empty(0, np.int64)
    times = (part.uplink_send, part.downlink_receive) if part.timed else ()
    found = number_loops(part.sequence.tolist(), *times)
    part = replace(part, counted=found.number)
    findings.count(where, "unordered", found.late)
    findings.count(where, "restarts", found.restarts)
    findings.count(where, "wraps", found.wraps)
    answer = np.nan_to_num(part.downlink_receive, nan=np.inf)
    first = np.lexsort((answer, found.number, found.session))
    _, once = np.unique(np.column_stack([found.session, found.number])[first], axis=0, return_index=True)
    findings.count(where, "duplicates", part.sequence.size - once.size)
    kept = np.isin(found.order, first[once])
    rows = found.order[kept]
    part, session = _take(part, rows), found.session[rows]
    same = (np.diff(session) == 0) & part.timed
    findings.count(where, "stamps_back", int((np.diff(part.uplink_send)[same] < 0).sum()))
    return part, session


def _take(part: Stamps, rows: NDArray[np.intp]) -> Stamps:
    names = ("sequence", "counted", "uplink_send", "edge_receive", "edge_send", "downlink_receive")
    return replace(part, **{name: getattr(part, name)[rows] for name in names})


def _times(part: Stamps, where: str, findings: Findings) -> pd.DataFrame:
    """T_net and T_C of each loop; a loop that ends before it begins has T_net = NaN."""
    loop, compute = part.downlink_receive - part.uplink_send, part.edge_send - part.edge_receive
    lost = np.isnan(part.downlink_receive)
    wrong = loop < 0.0
    findings.count(where, "negative_loop_time", int(wrong.sum()))
    findings.count(where, "negative_compute", int((compute < 0.0).sum()))
    compute = np.where(compute < 0.0, np.nan, compute)
    longer = compute > np.where(wrong, np.inf, loop)
    findings.count(where, "negative_network", int(longer.sum()))
    return pd.DataFrame({
        "number": part.sequence, "counted": part.counted,
        "source_stamp": part.uplink_send, "compute": np.where(longer, np.nan, compute),
        "loop_time": np.where(lost, np.inf, np.where(wrong, np.nan, loop)), "lost": lost,
    })  # fmt: skip


def _legs(table: pd.DataFrame, part: Stamps, where: str, rules: ClockRules, findings: Findings) -> list[Clock]:
    """Adds T_UL and T_DL where the clocks allow, and returns the clocks of the stretches."""
    up, down = part.edge_receive - part.uplink_send, part.downlink_receive - part.edge_send
    uplink, downlink = np.full(up.size, np.nan), np.full(up.size, np.nan)
    sound = table[["compute", "loop_time"]].notna().all(axis=1).to_numpy()  # one that contradicts itself is no measure
    whole = np.isfinite(up + down) & sound
    rows, clocks = np.flatnonzero(whole), []
    if rules.same:
        uplink, downlink = up.copy(), down.copy()
    elif rows.size:
        at = rows[steps(up[rows], down[rows], rules.step)]
        findings.count(where, "clock_steps", at.size)
        for piece in np.split(np.arange(up.size), at):
            found = _correct(piece, whole, part.uplink_send, up, down, rules)
            if found is None:
                findings.count(where, "clock_unknown")
                continue
            uplink[piece], downlink[piece], clock = found
            clocks.append(clock)
    contradicts = np.isfinite(up + down) & ~whole
    below = ((uplink < 0.0) | (downlink < 0.0)) & ~contradicts
    findings.count(where, "negative_leg", int(below.sum()))
    wrong = below | contradicts
    table["uplink"], table["downlink"] = (np.where(wrong, np.nan, leg) for leg in (uplink, downlink))
    table.loc[below, "compute"] = np.nan
    return clocks


def _correct(
    piece: NDArray[np.intp], whole: NDArray[np.bool_], time: Array, up: Array, down: Array, rules: ClockRules
) -> tuple[Array, Array, Clock] | None:
    """Legs of a stretch on one clock; None where the offset cannot be known."""
    rows = piece[whole[piece]]
    if not rows.size:
        return None
    clock = two_way_clock(time[rows], up[rows], down[rows], rules.window)
    if not 0.0 <= clock.uncertainty <= rules.largest_uncertainty:
        return None
    offset = clock.offset(time[piece])
    return up[piece] - offset, down[piece] + offset, clock


def _numbered(
    table: pd.DataFrame, session: NDArray[np.int64], numbered: bool, first: int, where: str, rules: ClockRules,
    findings: Findings,
) -> pd.DataFrame:  # fmt: skip
    """Gives each loop a number that never begins anew, and enters missing ones as lost where that is wanted."""
    number = table["counted"].to_numpy()
    ahead = np.diff(number, prepend=number[0])
    ahead[np.diff(session, prepend=0) > 0] = 1.0
    missing = int(np.maximum(ahead - 1.0, 0.0).sum())
    whole = bool((number == np.floor(number)).all())
    findings.count(where, "missing_numbers", missing if numbered and whole else 0)
    table["sequence"] = first + (np.cumsum(ahead).astype(int) if whole else np.arange(len(table)))
    if rules.missing_are_lost and missing and whole:
        if missing > 100 * len(table):
            raise ValueError(f"{where}: {missing} numbers are missing among {len(table)}, expected a count of loops")
        full = np.arange(table["sequence"].iloc[0], table["sequence"].iloc[-1] + 1)
        stamp = np.interp(full, table["sequence"], table["source_stamp"])
        table = table.set_index("sequence").reindex(full).rename_axis("sequence").reset_index()
        table["source_stamp"], table["session"] = stamp, table["session"].ffill()
        absent = table["lost"].isna()
        table.loc[absent, "loop_time"] = np.inf
        table["lost"] = table["lost"].where(~absent, True).astype(bool)
    left = table["loop_time"].notna()
    return table[left].reset_index(drop=True)
