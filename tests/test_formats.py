"""Logs of tools, read without being told what they are: what comes out, what is said, and the trace of it."""

from __future__ import annotations

import gzip
import json
import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from logs import LOGS, Sample

from qocjax.commands.advise import run as advise
from qocjax.commands.command_line import _expanded
from qocjax.config import conf_dir, load
from qocjax.config.advise import AdviseConfig
from qocjax.network import Trace, read_trace
from qocjax.recorded import Rules, RunFiles, StampsFormat, TopicPatterns, find_runs, read_run
from qocjax.recorded.as_trace import read_file, trace_of
from qocjax.recorded.formats import FORMATS
from qocjax.recorded.pose_tables import PosesFormat, read_poses
from qocjax.recorded.run import RecordedRun
from qocjax.recorded.text import run_lines

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.filterwarnings("ignore:.*(nothing tells how often|found )")


def write(sample: Sample, folder: Path) -> Path:
    path = folder / sample.name
    path.write_text(sample.text, encoding="utf-8")
    return path


def counts(run: RecordedRun) -> dict[str, int]:
    return {found.cause: found.count for found in run.findings}


@pytest.mark.parametrize("kind", LOGS)
def test_each_format_is_known_by_what_is_in_it(kind: str, tmp_path: Path) -> None:
    sample = LOGS[kind]
    run = read_file(write(sample, tmp_path))
    assert run.format and counts(run) == (sample.findings or {})
    assert sample.said in "; ".join(run.findings.notes)
    if sample.one_way is not None:
        np.testing.assert_allclose(run.one_way["one_way"], np.array(sample.one_way) / 1e3, rtol=1e-6)
    if not sample.loops:
        assert run.loops == {}
        with pytest.raises(ValueError, match=f"{sample.name}: .*expected the loop times of one robot"):
            trace_of(run, str(tmp_path / sample.name))
        return
    trace = trace_of(run, str(tmp_path / sample.name))
    np.testing.assert_allclose(trace.delays, np.array(sample.loops) / 1e3, rtol=1e-4, atol=2e-9)
    assert trace.period == (None if sample.period is None else pytest.approx(sample.period, rel=3e-3))
    if sample.lost_uplink is not None:
        assert run.loops["loops"].lost_uplink == sample.lost_uplink
    text = "\n".join(run_lines(run, None))
    assert run.format in text and f"{len(sample.loops)} loops" in text
    assert ("bursts" in text) == bool(np.isinf(sample.loops).any())


@pytest.mark.parametrize("kind", ["irtt", "ping", "fping", "DelayReplayer", "CICV5G"])
def test_packed_logs_are_the_same(kind: str, tmp_path: Path) -> None:
    path = write(LOGS[kind], tmp_path)
    packed = path.with_name(path.name + ".gz")
    packed.write_bytes(gzip.compress(path.read_bytes()))
    plain, again = (trace_of(read_file(each), "x") for each in (path, packed))
    np.testing.assert_array_equal(plain.delays, again.delays)
    assert plain.period == again.period


def test_a_folder_holds_logs_of_any_kind(tmp_path: Path) -> None:
    for k, kind in enumerate(("irtt", "ping", "sockperf", "CICV5G")):
        (tmp_path / str(k)).mkdir()
        write(LOGS[kind], tmp_path / str(k))
    (tmp_path / "notes.txt").write_text("nothing of interest\n")
    found = find_runs(tmp_path, StampsFormat())
    assert [each.log[1] for each in found if each.log] == ["irtt", "ping", "sockperf", "cicv5g"]


def test_a_format_that_is_asked_for_is_the_one(tmp_path: Path) -> None:
    path = write(LOGS["ping"], tmp_path)
    (files,) = find_runs(path, StampsFormat(), kind="ping")
    assert files.log == (path, "ping")
    with pytest.raises(ValueError, match=r"ping.txt: is no irtt, JSON of round trips, expected one, or format=auto"):
        read_run(RunFiles("x", log=(path, "irtt")), Rules(TopicPatterns((), ())), quiet=True)
    assert all(each.TITLE for each in FORMATS.values())


def test_a_chosen_layout_is_not_guessed_over(tmp_path: Path) -> None:
    path = write(LOGS["irtt"], tmp_path)
    layout = StampsFormat(
        "seqno", "timestamps.client.send.wall", "timestamps.server.receive.wall", "timestamps.server.send.wall",
        "timestamps.client.receive.wall", unit="ns", records="round_trips",
    )  # fmt: skip
    (files,) = find_runs(path, layout)
    assert files.log is None
    run = read_run(files, Rules(TopicPatterns((), ()), layout), quiet=True)
    loops = run.loops["loops"].table["loop_time"].to_numpy()
    np.testing.assert_allclose(loops, np.array(LOGS["irtt"].loops) / 1e3, atol=1e-9)


def test_ping_counts_what_its_summary_knows(tmp_path: Path) -> None:
    path = tmp_path / "ping.txt"
    path.write_text(LOGS["ping"].text.replace("icmp_seq=5 ttl", "icmp_seq=5 tt"))
    run = read_file(path)  # a damaged line: what the summary says of it is not what is there
    assert counts(run) == {"contradictions": 1, "unreadable": 1, "duplicates": 1}
    path.write_text("\n".join(LOGS["ping"].text.split("\n")[:3]))  # killed
    assert len(read_file(path).loops["loops"].table) == 2
    path.write_text("PING h (1.2.3.4) 56(84) bytes of data.\n\n2 packets transmitted, 0 received, 100% packet loss\n")
    with pytest.raises(ValueError, match=r"ping.txt: no message came back"):
        read_file(path)


def test_ping_in_another_language_and_several_runs_in_one_file(tmp_path: Path) -> None:
    german = LOGS["ping"].text.replace("bytes from", "Bytes von").replace("time=", "Zeit=").replace("24.3", "24,3")
    english = "6 packets transmitted, 4 received, +1 duplicates, 33.3333% packet loss, time 5007ms"
    translated = "6 Pakete übertragen, 4 empfangen, +1 Duplikate, 33.3333% Paketverlust, Zeit 5007ms"
    assert english in german
    german = german.replace(english, translated)
    (tmp_path / "ping.txt").write_text(german + "\n" + LOGS["ping"].text)
    run = read_file(tmp_path / "ping.txt")
    table = run.loops["loops"].table
    np.testing.assert_allclose(table["loop_time"], 2 * [0.0243, 0.0218, np.inf, 0.12, 0.0195, np.inf])
    assert counts(run) == {"duplicates": 2} and trace_of(run, "x").period == pytest.approx(1.0, rel=3e-3)
    first, second = LOGS["ping -D -O"].text, LOGS["ping -D -O"].text.replace("[17000000", "[17000001")
    (tmp_path / "ping.txt").write_text(first + second)
    trace = trace_of(read_file(tmp_path / "ping.txt"), "x")
    assert np.size(trace.delays) == 10 and trace.period == pytest.approx(0.2, rel=3e-3)


def test_ping_wraps_at_16_bits(tmp_path: Path) -> None:
    numbers = [*range(1, 65536), *range(500)]
    lines = [
        f"64 bytes from h: icmp_seq={n} ttl=64 time={20 + k % 7} ms" for k, n in enumerate(numbers) if k % 1000 != 7
    ]
    path = tmp_path / "ping.txt"
    path.write_text("PING h (1.2.3.4) 56(84) bytes of data.\n" + "\n".join(lines) + "\n")
    run = read_file(path)
    table = run.loops["loops"].table
    assert len(table) == len(numbers) and table["lost"].sum() == 67 and counts(run)["wraps"] == 1
    assert np.flatnonzero(table["lost"])[-1] == 66007


def test_sockperf_says_where_it_does_not_know(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(LOGS["sockperf"].text.replace("dropped messages = 1", "dropped messages = 3"))
    run = read_file(path)
    assert not run.loops["loops"].table["lost"].any()
    assert run.findings.notes == ["3 messages were lost, the log does not say which"]


def test_iperf3_over_tcp_or_with_an_error(tmp_path: Path) -> None:
    content = json.loads(LOGS["iperf3"].text)
    content["start"]["test_start"]["protocol"] = "TCP"
    (tmp_path / "tcp.json").write_text(json.dumps(content))
    assert "TCP test: throughput only" in read_file(tmp_path / "tcp.json").findings.notes[0]
    (tmp_path / "bad.json").write_text(json.dumps(content | {"error": "unable to connect"}))
    with pytest.raises(ValueError, match=r"bad.json: iperf3 ended with an error: unable to connect"):
        read_file(tmp_path / "bad.json")


def test_cleave_finds_the_edges_own_table(tmp_path: Path) -> None:
    path = write(LOGS["CLEAVE"], tmp_path)
    rows = "".join(
        f"{k},{1639276166.5 + 0.05 * k + 0.001:.6f},{1639276166.5 + 0.05 * k + 0.003:.6f}\n" for k in range(5)
    )
    (tmp_path / "service.controller.3.y.csv").write_text("seq,recv_timestamp,send_timestamp\n" + rows)
    table = read_file(path).loops["loops"].table
    np.testing.assert_allclose(table["compute"].dropna(), 0.002, atol=1e-6)


def _odometry(n: int = 401) -> tuple[np.ndarray, np.ndarray]:
    time = 1.7e9 + 0.05 * np.arange(n)
    return time, np.clip(0.2 * (0.05 * np.arange(n) - 1.0), 0.0, 3.6)


def test_poses_of_plotjuggler(tmp_path: Path) -> None:
    time, x = _odometry()
    pose = "/r1/odom/pose/pose"
    head = f"__time,{pose}/position/x,{pose}/position/y,{pose}/orientation/yaw,/battery\n"
    rows = "".join(f"{t:.6f},{v},0.0,0.5,\n{t + 0.01:.6f},,,,12.5\n" for t, v in zip(time, x, strict=True))
    (tmp_path / "odom.csv").write_text(head + rows)
    table = read_poses(tmp_path / "odom.csv", PosesFormat(topics=("/{robot}/odom",)))
    assert set(table["robot"]) == {"r1"} and len(table) == 401 and (table["heading"] == 0.5).all()
    np.testing.assert_allclose(table["x"], x)
    run = read_file(tmp_path / "odom.csv")
    assert run.quality is not None and run.quality.path_length[0] == pytest.approx(3.6, abs=1e-6)
    assert run.duration == pytest.approx(20.0, abs=1e-6)


def test_poses_of_foxglove(tmp_path: Path) -> None:
    time, x = _odometry()
    lines = ["elapsed time,receive time,header.stamp,topic,value"]
    for name, values in (("x", x), ("y", 0 * x)):
        lines += [
            f"{t - time[0]},{t:.6f},{t:.6f},/odom.pose.pose.position.{name},{v}"
            for t, v in zip(time, values, strict=True)
        ]
    (tmp_path / "plot.csv").write_text("\n".join(lines) + "\n")
    run = read_file(tmp_path / "plot.csv")
    assert run.quality is not None and run.quality.path_length[0] == pytest.approx(3.6, abs=1e-6)


def test_columns_of_poses_may_be_named(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,east,north,who\n" + "".join(f"{0.1 * k},{0.1 * k},2,a\n" for k in range(50)))
    layout = PosesFormat(time="t", x="east", y="north", robot="who")
    (files,) = find_runs(tmp_path / "log.csv", StampsFormat(), layout)
    run = read_run(files, Rules(TopicPatterns((), ()), poses=layout), quiet=True)
    assert run.quality is not None and run.quality.path_length[0] == pytest.approx(4.9, abs=1e-6)


def test_a_trace_of_ingest_reads_back(tmp_path: Path) -> None:
    run = read_file(write(LOGS["irtt"], tmp_path))
    run.loops["loops"].table.to_csv(tmp_path / "trace.csv", index=False)
    again = trace_of(read_file(tmp_path / "trace.csv"), "trace.csv")
    np.testing.assert_allclose(again.delays, np.array(LOGS["irtt"].loops) / 1e3, atol=1e-9)
    assert again.period == pytest.approx(0.2)
    named = read_trace(tmp_path / "trace.csv", "loop_time", "s", sequence="sequence")
    np.testing.assert_array_equal(named.delays, again.delays)


def test_what_is_no_single_log_says_so(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="which holds no run"):
        read_file(tmp_path)
    (tmp_path / "rtt.csv").write_text("rtt\n1\n2\n")
    with pytest.raises(ValueError, match=r"unit: got None for column 'rtt' of .*rtt.csv, expected 's'"):
        read_file(tmp_path / "rtt.csv")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert isinstance(trace_of(read_file(tmp_path / "rtt.csv", unit="ms"), "x", period=0.1), Trace)


def _long_ping(folder: Path) -> Path:
    lines = [f"[{1.7e9 + 0.1 * k + 0.02:.6f}] 64 bytes from h: icmp_seq={k + 1} ttl=64 time=20.0 ms" for k in range(60)]
    (folder / "ping.txt").write_text("PING h (1.2.3.4) 56(84) bytes of data.\n" + "\n".join(lines) + "\n")
    return folder / "ping.txt"


def test_a_network_is_what_a_log_holds(tmp_path: Path) -> None:
    options = ["network=trace", f"network.path={_long_ping(tmp_path)}", "network.compute=0"]
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        config = load(AdviseConfig, compose("advise", options))
        network = config.build_network()
        assert network.reliability(0.02).share == 1.0 and network.describe()["source"].endswith("ping.txt (ping, text)")
        with pytest.raises(ValueError, match=r"measured with a loop every 100 ms \(its send times\)"):
            advise(config)
        with pytest.raises(ValueError, match="has no column 'time'; .*without network.column it is read as ping, text"):
            load(AdviseConfig, compose("advise", [*options, "network.column=time", "network.unit=ms"])).build_network()
        with pytest.raises(ValueError, match="network.column: got nothing with sequence, expected the name"):
            load(AdviseConfig, compose("advise", [*options, "network.sequence=seq"])).build_network()
    assert _expanded(["path=a=b", "key=1"], {"path": ("network=trace", "network.path")}) == [
        "network=trace", "network.path=a=b", "key=1",
    ]  # fmt: skip


@pytest.mark.slow
def test_one_command_reads_and_advises(tmp_path: Path) -> None:
    _long_ping(tmp_path)
    options = [
        "scenario.horizon=4", "advise.points=2", "advise.rounds=[8]", "advise.finalists=2", "advise.fresh_seeds=8",
        "advise.margins.delays=0", "advise.margins.points=0", "advise.margins.seeds=8", "figures=false",
        "hydra.run.dir=out", "advise.slowest=null", "advise.max_collision_share=1",
    ]  # fmt: skip
    environment = os.environ | {"PYTHONPATH": str(ROOT), "JAX_PLATFORMS": "cpu"}
    line = [sys.executable, "-m", "qocjax.advise", "path=ping.txt", *options]
    done = subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, encoding="utf-8", timeout=300)
    assert done.returncode == 2 and "network.compute=0.02 where it always takes 20 ms" in done.stderr
    line.append("network.compute=0.02")
    done = subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, encoding="utf-8", timeout=300)
    assert done.returncode == 2 and "was measured with a loop every 100 ms (its send times)" in done.stderr
    done = subprocess.run([*line, "loop.tau=0.1"], cwd=tmp_path, env=environment, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    assert "ping  (ping, text, 5.9 s)" in done.stdout and "SET THIS" in done.stdout
