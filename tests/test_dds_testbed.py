"""The testbed with a real middleware: its emulator, its radio and its robots by mathematics, and one short run."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np
import pandas as pd
import pytest
from driving import drive
from scipy import stats

from experiments.dds_testbed.cases import HORIZON, PROFILES, Case, cases_of
from experiments.dds_testbed.compare import compare, order_of_qoc
from experiments.dds_testbed.config import read_config, written_config
from experiments.dds_testbed.gain import gains
from experiments.dds_testbed.law import law_of
from experiments.dds_testbed.link import EDGE, ROBOT, Port
from experiments.dds_testbed.messages import State
from experiments.dds_testbed.model import numbers_of
from experiments.dds_testbed.outages import returned
from experiments.dds_testbed.radio import compute_times, draw_radio
from experiments.dds_testbed.relay import Queue, Relay
from experiments.dds_testbed.rtps import submessages
from experiments.dds_testbed.scores import auc_of, ideal_scale
from qocjax import read_trace, simulate
from qocjax.network import Constant, GilbertElliott, IndependentLoss, Leg, LoopNetwork, ShiftedGamma, Trace

ROOT = Path(__file__).resolve().parents[1]
MS = 1_000_000
TAU = 0.02


def network(loss: object, delay: object = None) -> LoopNetwork:
    leg = Leg(delay or ShiftedGamma(0.002, 4.0, 0.002), loss)  # type: ignore[arg-type]
    return LoopNetwork(uplink=leg, compute=Constant(0.001), downlink=leg, name="test")


def fates(radio: object, times: np.ndarray, side: int, link: int = 0) -> np.ndarray:
    return np.array([radio.fate(link, side, int(each)) for each in times])  # type: ignore[attr-defined]


def test_queue_keeps_the_order_of_a_flow_only() -> None:
    one, other = Port(1, 0, EDGE, 0), Port(2, 1, EDGE, 0)
    for in_order, expected in ((True, [(3, b"c"), (5, b"a"), (5, b"b")]), (False, [(2, b"b"), (3, b"c"), (5, b"a")])):
        queue = Queue(in_order)
        for port, frame, due in ((one, b"a", 5), (one, b"b", 2), (other, b"c", 3)):
            queue.push(port, frame, due)
        assert queue.next_due(100) == expected[0][0]
        assert list(queue.pop(1)) == []
        assert [(due, frame) for due, _, frame in queue.pop(5)] == expected
        assert queue.next_due(100) == 100


class Fixed:
    """A radio that delays the way up, and drops every other frame on the way down."""

    def __init__(self) -> None:
        self.down = 0

    def fate(self, link: int, side: int, now: int) -> float:
        self.down += side == EDGE
        return 0.2 if side == ROBOT else float("inf") if self.down % 2 else 0.0


def test_relay_delays_drops_and_counts() -> None:
    pairs = [socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in (ROBOT, EDGE)]
    ports = []
    for side, (_, inner) in enumerate(pairs):
        inner.setblocking(False)
        ports.append(Port(inner.fileno(), 0, side, 0))
    (robot, _), (edge, _) = pairs
    relay = Relay(ports, in_order=True)
    robot.send(bytes(40))
    relay.run(time.monotonic_ns() + 2 * MS)
    edge.setblocking(False)
    assert edge.recv(100) == bytes(40)  # at once without a radio
    relay.radio = Fixed()
    robot.send(bytes(54))
    relay.run(time.monotonic_ns() + 10 * MS)
    with pytest.raises(BlockingIOError):
        edge.recv(100)
    relay.run(time.monotonic_ns() + 250 * MS)
    assert edge.recv(100) == bytes(54)
    for _ in range(4):
        edge.send(bytes(14))
    relay.run(time.monotonic_ns() + 5 * MS)
    up, down = relay.snapshot()
    assert (up["frames"], up["bytes"], up["frames_dropped"]) == (2, 26 + 40, 0)  # without the Ethernet headers
    assert (down["frames"], down["bytes"], down["frames_dropped"]) == (4, 0, 2)
    assert len(relay.lateness) == 3 and min(relay.lateness) >= 0
    for pair in pairs:
        for end in pair:
            end.close()


def test_radio_draws_the_laws_of_the_network() -> None:
    radio = draw_radio(network(IndependentLoss(0.2)), jax.random.key(0), 4000, 500, 2, TAU)
    drawn = fates(radio, np.arange(4000) * 5 * MS, EDGE, link=1)
    lost = np.isinf(drawn)
    assert stats.binomtest(int(lost.sum()), 4000, 0.2).pvalue > 1e-3
    assert stats.kstest(drawn[~lost], ShiftedGamma(0.002, 4.0, 0.002).cdf).pvalue > 1e-3


def test_bursts_go_by_time_whatever_is_sent() -> None:
    process = GilbertElliott(0.05, 0.25)
    radio = draw_radio(network(process), jax.random.key(1), 20000, 5000, 1, TAU)
    lost = np.isinf(fates(radio, np.arange(20000) * 5 * MS, ROBOT)).reshape(5000, 4)  # four frames in each period
    assert (lost == lost[:, :1]).all()
    lengths = np.diff(np.flatnonzero(np.diff(np.r_[0, lost[:, 0], 0])))[::2]
    assert abs(lengths.mean() - 4.0) < 4 * 3.5 / np.sqrt(len(lengths))  # 1 / p_bad_to_good periods
    assert abs(lost.mean() - process.probability) < 0.04


def test_radio_of_a_trace_gives_its_loop_times() -> None:
    rows = np.where(np.arange(300) % 7 == 0, np.inf, 0.01 + 1e-4 * np.arange(300))
    radio = draw_radio(Trace(rows, "rows"), jax.random.key(2), 100, 300, 1, TAU)
    times = np.arange(300) * 20 * MS
    loops = fates(radio, times, ROBOT) + fates(radio, times, EDGE)
    start = int(np.argmin(loops))  # row 1, the smallest
    np.testing.assert_allclose(loops[start:], rows[1 : 301 - start])
    assert (compute_times(Trace(rows, "rows"), jax.random.key(0), 10, 2) == 0.0).all()
    assert (compute_times(network(IndependentLoss()), jax.random.key(0), 10, 2) == 0.001).all()


def test_radio_refuses_other_networks() -> None:
    with pytest.raises(ValueError, match="network: got a Fixed, expected a LoopNetwork or a Trace"):
        draw_radio(Fixed(), jax.random.key(0), 10, 10, 1, TAU)  # type: ignore[arg-type]


def frame(*parts: tuple[int, bytes]) -> bytes:
    """An Ethernet frame with RTPS submessages of given kinds."""
    body = b"".join(struct.pack("<BBH", kind, 1, len(content)) + content for kind, content in parts)
    return bytes(14) + b"\x45" + bytes(19) + bytes(8) + b"RTPS" + bytes(16) + body


def test_submessages_of_user_data() -> None:
    user, built_in = b"\0\0\x01\x03", b"\0\x01\0\xc2"
    data, heartbeat = bytes(4) + bytes(4) + user + bytes(8), b"\0\0\x01\x04" + user + bytes(20)
    assert list(submessages(frame((0x09, bytes(8)), (0x15, data), (0x07, heartbeat)))) == ["data", "heartbeats"]
    assert list(submessages(frame((0x06, b"\0\0\x01\x04" + user + bytes(16))))) == ["acknacks"]
    assert list(submessages(frame((0x07, b"\0\x01\0\xc7" + built_in + bytes(20))))) == []
    assert list(submessages(bytes(60))) == list(submessages(b"")) == []


@pytest.mark.parametrize(("actuation", "hold"), [("arrival", "hold"), ("deadline", "hold"), ("deadline", "zero")])
def test_robots_move_as_in_the_simulator(actuation: str, hold: str) -> None:
    """Robots and law, driven by given loop times, give the trajectory and the AUC of `simulate`."""
    config = read_config(
        [f"loop.actuation={actuation}", f"loop.hold={hold}", "scenario.horizon=4.0", "deadline_ms=110"]
    )
    plan, scenario = config.build_plan(False, Path()), config.build_scenario()
    times = np.array(network(IndependentLoss(0.2), ShiftedGamma(0.02, 2.0, 0.02)).draw(
        jax.random.key(3), plan.num_ticks, 2, TAU
    ))  # fmt: skip
    driven = drive(plan, law_of(plan, config.build_controller()), times)
    run = simulate(scenario, plan.as_design(), times, actuation, hold)
    np.testing.assert_allclose(driven.poses, run.pose[:-1], atol=1e-6)
    np.testing.assert_allclose(auc_of(scenario, plan, driven.robots.record()), run.auc, rtol=1e-5)
    scale = ideal_scale(scenario, plan, config.build_controller())
    assert scale.median < float(np.mean(run.auc)) < scale.largest


@pytest.mark.slow
def test_the_stack_drives_as_in_the_simulator(tmp_path: Path) -> None:
    """Told state by state it gives the commands of `simulate`; what was not heard of leaves a gap, no error."""
    options = ["controller=navigation", "middleware=fastdds", "controller.mppi.batch_size=64", "loop.tau=0.1",
               "scenario.horizon=3.0", "deadline_ms=250"]  # fmt: skip
    config = read_config(options)
    plan, scenario, stack = config.build_plan(False, tmp_path), config.build_scenario(), config.build_controller()
    config.write(tmp_path)
    assert written_config(tmp_path) == config
    rng = np.random.default_rng(1)
    times = rng.uniform(0.02, 0.2, (plan.num_ticks, 2))
    poses = drive(plan, law_of(plan, stack, key=5), times).poses
    run = simulate(scenario, plan.as_design(), times, **plan.rules, controller=stack, key=jax.random.key(5))
    np.testing.assert_allclose(poses[:8], run.pose[:8], atol=1e-6)
    np.testing.assert_allclose(poses, run.pose[:-1], atol=0.05)  # a rollout that just collides or not is another one
    gap = law_of(plan, stack, key=5)
    for tick in (-3, 0, 7, 6, plan.num_ticks + 4):
        speeds = gap(0, State(tick, 0, poses[max(min(tick, len(poses) - 1), 0)].ravel().tolist(), [0.0, 0.0]))
        assert np.isfinite(speeds).all()


def test_configuration_is_checked() -> None:
    for option, text in (
        ("qos.depth=0", "qos.depth: got 0"),
        ("robot=holonomic", r"robot: got Holonomic\(\), expected a Unicycle that obeys commands at once"),
        ("robot.ax_max=1", "robot: got Unicycle.*, expected a Unicycle that obeys commands at once"),
        ("loop.actuation=instant", "loop.actuation: got 'instant', expected what real time allows"),
        ("middleware=other", "middleware: got 'other'"),
        ("qos.foo=1", "qos.foo"),
        ("link=wire", "link: got 'wire'"),
        ("controller=navigation", "controller: got navigation with cyclonedds, expected apf or middleware=fastdds"),
        ("dds.heartbeat_period=0.02", "dds.heartbeat_period: got 0.02 with cyclonedds, expected null"),
    ):
        with pytest.raises(ValueError, match=text):
            read_config([option]).build_plan(False, Path())


def test_says_what_is_missing(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "experiments.dds_testbed", f"folder={tmp_path}"],
        cwd=ROOT, env=os.environ | {"PATH": str(tmp_path)}, text=True, capture_output=True,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith("error: needs ") and done.stderr.count("\n") == 1


def test_comparison_of_the_model_with_itself_has_no_error() -> None:
    rng = np.random.default_rng(0)
    names = ("lost", "p50", "p95", "p99", "age_mean", "uplink_bytes", "downlink_bytes")
    cases = cases_of(["fastdds", "zenoh"])
    drawn = {case: {name: rng.uniform(1, 2, 8) for name in names} | {"auc": rng.uniform(2, 3, (8, 2)) + 5 * k}
             for k, case in enumerate(cases)}  # fmt: skip
    rows = [
        vars(case) | {"repeat": k} | {name: numbers[name][k] for name in names}
        | dict(zip(("auc_0", "auc_1"), numbers["auc"][k], strict=True))
        for case, numbers in drawn.items() for k in range(8)
    ]  # fmt: skip
    model = {case: numbers for case, numbers in drawn.items() if case.middleware == "fastdds"}
    table = compare(pd.DataFrame(rows), model)
    of_model = table[table["model"].notna()]
    assert set(of_model["middleware"]) == {"fastdds"} and set(table["middleware"]) == {"fastdds", "zenoh"}
    assert of_model["error"].abs()[of_model["number"] != "qoc"].max() < 1e-12
    assert of_model["chance"].all() and (of_model["met"] != "no").all()
    order = order_of_qoc(table)
    assert len(order) == 9 * 10 and order["agree"].all() and order["clear"].all()
    model[cases[0]] = model[cases[0]] | {"lost": model[cases[0]]["lost"] + 0.5}
    (wrong,) = compare(pd.DataFrame(rows), model).query("met == 'no'").itertuples()
    assert (wrong.profile, wrong.number) == ("best_effort", "lost") and wrong.error == pytest.approx(0.5)


def test_cases_are_options_of_the_testbed() -> None:
    cases = cases_of(PROFILES)
    assert len({case.name for case in cases}) == len(cases) == 117
    for case in (cases[0], Case("fastdds", "reliable_all", 0.3, True), Case("zenoh", "reliable_all", 0.05, False)):
        plan, again = (read_config(case.options(repeat)).build_plan(False, Path()) for repeat in (0, 1))
        assert plan == again and plan.middleware == case.middleware and plan.horizon == HORIZON
        assert plan.reliable == case.profile.startswith("reliable") and (plan.depth is None) == ("all" in case.profile)
    bursts = Case("fastdds", "reliable_10", 0.2, True).process()
    assert isinstance(bursts, GilbertElliott) and 0.02 / bursts.p_bad_to_good == pytest.approx(0.2)  # s
    assert bursts.p_good_to_bad / (bursts.p_good_to_bad + bursts.p_bad_to_good) == pytest.approx(0.2)


@pytest.mark.slow
def test_model_of_a_case() -> None:
    """Lost loops of BEST_EFFORT by the closed form 1 - (1 - p)², a little more or less for overtaking."""
    numbers, times = numbers_of(Case("cyclonedds", "best_effort", 0.1, False))
    assert times.shape == (32, 400, 2) and numbers["auc"].shape == (32, 2)
    assert abs(numbers["lost"].mean() - 0.19) < 0.01


@pytest.mark.slow
def test_short_run(tmp_path: Path) -> None:
    """Real middleware over a lossy link: what was lost, delayed and counted is what was configured."""
    if importlib.util.find_spec("cyclonedds") is None or not shutil.which("ip"):
        pytest.skip("needs Cyclone DDS and iproute2")
    if subprocess.run(["unshare", "--net", "true"], capture_output=True).returncode != 0:
        pytest.skip("needs root, or a network namespace")
    options = ["qos.reliability=best_effort", "qos.depth=1", "scenario.horizon=4.0", f"folder={tmp_path}",
               "network.uplink.loss.probability=0.2", "limits.relay_p99_ms=50", "limits.tick_p99_ms=50"]  # fmt: skip
    command = [sys.executable, "-m", "experiments.dds_testbed", *options]
    done = subprocess.run(command, cwd=ROOT, text=True, capture_output=True, timeout=120)
    assert done.returncode == 0, done.stderr
    record = json.loads((tmp_path / "record.json").read_text(encoding="utf-8"))
    trace = read_trace(tmp_path / "loops_1.csv", "loop_time", "s", sequence="sequence", period=TAU)
    loops = pd.concat([pd.read_csv(tmp_path / f"loops_{robot}.csv") for robot in (0, 1)])
    assert len(np.asarray(trace.delays)) == 200 and len(loops) == 400
    assert stats.binomtest(int(loops["lost"].sum()), 400, 0.2).pvalue > 1e-3
    came = loops[~loops["lost"]]
    assert (came[["uplink", "compute", "downlink"]] >= 0.0).all().all()
    assert 0.015 < came["loop_time"].median() < 0.03
    np.testing.assert_allclose(record["auc"], record["auc_replayed"], rtol=0.03)
    assert record["link"]["uplink"]["data"] == pytest.approx(100.0, abs=1.0)
    assert record["link"]["uplink"]["bytes"] == pytest.approx(184.0 * 100.0, rel=0.02)  # as the model counts a sample
    poses = pd.read_csv(tmp_path / "poses.csv")
    assert set(poses.columns) == {"time", "robot", "x", "y", "heading", "nu", "omega"}
    assert poses["time"].iloc[-1] == 4.0


@pytest.mark.slow
def test_gain_of_repairs_by_hand(tmp_path: Path) -> None:
    """The same loops gain nothing; loops that complete gain where a missed one stops the robot, and more than held."""
    ticks = round(HORIZON / TAU)
    for profile, lost in (("best_effort", 0.6), ("reliable_1", 0.6), ("reliable_10", 0.0)):
        for repeat in (0, 1):
            folder = tmp_path / Case("cyclonedds", profile, 0.3, False).name / str(repeat)
            folder.mkdir(parents=True)
            rng = np.random.default_rng(repeat)
            for robot in (0, 1):
                times = np.where(rng.uniform(size=ticks) < lost, np.inf, 0.02)
                pd.DataFrame({"loop_time": times}).to_csv(folder / f"loops_{robot}.csv", index=False)
    table = pd.DataFrame(gains(tmp_path)).set_index(["profile", "actuation", "hold"])
    assert set(table["loss"]) == {0.3}
    assert table.loc[("reliable_1", "arrival", "hold"), "gain"] == pytest.approx(0.0, abs=1e-12)
    held, stopped = (table.loc[("reliable_10", "deadline", hold), "gain"] for hold in ("hold", "zero"))
    assert stopped > 0.1 > held


def test_what_comes_back_after_an_outage() -> None:
    """An outage from 2 to 4 s at 10 Hz: three old states come late, the first answer at 4.5 s, a slow loop at 5 s."""
    sent = np.arange(80) * 0.1
    at_edge = np.where((sent >= 2.0) & (sent < 4.4), np.nan, sent + 0.01)
    at_edge[[37, 38, 39]] = 4.2
    back = np.where((sent >= 2.0) & (sent < 4.45), np.nan, sent + 0.02)
    back[50] = sent[50] + 1.5
    loops = pd.DataFrame({"uplink_send": sent, "edge_receive": at_edge, "downlink_receive": back,
                          "loop_time": np.nan_to_num(back - sent, nan=np.inf)})  # fmt: skip
    found = returned(loops, 4.0)
    assert found == pytest.approx({"state": 0.2, "command": 0.52, "steady": 1.0, "late_states": 3, "oldest": 0.5})
    never = returned(loops.assign(edge_receive=np.nan, downlink_receive=np.nan, loop_time=np.inf), 4.0)
    assert never["state"] == never["command"] == never["steady"] == np.inf
