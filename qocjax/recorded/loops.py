"""From the stamps of loops to a loop trace (model, sections 4 and 10), with what was found wrong on the way."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from qocjax.network.period import unlikely
from qocjax.recorded.clocks import Clock, steps, two_way_clock
from qocjax.recorded.findings import Findings
from qocjax.recorded.order import in_order, numbered
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


@dataclass(frozen=True)
class _Session:
    """The loops of one part, on its own epoch."""

    table: pd.DataFrame
    apparent: pd.DataFrame
    clocks: list[Clock]
    lost_uplink: int


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
    tables: list[pd.DataFrame] = []
    seen: list[pd.DataFrame] = []
    sessions, clocks, number = [], [], 0
    for part in parts:
        each = _session(part, len(parts) > 1, where, rules, cleaning, findings)
        if each is None:
            continue
        shift = part.epoch - parts[0].epoch
        each.table["sequence"] += number
        number = int(each.table["sequence"].iloc[-1]) + 1
        for table, kept in ((each.table, tables), (each.apparent, seen)):
            table["source_stamp"] += shift
            kept.append(table)
        clocks += [replace(clock, knots=clock.knots + shift) for clock in each.clocks]
        sessions.append(each)
    if not tables:
        raise ValueError(f"{where}: holds no loop, expected rows with a sequence number and an uplink send stamp")
    whole, apparent = pd.concat(tables, ignore_index=True), pd.concat(seen, ignore_index=True)
    if whole["lost"].all():
        raise ValueError(f"{where}: all {len(whole)} loops are lost, expected at least one that came back")
    if not parts[0].timed:  # an even period, or none
        whole["source_stamp"] = np.nan if period is None else whole["sequence"] * period
    known = bool(whole["source_stamp"].notna().any())
    doubt = unlikely(whole["loop_time"].to_numpy(), float(np.ptp(whole["source_stamp"])) if known else None)
    if doubt is not None:
        findings.note(f"{where}: {doubt}")
    first = float(whole["source_stamp"].iloc[0]) if known else 0.0
    whole["source_stamp"] -= first
    apparent["source_stamp"] -= first
    lost_uplink = sum(each.lost_uplink for each in sessions) if parts[0].has_edge else None
    return LoopTrace(
        parts[0].robot, whole[COLUMNS], parts[0].epoch + first, lost_uplink,
        tuple(replace(clock, knots=clock.knots - first) for clock in clocks), apparent,
    )  # fmt: skip


def _session(
    part: Stamps, named: bool, where: str, rules: ClockRules, cleaning: Cleaning, findings: Findings
) -> _Session | None:
    """One part's loops; None where it has none."""
    part, session = in_order(part, where, findings)
    if not part.sequence.size:
        return None
    table = _times(part, where, findings)
    table["session"] = part.session if named else session
    clocks = _legs(table, part, where, rules, findings)
    lost_uplink = int((table["lost"] & np.isnan(part.edge_receive)).sum())
    apparent = pd.DataFrame({
        "source_stamp": part.uplink_send, "uplink": part.edge_receive - part.uplink_send,
        "downlink": part.downlink_receive - part.edge_send,
    })  # fmt: skip
    table = numbered(table, session, part.numbered, rules.missing_are_lost, where, findings)
    if table.empty:  # no loop that could be
        return None
    every = table["source_stamp"].diff() if part.timed else pd.Series(dtype=float)
    findings.count(where, "gaps", int((every > max(cleaning.gap * every.median(), cleaning.least_gap)).sum()))
    return _Session(table, apparent, clocks, lost_uplink)


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
