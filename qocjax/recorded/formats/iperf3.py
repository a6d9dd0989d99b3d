"""iperf3 -u -J: jitter and losses of each interval; no delays."""

from __future__ import annotations

from typing import Any

from qocjax._reading import decoding
from qocjax.network.records import parsed_json
from qocjax.recorded.findings import Findings
from qocjax.recorded.formats.log import Head, Log

__all__ = ["detect", "read"]

TITLE = "iperf3, JSON"


def detect(head: Head) -> bool:
    """Whether a file is one."""
    text = head.text[:20_000]
    return text.lstrip().startswith("{") and '"intervals"' in head.text and '"version":' in text and "iperf 3" in text


def read(head: Head, findings: Findings) -> Log:
    """Reads losses and jitter, and says what cannot be had.

    Raises:
        ValueError: It is no JSON of iperf3.
    """
    content = parsed_json(head.path, head.text)
    with decoding(head.path, "iperf3's JSON"):
        if "error" in content:
            raise ValueError(f"{head.path}: iperf3 ended with an error: {content['error']}")
        start = content["start"]["test_start"]
        if start["protocol"] != "UDP":
            return Log(notes=(f"{start['protocol']} test: throughput only, no delays and no losses of messages",))
        notes = [_total(content["end"])]
        seen = [each["sum"] for each in content["intervals"] if "lost_packets" in each["sum"]]
        if seen:
            shares = [each["lost_packets"] / max(each["packets"], 1) for each in seen]
            length = sum(each["seconds"] for each in seen) / len(seen)
            worst = max(range(len(shares)), key=shares.__getitem__)
            notes.append(
                f"{len(seen)} intervals of {length:.3g} s: {sum(share > 0 for share in shares)} with losses, at most "
                f"{shares[worst]:.2%} from {seen[worst]['start']:.4g} s on"
            )
        else:
            notes.append("losses of each interval are not in it: the receiving side knows them (server's log, or -R)")
    notes.append(
        "no delays: iperf3 does not measure them; jitter is a mean of differences, duplicates hide losses, and a "
        "client that sends reports no messages out of order; for delays use irtt, ping or sockperf"
    )
    return Log(notes=tuple(notes))


def _total(end: dict[str, Any]) -> str:
    total = end.get("sum_received") or end["sum"]
    return (
        f"{total['packets']} messages, {total['lost_packets']} lost ({total['lost_percent']:.3g} %), jitter "
        f"{total['jitter_ms']:.3g} ms"
    )
