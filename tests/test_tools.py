"""Logs of the tools themselves, run over the loopback, where they are installed."""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from qocjax.recorded.as_trace import read_file
from qocjax.recorded.run import RecordedRun

pytestmark = pytest.mark.slow


@contextmanager
def server(*line: str) -> Iterator[None]:
    with subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        time.sleep(1.0)
        try:
            yield
        finally:
            process.terminate()


def output(*line: str) -> str:
    if shutil.which(line[0]) is None:
        pytest.skip(f"{line[0]} is not installed")
    return subprocess.run(line, capture_output=True, text=True, timeout=60).stdout


def loops(path: Path, least: int, period: float | None) -> RecordedRun:
    run = read_file(path)
    table = run.loops["loops"].table
    assert len(table) >= least and not table["lost"].any()
    assert 0.0 < table["loop_time"].median() < 0.05
    if period is not None:
        assert table["source_stamp"].diff().median() == pytest.approx(period, rel=0.2)
    return run


def test_irtt(tmp_path: Path) -> None:
    if shutil.which("irtt") is None:
        pytest.skip("irtt is not installed")
    with server("irtt", "server", "-b", "127.0.0.1:21120"):
        output("irtt", "client", "-Q", "-i", "20ms", "-d", "1s", "-o", str(tmp_path / "d.json"), "127.0.0.1:21120")
    run = loops(tmp_path / "d.json", 45, 0.02)
    table = run.loops["loops"].table
    assert run.loops["loops"].lost_uplink == 0
    np.testing.assert_allclose(table["uplink"] + table["compute"] + table["downlink"], table["loop_time"], atol=2e-6)


def test_ping(tmp_path: Path) -> None:
    (tmp_path / "ping.txt").write_text(output("ping", "-c", "6", "-i", "0.2", "127.0.0.1"))
    (tmp_path / "stamped.txt").write_text(output("ping", "-D", "-O", "-c", "6", "-i", "0.2", "127.0.0.1"))
    for name in ("ping.txt", "stamped.txt"):
        assert list(loops(tmp_path / name, 6, 0.2).findings) == []


def test_fping(tmp_path: Path) -> None:
    (tmp_path / "c.txt").write_text(output("fping", "-D", "-c", "5", "-p", "100", "127.0.0.1"))
    loops(tmp_path / "c.txt", 5, 0.1)


def test_sockperf(tmp_path: Path) -> None:
    if shutil.which("sockperf") is None:
        pytest.skip("sockperf is not installed")
    log = tmp_path / "log.csv"
    with server("sockperf", "server", "-i", "127.0.0.1", "-p", "21121"):
        output(
            "sockperf", "ping-pong", "-i", "127.0.0.1", "-p", "21121", "-t", "1", "--mps=100", "--full-log", str(log)
        )
    run = loops(log, 30, 0.01)
    shown = next(line for line in log.read_text().split("\n") if "avg-latency" in line)
    half = float(shown.split("avg-latency=")[1].split()[0]) / 1e6
    assert run.loops["loops"].table["loop_time"].mean() == pytest.approx(2.0 * half, rel=0.01)


def test_iperf3(tmp_path: Path) -> None:
    if shutil.which("iperf3") is None:
        pytest.skip("iperf3 is not installed")
    for name, more in (("sent.json", []), ("received.json", ["-R"])):
        with server("iperf3", "-s", "-1", "-B", "127.0.0.1", "-p", "21122"):
            line = "iperf3 -c 127.0.0.1 -p 21122 -u -b 1M -l 1000 -t 2 -i 0.5 -J".split()
            (tmp_path / name).write_text(output(*line, "-J", *more))
        notes = read_file(tmp_path / name).findings.notes
        assert "messages, 0 lost (0 %)" in notes[0] and "no delays" in notes[-1]
        assert ("intervals of 0.5 s: 0 with losses" in notes[1]) == bool(more)
