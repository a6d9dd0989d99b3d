"""sockperf --full-log: send and receive times of each answered message, between dashes."""

from __future__ import annotations

import re

import numpy as np

from qocjax.network.columns import table_of_text
from qocjax.recorded.findings import Findings
from qocjax.recorded.formats.log import Head, Log, loops_of

__all__ = ["detect", "read"]

TITLE = "sockperf, full log"
_NAMES = re.compile(r"packet, *txTime\(sec\), *rxTime\(sec\)")
_ROW = re.compile(r"\s*\d+,\s*\d")
_DROPPED = re.compile(r"# dropped messages = (\d+); # duplicated messages = (\d+); # out-of-order messages = (\d+)")


def detect(head: Head) -> bool:
    """Whether a file is one."""
    return "sockperf:" in head.text and _NAMES.search(head.text) is not None


def read(head: Head, findings: Findings) -> Log:
    """Reads the messages; the loop is rxTime - txTime, of which the tool's own latency is half.

    Rows are numbered without the lost ones: these are entered where the send times leave room for as many as the
    tool counted.

    Raises:
        ValueError: An entry is no number.
    """
    lines = head.text.split("\n")
    first = next(k for k, line in enumerate(lines) if _NAMES.match(line))
    end = next((k for k in range(first + 1, len(lines)) if lines[k].startswith("---")), len(lines))
    names = table_of_text(head.path, "\n".join(lines[first:end]), ["txTime(sec)", "rxTime(sec)"], first=first + 1)
    send, receive = (np.array(names.numbers(name)) for name in ("txTime(sec)", "rxTime(sec)"))
    loop = receive - send
    if end == len(lines):
        findings.count(head.path.name, "truncated")
    around = [*lines[:first], *lines[end + 1 :]]
    findings.count(head.path.name, "unreadable", sum(_ROW.match(line) is not None for line in around))
    if (loop < 0.0).any():
        findings.count(head.path.name, "negative_loop_time", int((loop < 0.0).sum()))
        send, loop = send[loop >= 0.0], loop[loop >= 0.0]
    counts = _DROPPED.search(head.text)
    dropped = int(counts[1]) if counts else 0
    step = np.median(np.diff(send)) if send.size > 1 else np.inf
    holes = np.maximum(np.rint(np.diff(send) / step).astype(int) - 1, 0)
    if not dropped:
        unknown = () if counts else ("nothing says how many messages were lost",)
        return Log([loops_of(loop, None, send)], notes=unknown)
    if holes.sum() != dropped:
        return Log([loops_of(loop, None, send)], notes=(f"{dropped} messages were lost, the log does not say which",))
    place = np.concatenate(([0], np.cumsum(holes + 1)))
    every = np.full(place[-1] + 1, np.inf)
    every[place] = loop
    return Log([loops_of(every, None, np.interp(np.arange(every.size), place, send))])
