"""What the nodes tell of themselves: diagnostics, and tables of the loops."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Sequence
from itertools import count
from pathlib import Path
from typing import Any

__all__ = ["Diagnostics", "Record"]


class Diagnostics:
    """Tells of a node on /diagnostics, every period on the node's clock.

    Args:
        node: Of rclpy.
        what: What is told of, after the node's name.
        period: s.
        report: Gives the level (0 OK, 1 warning, 2 error), a message, and values.
    """

    def __init__(
        self, node: Any, what: str, period: float, report: Callable[[], tuple[int, str, dict[str, Any]]]
    ) -> None:
        from diagnostic_msgs.msg import DiagnosticArray

        self._node, self._what, self._report = node, what, report
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._timer = node.create_timer(period, self.tell)

    def tell(self) -> None:
        """Tells now."""
        from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

        level, message, values = self._report()
        name = self._node.get_fully_qualified_name()
        status = DiagnosticStatus(
            level=bytes([level]), name=f"{name}: {self._what}", message=message, hardware_id=name,
            values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()],
        )  # fmt: skip
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)


def _text(value: Any) -> str:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


class Record:
    """A table in a new file, a row at a time; nothing where the path is empty.

    Raises:
        OSError: It cannot be written.
    """

    def __init__(self, path: str, columns: Sequence[str]) -> None:
        self.path = _free(Path(os.path.expanduser(path))) if path else None
        if self.path is not None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = open(self.path, "x", buffering=1, newline="", encoding="utf-8")
            self.add(*columns)

    def add(self, *row: Any) -> None:
        """Writes a row, at once."""
        if self.path is not None:
            csv.writer(self._file).writerow(row)

    def close(self) -> None:
        """Ends the file."""
        if self.path is not None:
            self._file.close()


def _free(path: Path) -> Path:
    """The path, or one beside it with a number where there is such a file."""
    names = (path.with_stem(f"{path.stem}_{k}") if k else path for k in count())
    return next(each for each in names if not each.exists())
