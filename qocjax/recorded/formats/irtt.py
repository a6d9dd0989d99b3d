"""irtt client -o: round trips with four stamps each (heistp/irtt, doc/irtt-client.md)."""

from __future__ import annotations

from typing import Any

import numpy as np

from qocjax._reading import decoding
from qocjax.network.records import parsed_json
from qocjax.recorded.findings import Findings
from qocjax.recorded.formats.log import Head, Log, loops_of

__all__ = ["detect", "read"]

TITLE = "irtt, JSON of round trips"
_LOST = {"true", "true_up", "true_down"}  # words since 0.9.0, where a trip that came back says "false"


def detect(head: Head) -> bool:
    """Whether a file is one."""
    return head.text.lstrip().startswith("{") and '"round_trips"' in head.text and '"irtt"' in head.text


def read(head: Head, findings: Findings) -> Log:
    """Reads the round trips; losses are counted from them, never from the totals, which duplicates spoil.

    The loop time is the round trip and the time at the server, which irtt's own `rtt` leaves out.

    Raises:
        ValueError: It is no JSON, or a trip lacks a field.
    """
    content = parsed_json(head.path, head.text)
    with decoding(head.path, "irtt's JSON"):
        trips = content["round_trips"]
        if not isinstance(trips, list) or not trips:
            raise ValueError(f"{head.path}: holds no round trip")
        epoch = int(_stamp(trips[0]["timestamps"], "client", "send") or 0) // 10**9
        rows = [_row(trip, epoch * 10**9) for trip in trips]
    lost = [str(trip["lost"]).lower() for trip in trips]
    number, loop, send, receive, reply = (np.array(column, float) for column in zip(*rows, strict=True))
    odd = int(sum((word in _LOST) != (not np.isfinite(time)) for word, time in zip(lost, loop, strict=True)))
    findings.count(head.path.name, "contradictions", odd)
    edge = (receive, reply) if np.isfinite(receive).any() else None
    way = lost.count("true_up") if "true" not in lost else None
    notes = () if edge is not None else ("no stamps of the server: loop times are irtt's rtt, without the time there",)
    timed = send if np.isfinite(send).all() else None
    config = content.get("config")
    period = config["params"]["interval"] / 1e9 if timed is None and isinstance(config, dict) else None
    return Log([loops_of(loop, number, timed, edge, float(epoch))], lost_uplink=way, period=period, notes=notes)


def _row(trip: dict[str, Any], origin: int) -> tuple[float, ...]:
    """Number, loop time, and send, receive and reply stamps in s."""
    stamps, nan = trip["timestamps"], float("nan")
    ends = [_stamp(stamps, "client", "send"), _stamp(stamps, "server", "receive"), _stamp(stamps, "server", "send")]
    send, receive, reply = (nan if each is None else (each - origin) / 1e9 for each in ends)
    round_trip = (trip.get("delay") or {}).get("rtt")
    if round_trip is None or str(trip["lost"]).lower() in _LOST:
        return float(trip["seqno"]), np.inf, send, receive, reply
    there = 0 if ends[1] is None or ends[2] is None else ends[2] - ends[1]
    return float(trip["seqno"]), (round_trip + there) / 1e9, send, receive, reply


def _stamp(stamps: dict[str, Any], side: str, way: str) -> int | None:
    """A stamp in ns of the side's wall clock."""
    found = ((stamps.get(side) or {}).get(way) or {}).get("wall")
    return None if found is None else int(found)
