"""ApexAI's performance_test: one row a second, below a preamble."""

from __future__ import annotations

import re

import numpy as np

from qocjax.network.columns import table_of_text
from qocjax.recorded.findings import Findings
from qocjax.recorded.formats.log import Head, Log, loops_of

__all__ = ["detect", "read"]

TITLE = "performance_test, log"
_BEGIN = "---EXPERIMENT-START---"


def detect(head: Head) -> bool:
    """Whether a file is one."""
    return _BEGIN in head.text and "latency_mean (ms)" in head.text


def read(head: Head, findings: Findings) -> Log:
    """Reads the mean latency of each interval; one in which nothing was received is lost.

    Raises:
        ValueError: There is no row, or an entry is no number.
    """
    before, _, rest = head.text.partition(_BEGIN)
    lines = rest.split("\n")
    rows = [line if k < 2 or re.match(r"\s*[\d.]+,", line) else "" for k, line in enumerate(lines)]
    last = next((k for k in range(len(lines) - 1, -1, -1) if rows[k].strip()), 0)
    width = rows[next(k for k, line in enumerate(rows) if line.strip())].count(",")
    if rows[last].count(",") < width - 1:
        findings.count(head.path.name, "truncated")
        rows[last] = ""
    wanted = ["T_experiment", "received", "sent", "lost", "latency_mean (ms)"]
    others = [line for k, line in enumerate(lines) if k >= 2 and not rows[k] and line.count(",") > 2]
    findings.count(head.path.name, "unreadable", len(others))
    table = table_of_text(head.path, "\n".join(rows), wanted, ",", first=before.count("\n") + 1)
    time, received, sent, lost = (np.array(table.numbers(name)) for name in wanted[:4])
    mean = np.array([np.nan if v is None else v for v in table.optional_numbers(wanted[4])]) / 1e3
    note = (
        f"a row is the mean of an interval; of {int(sent.sum())} messages in all {int(lost.sum())} were lost: spread, "
        "bursts and F of single messages cannot be had from it"
    )
    return Log([loops_of(np.where(received > 0, mean, np.inf), None, time)], notes=(note,))
