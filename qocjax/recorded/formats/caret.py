"""Paths of messages through ROS 2 nodes: records of CARET, a row of time stamps in ns each."""

from __future__ import annotations

import re

import numpy as np

from qocjax.network.columns import table_of_text
from qocjax.recorded.findings import Findings
from qocjax.recorded.formats.log import Head, Log, loops_of

__all__ = ["detect", "read"]

TITLE = "CARET, records of a path"
_NAME = re.compile(r".*timestamp(?:/\d+)?(?:_min|_max)?")


def _columns(names: tuple[str, ...]) -> list[str]:
    """Columns of stamps in their order, without the earliest inputs of a response time."""
    return [name for name in names if _NAME.fullmatch(name) and not name.endswith("_min")]


def detect(head: Head) -> bool:
    """Whether a file is one: all columns but an index are stamps."""
    return len(_columns(head.names)) > 1 and all(_NAME.fullmatch(name) for name in head.names[1:]) and any(
        "/" in name for name in head.names
    )  # fmt: skip


def read(head: Head, findings: Findings) -> Log:
    """Reads the time from the first stamp of a path to its last; a path that ends before is lost.

    Raises:
        ValueError: An entry is no number.
    """
    first, *_, last = _columns(head.names)
    table = table_of_text(head.path, head.text, [first, last])
    begin, end = table.optional_numbers(first), table.optional_numbers(last)
    rows = [k for k, each in enumerate(begin) if each is not None]
    findings.count(head.path.name, "no_source_stamp", len(begin) - len(rows))
    if not rows:
        raise ValueError(f"{head.path}: column {first!r} is empty, expected stamps in ns")
    epoch = int(begin[rows[0]] or 0) // 10**9
    send = np.array([((begin[k] or 0) - epoch * 10**9) / 1e9 for k in rows])
    loop = np.array([np.inf if end[k] is None else ((end[k] or 0) - (begin[k] or 0)) / 1e9 for k in rows])
    wrong = loop < 0.0
    findings.count(head.path.name, "negative_loop_time", int(wrong.sum()))
    return Log(
        [loops_of(loop[~wrong], None, send[~wrong], epoch=float(epoch))],
        notes=(f"from {first} to {last}",),
        computed=True,
    )
