"""DETERMINISTIC6G's traces for DelayReplayer: a delay with its unit a line, and its time where it has one."""

from __future__ import annotations

import re

import numpy as np

from qocjax.network.values import UNITS
from qocjax.recorded.findings import Findings
from qocjax.recorded.formats.log import Head, Log, loops_of

__all__ = ["detect", "read"]

TITLE = "DelayReplayer, trace"
_TIME = r"([\d.]+(?:[eE][+-]?\d+)?) ?(ns|us|ms|s)"
_LINE = re.compile(rf"\s*{_TIME}\s*(?:,\s*{_TIME}\s*)?")


def detect(head: Head) -> bool:
    """Whether a file is one."""
    return bool(head.lines) and _LINE.fullmatch(head.lines[0]) is not None


def read(head: Head, findings: Findings) -> Log:
    """Reads delays in their order.

    Raises:
        ValueError: A line is none, or has no time where others have one.
    """
    delays, times = [], []
    for number, line in enumerate(head.text.split("\n"), start=1):
        if not line.strip():
            continue
        found = _LINE.fullmatch(line)
        if found is None:
            raise ValueError(f"{head.path}, line {number}: got {line[:60]!r}, expected a delay such as 5.602ms")
        try:
            delays.append(float(found[1]) / UNITS[found[2]])
            times.append(float(found[3]) / UNITS[found[4]] if found[3] else np.nan)
        except ValueError:
            raise ValueError(f"{head.path}, line {number}: got {line[:60]!r}, expected numbers") from None
        if np.isnan(times[-1]) != np.isnan(times[0]):
            raise ValueError(f"{head.path}, line {number}: expected a time in each line or in none")
    return Log([loops_of(np.array(delays), None, None if np.isnan(times[0]) else np.array(times))])
