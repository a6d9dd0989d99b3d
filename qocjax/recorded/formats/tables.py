"""Tables whose columns have usual names: loop times, and the layouts of CLEAVE, EdgeDroid and CICV5G."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from qocjax.network.columns import read_columns
from qocjax.network.period import is_send_time
from qocjax.network.readers import send_times
from qocjax.network.values import header_unit
from qocjax.recorded.findings import Findings
from qocjax.recorded.formats.log import Head, Log, loops_of
from qocjax.recorded.stamps import StampsFormat, read_stamps

__all__ = ["LAYOUTS", "Layout", "detect", "read"]

TITLE = "a table of loop times"
_TIMES = ("loop_time", "rtt", "round_trip_time", "round_trip", "latency", "delay")
_NUMBERS = ("sequence", "seq", "seqno", "seq_no", "icmp_seq", "frame_id", "number")


def _first(names: tuple[str, ...], wanted: tuple[str, ...]) -> str | None:
    bases = {header_unit(name)[0].lower(): name for name in reversed(names)}
    return next((bases[word] for word in wanted if word in bases), None)


def detect(head: Head) -> bool:
    """Whether a file is one."""
    return _first(head.names, _TIMES) is not None


def read(head: Head, findings: Findings) -> Log:
    """Reads loop times by the usual names of their columns, with numbers and send times where there are.

    Raises:
        ValueError: An entry is no number, or nothing tells the unit.
    """
    time, number = _first(head.names, _TIMES), _first(head.names, _NUMBERS)
    assert time is not None
    wanted = [time] if number is None else [time, number]
    table = read_columns(head.path, wanted, also=is_send_time)
    delays = np.array(table.delays(time, head.unit or ("s" if time == "loop_time" else None)))
    numbers = None if number is None else np.array(table.numbers(number), float)
    found = send_times(table, time, None, None)
    send = None if found is None or not np.isfinite(found[1]).all() else found[1]
    said = [f"loop times from {time!r}"] + ([] if number is None else [f"numbers from {number!r}"])
    return Log(
        [loops_of(delays, numbers, send)],
        notes=("; ".join(said),),
        computed=header_unit(time)[0].lower() == "loop_time",
    )


@dataclass(frozen=True)
class Layout:
    """A table of stamps with a layout of its own."""

    TITLE: str
    columns: frozenset[str]
    layout: StampsFormat
    edge: str | None = None  # pattern of the edge's table, * for the number in the name of the robot's
    computed: bool = True  # whether an edge computes in between

    def detect(self, head: Head) -> bool:
        """Whether a file is one."""
        return self.columns <= set(head.names)

    def read(self, head: Head, findings: Findings) -> Log:
        """Reads its stamps.

        Raises:
            ValueError: As `read_stamps`.
        """
        layout, edge = self.layout, None
        if self.edge is not None:
            own = head.path.name.split(".")
            wanted = self.edge.replace("*", own[2] if len(own) > 3 else "-", 1)
            beside = [each for each in sorted(head.path.parent.iterdir()) if fnmatch.fnmatchcase(each.name, wanted)]
            edge = beside[0] if len(beside) == 1 else None
        if edge is None and layout.edge_columns is not None:
            layout = StampsFormat(
                layout.sequence, layout.uplink_send, None, None, layout.downlink_receive, unit=layout.unit
            )
        return Log(read_stamps(head.path, layout, edge, findings), computed=self.computed)


Reader = Callable[[Head, Findings], Log]

LAYOUTS = {
    "cleave": Layout(
        "CLEAVE, table of a plant", frozenset({"seq", "send_timestamp", "recv_timestamp", "rtt"}),
        StampsFormat("seq", "send_timestamp", downlink_receive="recv_timestamp",
                     edge_columns=("seq", "recv_timestamp", "send_timestamp"), edge_files="-"),
        edge="service.controller.*.*.csv",
    ),
    "edgedroid": Layout(
        "EdgeDroid, frames of all runs",
        frozenset({"frame_id", "client_send", "client_recv", "server_recv", "server_send", "run_id"}),
        StampsFormat("frame_id", "client_send", "server_recv", "server_send", "client_recv", session="run_id",
                     unit="ms"),
    ),
    "cicv5g": Layout(
        "CICV5G, round trips", frozenset({"pub_time(ms)", "sub_time(ms)", "delay(ms)"}),
        StampsFormat(None, "pub_time(ms)", None, None, "sub_time(ms)"), computed=False,
    ),
}  # fmt: skip
