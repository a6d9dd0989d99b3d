"""Logs of this field's tools, known by what is in them: one small reader a format, one signature.

A format is a module, or a `Layout`, with a `TITLE`, `detect(head) -> bool` and `read(head, findings) -> Log`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from qocjax._reading import decoding, read_text
from qocjax.network.columns import names_of
from qocjax.recorded.findings import Findings
from qocjax.recorded.formats import (
    caret,
    delay_replayer,
    fping,
    iperf3,
    irtt,
    owamp,
    performance_test,
    ping,
    sockperf,
    tables,
)
from qocjax.recorded.formats.log import Head, Log

__all__ = ["FORMATS", "Log", "found_format", "read_log"]


class Format(Protocol):
    """How a format is told and read."""

    TITLE: str

    def detect(self, head: Head) -> bool:
        """Whether a file is one."""
        ...

    def read(self, head: Head, findings: Findings) -> Log:
        """Reads it."""
        ...


_MODULES: Any = {
    "irtt": irtt, "iperf3": iperf3, "ping": ping, "fping": fping, "sockperf": sockperf,
    "performance_test": performance_test, "owping": owamp, "delay_replayer": delay_replayer, **tables.LAYOUTS,
    "caret": caret, "table": tables,
}  # fmt: skip
FORMATS: dict[str, Format] = _MODULES
"""By name, in the order in which they are looked for."""

_LINES = 40  # that a format is told by


def found_format(path: Path) -> str | None:
    """Name of the format of a file; None where it is none of them, or cannot be read."""
    try:
        head = _head(path)
    except ValueError:
        return None
    return next((name for name, each in FORMATS.items() if each.detect(head)), None)


def read_log(path: Path, name: str, findings: Findings, unit: str | None = None) -> Log:
    """Reads a file of a format.

    Args:
        path: The file.
        name: One of `FORMATS`.
        findings: Takes the counts.
        unit: Of times that the file says no unit of: s, ms, us or ns.

    Raises:
        ValueError: It cannot be read as one; one line with the file.
    """
    head = replace(_head(path), unit=unit)
    with decoding(path, FORMATS[name].TITLE):
        if not FORMATS[name].detect(head):
            raise ValueError(f"{path}: is no {FORMATS[name].TITLE}, expected one, or format=auto")
        return FORMATS[name].read(head, findings)


def _head(path: Path) -> Head:
    text = "" if path.suffix == ".parquet" else read_text(path)
    lines = tuple(line for line in text[:100_000].split("\n") if line.strip())[:_LINES]
    try:
        names = tuple(names_of(path))
    except ValueError:
        names = ()
    return Head(path, text, lines, names)
