"""The loops of a table of stamps in order: each once, numbered through, with what is missing."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from qocjax.network.numbering import number_loops
from qocjax.recorded.findings import Findings
from qocjax.recorded.stamps import Stamps

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["in_order", "numbered"]


def in_order(part: Stamps, where: str, findings: Findings) -> tuple[Stamps, NDArray[np.int64]]:
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


def numbered(
    table: pd.DataFrame, session: NDArray[np.int64], own: bool, missing_are_lost: bool, where: str, findings: Findings
) -> pd.DataFrame:
    """Gives each loop a number from 0 that never begins anew, and enters missing ones as lost where that is wanted.

    Args:
        table: Of the loops in order; `counted` has what their numbers mean.
        session: [n] how often the numbering had begun anew.
        own: Whether the numbers are the table's own.
        missing_are_lost: Whether numbers that are not there are lost loops.
        where: For the findings.
        findings: Takes the counts.

    Raises:
        ValueError: Far more numbers are missing than are there.
    """
    number = table["counted"].to_numpy()
    ahead = np.diff(number, prepend=number[0])
    ahead[np.diff(session, prepend=0) > 0] = 1.0
    missing = int(np.maximum(ahead - 1.0, 0.0).sum())
    whole = bool((number == np.floor(number)).all())
    findings.count(where, "missing_numbers", missing if own and whole else 0)
    table["sequence"] = np.cumsum(ahead).astype(int) if whole else np.arange(len(table))
    if missing_are_lost and missing and whole:
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
