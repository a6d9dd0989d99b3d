"""Random tables of loops whose truth is known: sessions, wraps, pauses, holes, lost loops, late rows, copies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

__all__ = ["Known", "a_table"]


@dataclass(frozen=True)
class Known:
    """A table and what is right to say of it."""

    table: pd.DataFrame  # sequence, four stamps, rtt
    delays: np.ndarray  # s, of the loops that have a row, in order; inf where lost
    filled: np.ndarray  # with missing numbers as lost loops
    period: float  # s
    counts: dict[str, int]  # of findings
    story: str


def a_table(seed: int) -> Known:
    """A table that a measurement may leave, with its truth."""
    rng = np.random.default_rng(seed)
    period = float(rng.choice([0.01, 0.02, 0.05, 0.1]))
    width = int(rng.choice([0, 0, 2**8, 2**16, 2**32]))  # of the counter
    sessions = int(rng.choice([1, 1, 2, 3]))
    keep_holes, relative = rng.random() < 0.5, bool(rng.random() < 0.3)
    tables, delays, filled, missing, wraps, begin, copies = [], [], [], 0, 0, 1.7e9, 0
    for _ in range(sessions):
        count = int(rng.integers(60, 400))
        first = 0 if sessions > 1 or not width else int(rng.integers(max(width - count, 0), width))
        number = first + np.arange(count)
        send = begin + period * (np.arange(count) + 0.05 * rng.random(count))
        pause = int(rng.integers(10, count - 10))  # the measurement rests in between
        if rng.random() < 0.3 and (not width or 8 < number[pause] % width < width - 8):
            send[pause:] += float(rng.choice([3.0, 40.0]))
        parts = 1e-3 * (1.0 + rng.gamma(2.0, 2.0, (3, count)))
        lost = rng.random(count) < rng.choice([0.0, 0.02, 0.2])
        table = pd.DataFrame({
            "sequence": number % width if width else number, "uplink_send": send, "edge_receive": send + parts[0],
            "edge_send": send + parts[0] + parts[1], "downlink_receive": send + parts.sum(axis=0),
        })  # fmt: skip
        table.loc[lost, ["downlink_receive"]] = np.nan
        table["rtt"] = table["downlink_receive"] - table["uplink_send"]
        whole = np.where(lost, np.inf, parts.sum(axis=0))
        hole = np.zeros(count, bool)
        if keep_holes:
            hole[1:-1] = rng.random(count - 2) < 0.03
            hole[max(3, np.argmin(hole)) - 2] = False
        table, own = table[~hole].reset_index(drop=True), whole[~hole]
        missing += int(hole.sum())
        wraps += int(np.sum(np.diff(number[~hole] // width) > 0)) if width else 0
        delays.append(own)
        filled.append(np.where(hole, np.inf, whole))
        table = _late(table, rng)
        table, more = _copies(table, rng)
        copies += more
        tables.append(table)
        begin = 1.7e9 if relative else float(send[-1]) + float(rng.choice([2.0, 5.0, 600.0]))
    every = np.concatenate(delays)
    if not np.isfinite(every).any():
        return a_table(seed + 10_000)
    counts = {"restarts": sessions - 1, "wraps": wraps, "duplicates": copies, "missing_numbers": missing}
    story = f"seed {seed}: {sessions} sessions, counter {width}, relative {relative}, holes {missing}, copies {copies}"
    return Known(pd.concat(tables, ignore_index=True), every, np.concatenate(filled), period, counts, story)


def _late(table: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Some rows written up to three places later, not the first."""
    place = np.arange(len(table), dtype=float)
    late = rng.random(len(table)) < rng.choice([0.0, 0.03])
    late[0] = False
    place[late] += rng.integers(1, 4, late.sum()) + 0.5
    return table.iloc[np.argsort(place, kind="stable")].reset_index(drop=True)


def _copies(table: pd.DataFrame, rng: np.random.Generator) -> tuple[pd.DataFrame, int]:
    """Some rows twice, the copy up to two places later."""
    rows = np.flatnonzero(rng.random(len(table)) < rng.choice([0.0, 0.02]))
    rows = rows[(rows > 0) & (rows < len(table) - 3)]
    if rows.size:
        rows = rows[np.insert(np.diff(rows) > 6, 0, True)]
    place = np.concatenate([np.arange(len(table)), rows + rng.integers(0, 3, rows.size) + 0.5])
    return pd.concat([table, table.iloc[rows]]).iloc[np.argsort(place, kind="stable")].reset_index(drop=True), rows.size
