"""Text of ping: iputils in any language, BSD and macOS, inetutils, busybox."""

from __future__ import annotations

import re

import numpy as np

from qocjax.recorded.findings import Findings
from qocjax.recorded.formats.log import Head, Log, loops_of, with_missing
from qocjax.recorded.stamps import Stamps

__all__ = ["detect", "read"]

TITLE = "ping, text"
_REPLY = re.compile(
    r"(?:\[(\d+\.\d+)\] )?\d+ \w+ \w+ \S+.*?: ?(?:icmp_)?seq=(\d+) (?:ttl|hlim)=\d+ \w+[=<](\d+(?:[.,]\d+)?) ?ms(.*)"
)
_MISSING = re.compile(r"(?:\[[\d.]+\] )?(?:no answer yet for icmp_seq=|Request timeout for icmp_seq )(\d+)")
_ERROR = re.compile(r"(?:\[[\d.]+\] )?From .* icmp_seq=(\d+) ")
_SUMMARY = re.compile(r"(\d+) [^,\d]+, (\d+) [^,\d]+(?:, \+\d+ \w+)*, [\d.,]+ ?% [^,]*(?:, \S+ (\d+) ?ms)?")
_ASIDE = ("PING", "---", "rtt ", "round-trip ", "WARNING", "ping: ", "pipe ", "^C")


def detect(head: Head) -> bool:
    """Whether a file is one."""
    return any(line.startswith(("PING ", "PING6(")) for line in head.lines[:3]) or any(map(_REPLY.match, head.lines))


def read(head: Head, findings: Findings) -> Log:
    """Reads the answers of one run after the other; what was sent and has none is lost, a DUP! is not another loop.

    With -D the send time is the printed one less the round trip; else the period is that of the summary, if it has
    one, and losses at the end are known from its count.

    Raises:
        ValueError: No message came back.
    """
    blocks = re.split(r"^(?=PING6?[ (])", head.text, flags=re.MULTILINE)
    runs = [found for block in blocks if block.strip() and (found := _run(head, block, findings)) is not None]
    if not runs:
        raise ValueError(f"{head.path}: no message came back, expected an answer such as 'icmp_seq=1 ... time=9 ms'")
    timed = all(part.timed for part, _ in runs)
    parts = [loops_of(part.downlink_receive - part.uplink_send, part.sequence) for part, _ in runs]
    period = runs[0][1] if all(each == runs[0][1] for _, each in runs) or len(runs) == 1 else None
    return Log([part for part, _ in runs] if timed else parts, period=period)


def _run(head: Head, text: str, findings: Findings) -> tuple[Stamps, float | None] | None:
    """The loops of one run, and the period that its summary tells; None where nothing came back."""
    where, replies, silent, other = head.path.name, [], [], 0
    sent = received = span = None
    for line in text.split("\n"):
        if found := _REPLY.match(line):
            time = float(found[3].replace(",", ".")) / 1e3
            replies.append((float(found[1] or np.nan), float(found[2]), time, "DUP" in found[4]))
        elif found := _MISSING.match(line) or _ERROR.match(line):
            silent.append(float(found[1]))
        elif found := _SUMMARY.search(line):
            sent, received, span = int(found[1]), int(found[2]), found[3]
        elif line.strip() and not line.startswith(_ASIDE):
            other += 1
    findings.count(where, "unreadable", other)
    if not replies:
        findings.count(where, "contradictions", received or 0)
        if sent or silent:
            findings.note(f"{where}: a run without any answer is left out")
        return None
    came = len(replies) - sum(each[3] for each in replies)
    findings.count(where, "contradictions", 0 if received is None else abs(came - received))
    quiet = sorted(set(silent) - {each[1] for each in replies})
    stamp, number, time = np.array([each[:3] for each in replies] + [(np.nan, each, np.inf) for each in quiet]).T
    if quiet and number.max() < 65535:  # told of by the tool, in their places
        order = np.argsort(number, kind="stable")
        stamp, number, time = stamp[order], number[order], time[order]
    send = stamp - time if np.isfinite(stamp).any() else None
    first = 0 if "data bytes" in text[:400] else 1
    numbers, loop, times = with_missing(number, time, where, findings, first, sent, send)
    epoch = 0.0 if times is None else float(np.floor(times[0]))
    part = loops_of(loop, numbers, None if times is None else times - epoch, epoch=epoch)
    return part, float(span) / 1e3 / (sent - 1) if span is not None and sent is not None and sent > 1 else None
