"""Logs as the tools of this field write them, made here, each with what is right to say of it."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

__all__ = ["LOGS", "Sample"]

INF = np.inf


@dataclass(frozen=True)
class Sample:
    """A file of a format."""

    name: str  # of the file
    text: str
    loops: list[float]  # ms, inf where lost
    period: float | None = None  # s
    findings: dict[str, int] | None = None
    said: str = ""  # part of a note
    lost_uplink: int | None = None
    one_way: list[float] | None = None  # ms


def _irtt() -> str:
    """Round trips as in irtt's manual; `lost` is a word since 0.9.0, a truth before."""
    trips, start = [], 1508180723502727340
    rows = [(0, "false", 89283, 9979, 45177), (1, False, 54187, 10952, 45268), (2, "true_up", 0, 0, 0),
            (3, "true_down", 0, 0, 0), (4, "false", 60000, 10000, 50000)]  # fmt: skip
    for seq, lost, up, work, down in rows:
        send = start + 200_000_000 * seq
        stamps: dict = {"client": {"receive": {}, "send": {"wall": send, "monotonic": seq}},
                        "server": {"receive": {}, "send": {}}}  # fmt: skip
        delay = {}
        if str(lost).lower() == "false":
            stamps["server"] = {"receive": {"wall": send + up, "monotonic": 1},
                                "send": {"wall": send + up + work, "monotonic": 1}}  # fmt: skip
            stamps["client"]["receive"] = {"wall": send + up + work + down, "monotonic": 1}
            delay = {"receive": down, "rtt": up + down, "send": up}
        trips.append({"seqno": seq, "lost": lost, "timestamps": stamps, "delay": delay, "ipdv": {}})
    stats = {"packets_sent": 5, "packets_received": 3, "upstream_loss_percent": 1.8e19}
    return json.dumps({"version": {"irtt": "0.9.0"}, "stats": stats, "round_trips": trips}, indent=1)


def _iperf3() -> str:
    intervals = [
        {"streams": [], "sum": {"start": k / 2, "end": (k + 1) / 2, "seconds": 0.5, "bytes": 65536, "jitter_ms": 0.1,
                                "lost_packets": [0, 3, 0, 1][k], "packets": 20, "lost_percent": 0.0}}
        for k in range(4)
    ]  # fmt: skip
    total = {"start": 0, "end": 2.0, "seconds": 2.0, "jitter_ms": 0.125, "lost_packets": 4, "packets": 80,
             "lost_percent": 5.0}  # fmt: skip
    start = {"version": "iperf 3.12", "test_start": {"protocol": "UDP", "num_streams": 1}}
    return json.dumps({"start": start, "intervals": intervals, "end": {"streams": [], "sum": total}}, indent=1)


PING = """PING 10.0.0.2 (10.0.0.2) 56(84) bytes of data.
64 bytes from 10.0.0.2: icmp_seq=1 ttl=64 time=24.3 ms
64 bytes from 10.0.0.2: icmp_seq=2 ttl=64 time=21.8 ms
64 bytes from 10.0.0.2: icmp_seq=4 ttl=64 time=120 ms
64 bytes from 10.0.0.2: icmp_seq=4 ttl=64 time=131 ms (DUP!)
64 bytes from 10.0.0.2: icmp_seq=5 ttl=64 time=19.5 ms

--- 10.0.0.2 ping statistics ---
6 packets transmitted, 4 received, +1 duplicates, 33.3333% packet loss, time 5007ms
rtt min/avg/max/mdev = 19.500/46.400/120.000/42.530 ms
"""

PING_STAMPED = """PING host (10.0.0.2) 56(84) bytes of data.
[1700000000.020000] 64 bytes from host (10.0.0.2): icmp_seq=1 ttl=64 time=20.0 ms
[1700000000.450000] no answer yet for icmp_seq=2
[1700000000.421000] 64 bytes from host (10.0.0.2): icmp_seq=3 ttl=64 time=21.0 ms
[1700000000.622000] 64 bytes from host (10.0.0.2): icmp_seq=4 ttl=64 time=22.0 ms
[1700000000.823000] 64 bytes from host (10.0.0.2): icmp_seq=5 ttl=64 time=23.0 ms
"""

PING_BSD = """PING 10.0.0.2 (10.0.0.2): 56 data bytes
64 bytes from 10.0.0.2: icmp_seq=0 ttl=64 time=24.300 ms
Request timeout for icmp_seq 1
64 bytes from 10.0.0.2: icmp_seq=2 ttl=64 time=21.000 ms
Request timeout for icmp_seq 3

--- 10.0.0.2 ping statistics ---
5 packets transmitted, 2 packets received, 60.0% packet loss
round-trip min/avg/max/stddev = 21.000/22.650/24.300/1.650 ms
"""

FPING = """[1700000000.02000] 10.0.0.2 : [0], 64 bytes, 20.0 ms (20.0 avg, 0% loss)
[1700000000.12100] 10.0.0.2 : [1], 64 bytes, 21.0 ms (20.5 avg, 0% loss)
10.0.0.2 : [2], timed out (20.5 avg, 33% loss)
[1700000000.32300] 10.0.0.2 : [3], 64 bytes, 23.0 ms (21.3 avg, 25% loss)
[1700000000.42400] 10.0.0.2 : [4], 64 bytes, 24.0 ms (22.0 avg, 20% loss)

10.0.0.2 : xmt/rcv/%loss = 5/4/20%, min/avg/max = 20.0/22.0/24.0
"""

FPING_JSON = """{"resp": {"host": "10.0.0.2", "seq": 0, "size": 64, "rtt": 20.5}}
{"timeout": {"host": "10.0.0.2", "seq": 1}}
{"resp": {"host": "10.0.0.2", "seq": 2, "size": 64, "rtt": 22.25}}
{"summary": {"host": "10.0.0.2", "xmt": 3, "rcv": 2, "loss": 33, "rttMin": 20.5, "rttAvg": 21.4, "rttMax": 22.3}}
"""

SOCKPERF = """------------------------------
test was performed using the following parameters: --mps=100 --burst=1 --reply-every=1 --msg-size=14 --time=1
------------------------------
sockperf: [Total Run] RunTime=1.000 sec; Warm up time=400 msec; SentMessages=6; ReceivedMessages=5
sockperf: # dropped messages = 1; # duplicated messages = 0; # out-of-order messages = 0
sockperf: Total 5 observations; each percentile contains 0.05 observations
------------------------------
packet, txTime(sec), rxTime(sec), latency(usec)
0, 2.410000000, 2.410090000, 45.000
1, 2.420000000, 2.420110000, 55.000
2, 2.440000000, 2.440080000, 40.000
3, 2.450000000, 2.450100000, 50.000
4, 2.460000000, 2.460120000, 60.000
------------------------------
"""

PERFORMANCE = """Experiment id: 0
Performance Test Version: 57791ae
Logfile name:
Communication mean: ROS2
Publishing rate: 100
Topic name: Array60k

---EXPERIMENT-START---
T_experiment,T_loop,received,sent,lost,relative_loss,latency_min (ms),latency_max (ms),latency_mean (ms),
2.000545,		1.000206,		98,		98,		0,		0.00,		3.1,		9.8,		4.2,
3.000989,		1.000149,		0,		100,		100,		1.00,		inf,		-inf,		0,
4.001462,		1.000155,		99,		99,		0,		0.00,		3.0,		9.6,		4.4,
Maximum runtime reached. Exiting.
"""


def _owping() -> str:
    """Records as owping -R prints them: times are 32.32 bits since 1900, 0 where nothing arrived."""
    begin, lines = (1_700_000_000 + 2_208_988_800) << 32, []
    for k, delay in enumerate([20.0, 21.0, INF, 23.0]):
        send = begin + int(0.1 * k * 2**32)
        receive = 0 if np.isinf(delay) else send + int(delay / 1e3 * 2**32)
        lines.append(
            f"{k} {send:020d} 1 3.8147e-06 {receive:020d} {int(receive > 0)} 0.000305176 {255 * (receive > 0)}"
        )
    return "\n".join(lines) + "\n"


OWPING_TEXT = """seq_no=0          delay=20 ms\t(sync, err=0.31 ms)
seq_no=1          delay=21.5 ms\t(sync, err=0.31 ms)
seq_no=2          *LOST*
seq_no=3          delay=23 ms\t(unsync)
"""

EDGEDROID = ",client_id,client_recv,client_send,feedback,frame_id,server_recv,server_send,run_id\n" + "".join(
    f"{k},0,{1526294697057.0 + 100 * k + 60},{1526294697057.0 + 100 * k},False,{k},{1526294697057.0 + 100 * k + 5},"
    f"{1526294697057.0 + 100 * k + 50},0\n"
    for k in range(5)
)

CLEAVE = "seq,send_timestamp,send_size,recv_timestamp,recv_size,rtt\n" + "".join(
    f"{k}.0,{1639276166.5 + 0.05 * k:.6f},122.0,{'' if k == 2 else f'{1639276166.5 + 0.05 * k + 0.004:.6f}'},72.0,"
    f"{'inf' if k == 2 else 0.004}\n"
    for k in range(5)
)

CICV = "pub_time(ms) sub_time(ms) delay(ms) utmX(m)\n" + "".join(
    f"{1722419558737 + 55 * k} {1722419558737 + 55 * k + 20 + k} {20 + k} 329081.86\n" for k in range(5)
)

CARET = (
    ",/camera/rclcpp_publish_timestamp/0_min,/camera/rclcpp_publish_timestamp/0_max,/node/callback_start_timestamp/0,"
    "/control/rclcpp_publish_timestamp/0\n"
    + "".join(
        f"{k},{1700000000000000000 + 100_000_000 * k - 9},{1700000000000000000 + 100_000_000 * k},"
        f"{1700000000000000000 + 100_000_000 * k + 1_000_000},"
        f"{'' if k == 1 else 1700000000000000000 + 100_000_000 * k + 30_000_000}\n"
        for k in range(4)
    )
)

LOGS = {
    "irtt": Sample("d.json", _irtt(), [0.144439, 0.110407, INF, INF, 0.12], 0.2, {}, "", 1),
    "ping": Sample("ping.txt", PING, [24.3, 21.8, INF, 120, 19.5, INF], 1.0, {"duplicates": 1}),
    "ping -D -O": Sample("ping.txt", PING_STAMPED, [20, INF, 21, 22, 23], 0.2, {}),
    "ping of BSD": Sample("ping.log", PING_BSD, [24.3, INF, 21, INF, INF], None, {}),
    "fping": Sample("fping.txt", FPING, [20, 21, INF, 23, 24], 0.1, {}),
    "fping -C": Sample("fping.err", "10.0.0.2 : 20.5 - 22.25\n", [20.5, INF, 22.25], None, {}),
    "fping -J": Sample("fping.jsonl", FPING_JSON, [20.5, INF, 22.25], None, {}),
    "sockperf": Sample("log.csv", SOCKPERF, [0.09, 0.11, INF, 0.08, 0.1, 0.12], 0.01, {}),
    "performance_test": Sample("log.csv", PERFORMANCE, [4.2, INF, 4.4], 1.0, {}, "F of single messages cannot be had"),
    "iperf3": Sample("iperf3.json", _iperf3(), [], None, {}, "80 messages, 4 lost (5 %), jitter 0.125 ms"),
    "owping -R": Sample("raw.txt", _owping(), [], None, {}, "one-way delays", None, [20, 21, INF, 23]),
    "owping -v": Sample("owping.txt", OWPING_TEXT, [], None, {}, "clocks of 1 of 4 records", None, [20, 21.5, INF, 23]),
    "DelayReplayer": Sample("cycle.csv", "5.602ms\n5.571ms\n6402us\n27.80ms\n", [5.602, 5.571, 6.402, 27.8], None, {}),
    "DelayReplayer with times": Sample(
        "timed.csv", "5.602ms,0ns\n5.571ms,10000000ns\n6.402ms,20000000ns\n27.80ms,30000000ns\n",
        [5.602, 5.571, 6.402, 27.8], 0.01, {},
    ),
    "EdgeDroid": Sample("total_frame_stats.csv", EDGEDROID, [60.0] * 5, 0.1, {}),
    "CLEAVE": Sample("udpclient.plant.3.x.csv", CLEAVE, [4, 4, INF, 4, 4], 0.05, {}),
    "CICV5G": Sample("urban.txt", CICV, [20, 21, 22, 23, 24], 0.055, {}),
    "CARET": Sample("path.csv", CARET, [30, INF, 30, 30], 0.1, {}, "from /camera/rclcpp_publish_timestamp/0_max to"),
    "loop times": Sample("loops.csv", "seq;rtt(ms)\n0;20,5\n1;NaN\n2;21,5\n", [20.5, INF, 21.5], None, {}, "'rtt(ms)'"),
}  # fmt: skip
