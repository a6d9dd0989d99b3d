"""OWAMP's one-way delays: owping -R (raw records) and owping -v (a line each), RFC 4656."""

from __future__ import annotations

import re

import numpy as np

from qocjax.network.values import UNITS
from qocjax.recorded.findings import Findings
from qocjax.recorded.formats.log import Head, Log

__all__ = ["detect", "read"]

TITLE = "owping, one-way delays"
_RAW = re.compile(r"(\d+) (\d{20}) ([01]) (\S+) (\d{20}) ([01]) (\S+) (\d+)")
_LINE = re.compile(r"seq_no=(\d+) +(?:delay=(\S+) (ns|us|ms|s)\s+\((sync|unsync).*|(\*LOST\*)).*")


def detect(head: Head) -> bool:
    """Whether a file is one."""
    return any(_RAW.fullmatch(line) or _LINE.fullmatch(line) for line in head.lines)


def read(head: Head, findings: Findings) -> Log:
    """Reads one-way delays; a receive time of 0 is a lost message.

    They hold only if both clocks were synchronised, which the records tell.

    Raises:
        ValueError: No message arrived.
    """
    delays: dict[int, float] = {}
    rows = unsynchronised = spoilt = 0
    for line in head.text.split("\n"):
        if (found := _RAW.fullmatch(line)) is not None:
            lost = int(found[5]) == 0
            delay = np.inf if lost else (int(found[5]) - int(found[2])) / 2**32
            apart = not lost and "0" in (found[3], found[6])
        elif (found := _LINE.fullmatch(line)) is not None:
            delay = np.inf if found[5] else float(found[2]) / UNITS[found[3]]
            apart = found[4] == "unsync"
        else:
            spoilt += line.startswith("seq_no") or line[:1].isdigit() or "*LOST*" in line or "delay=" in line
            continue
        rows += 1
        unsynchronised += apart
        number = int(found[1])
        delays[number] = min(delay, delays.get(number, np.inf))
    findings.count(head.path.name, "duplicates", rows - len(delays))
    findings.count(head.path.name, "unreadable", spoilt)
    values = np.array([delays[number] for number in sorted(delays)])
    findings.count(head.path.name, "negative_leg", int((values < 0.0).sum()))
    values = values[values >= 0.0]
    if not np.isfinite(values).any():
        raise ValueError(f"{head.path}: no message arrived, expected at least one delay")
    notes = ["one-way delays, no loops: a law for one direction (delay@network.uplink.delay=samples), no trace"]
    if unsynchronised:
        notes.append(
            f"the clocks of {unsynchronised} of {rows} records were not synchronised: their delays mean nothing"
        )
    return Log(one_way=values, notes=tuple(notes))
