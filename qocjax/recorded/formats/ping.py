"""Text of ping: iputils, BSD and macOS, inetutils, busybox."""

from __future__ import annotations

import re

import numpy as np

from qocjax.recorded.findings import Findings
from qocjax.recorded.formats.log import Head, Log, loops_of, with_missing

__all__ = ["detect", "read"]

TITLE = "ping, text"
_REPLY = re.compile(
    r"(?:\[(\d+\.\d+)\] )?\d+ bytes from [^ ]+.*?: (?:icmp_)?seq=(\d+) (?:ttl|hlim)=\d+ time[=<]([\d.]+) ?ms(.*)"
)
_MISSING = re.compile(r"(?:\[[\d.]+\] )?(?:no answer yet for icmp_seq=|Request timeout for icmp_seq )(\d+)")
_ERROR = re.compile(r"(?:\[[\d.]+\] )?From .* icmp_seq=(\d+) ")
_SUMMARY = re.compile(r"(\d+) packets transmitted, (\d+) (?:packets )?received(?:.*, time (\d+)ms)?")


def detect(head: Head) -> bool:
    """Whether a file is one."""
    return any(line.startswith(("PING ", "PING6(")) for line in head.lines[:3]) or any(map(_REPLY.match, head.lines))


def read(head: Head, findings: Findings) -> Log:
    """Reads the answers; what was sent and has none is lost, a DUP! is not another loop.

    With -D the send time is the printed one less the round trip; else the period is that of the summary, if it has
    one, and losses at the end are known from its count.

    Raises:
        ValueError: No message came back.
    """
    where, replies, silent = head.path.name, [], []
    sent = received = span = None
    other = 0
    for line in head.text.split("\n"):
        if found := _REPLY.match(line):
            replies.append((float(found[1] or np.nan), float(found[2]), float(found[3]) / 1e3, "DUP" in found[4]))
        elif found := _MISSING.match(line) or _ERROR.match(line):
            silent.append(float(found[1]))
        elif found := _SUMMARY.search(line):
            sent, received, span = int(found[1]), int(found[2]), found[3]
        elif line.strip() and not line.startswith(("PING", "---", "rtt ", "round-trip ", "WARNING")):
            other += 1
    if not replies:
        raise ValueError(f"{head.path}: no message came back, expected an answer such as 'icmp_seq=1 ... time=9 ms'")
    first = 0 if "data bytes" in head.text[:400] else 1
    came = len(replies) - sum(each[3] for each in replies)
    if received is not None and came != received:
        findings.count(where, "contradictions", abs(came - received))
    findings.count(where, "unreadable", other)
    quiet = sorted(set(silent) - {each[1] for each in replies})
    rows = [each[:3] for each in replies] + [(np.nan, number, np.inf) for number in quiet]
    stamp, number, time = np.array(rows).T
    send = stamp - time if np.isfinite(stamp).any() else None
    if quiet and number.max() < 65535:  # told of by the tool, in their places
        order = np.argsort(number, kind="stable")
        stamp, number, time = stamp[order], number[order], time[order]
        send = None if send is None else send[order]
    numbers, loop, times = with_missing(number, time, where, findings, first, sent, send)
    period = float(span) / 1e3 / (sent - 1) if span is not None and sent is not None and sent > 1 else None
    epoch = 0.0 if times is None else float(np.floor(times[0]))
    return Log([loops_of(loop, numbers, None if times is None else times - epoch, epoch=epoch)], period=period)
