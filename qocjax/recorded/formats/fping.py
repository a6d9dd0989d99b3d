"""fping: an answer a line (-c, -l, with -D or not), the list of -C, and JSON lines (-J, since 5.3)."""

from __future__ import annotations

import json
import re

import numpy as np

from qocjax._reading import decoding
from qocjax.recorded.findings import Findings
from qocjax.recorded.formats.log import Head, Log, loops_of, with_missing

__all__ = ["detect", "read"]

TITLE = "fping"
_REPLY = re.compile(
    r"(?:\[(\d+\.\d+)\] )?(\S+) +: \[(\d+)\], (?:(?:\d+) bytes, ([\d.]+) ms .*|timed out .*|.*duplicate.*)"
)
_LIST = re.compile(r"(\S+) +:((?: (?:[\d.]+|-))+)")
_SUMMARY = re.compile(r'\S+ +: xmt/rcv/%loss = |\{"summary":')
_JSON = re.compile(r'\{"(?:resp|timeout)": ?\{"host"')


def detect(head: Head) -> bool:
    """Whether a file is one."""
    return any(_REPLY.fullmatch(line) or _LIST.fullmatch(line) or _JSON.match(line) for line in head.lines)


def read(head: Head, findings: Findings) -> Log:
    """Reads the answers of the one host that was asked.

    Raises:
        ValueError: There are several hosts, or nothing came back.
    """
    lines = [line for line in head.text.split("\n") if line.strip() and not _SUMMARY.match(line)]
    rows = [(host, number, time, stamp) for line in lines for host, number, time, stamp in _rows(head, line)]
    findings.count(head.path.name, "unreadable", sum(not _known(line) for line in lines))
    hosts = dict.fromkeys(row[0] for row in rows)
    if len(hosts) != 1:
        raise ValueError(f"{head.path}: holds the answers of {len(hosts)} hosts, expected one")
    number, time, stamp = (np.array(column, float) for column in list(zip(*rows, strict=True))[1:])
    send = stamp - np.where(np.isfinite(time), time, 0.0)
    numbers, loop, times = with_missing(
        number, time, head.path.name, findings, first=0, send=np.where(np.isfinite(time), send, np.nan)
    )
    if not np.isfinite(loop).any():
        raise ValueError(f"{head.path}: no message came back, expected at least one answer")
    epoch = 0.0 if times is None else float(np.floor(times[0]))
    return Log([loops_of(loop, numbers, None if times is None else times - epoch, epoch=epoch)])


def _known(line: str) -> bool:
    return any(each.fullmatch(line) for each in (_REPLY, _LIST)) or _JSON.match(line) is not None


def _rows(head: Head, line: str) -> list[tuple[str, float, float, float]]:
    """Host, number, round trip (s, inf where lost) and time of the answer (s since 1970, or NaN) of a line."""
    if _JSON.match(line):
        with decoding(head.path, "fping's JSON"):
            (kind, each), *_ = json.loads(line).items()
            time = each["rtt"] / 1e3 if kind == "resp" else np.inf
            return [(each["host"], float(each["seq"]), time, float(each.get("timestamp", np.nan)))]
    if (found := _REPLY.fullmatch(line)) is not None:
        if "duplicate" in line:
            return []
        time = float(found[4]) / 1e3 if found[4] else np.inf
        return [(found[2], float(found[3]), time, float(found[1] or np.nan))]
    if (found := _LIST.fullmatch(line)) is not None and not any(map(_REPLY.fullmatch, head.lines)):
        times = [np.inf if word == "-" else float(word) / 1e3 for word in found[2].split()]
        return [(found[1], float(k), time, np.nan) for k, time in enumerate(times)]
    return []
