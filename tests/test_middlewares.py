"""The middlewares of the testbed: messages that come back as they went, proof that they crossed, bags; short runs."""

from __future__ import annotations

import importlib.util
import json
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pandas as pd
import pytest
from driving import drive

from experiments import paper_experiment
from experiments.dds_testbed.bag import record
from experiments.dds_testbed.config import read_config
from experiments.dds_testbed.crossing import Crossed, ReceivedBy, past_the_radio
from experiments.dds_testbed.law import law_of
from experiments.dds_testbed.link import EDGE, ROBOT, tap_usable
from experiments.dds_testbed.messages import Command, State
from experiments.dds_testbed.middlewares import MIDDLEWARES, require
from experiments.dds_testbed.middlewares.arrivals import Arrivals
from experiments.dds_testbed.middlewares.fastdds_profile import profile
from experiments.dds_testbed.middlewares.packed import mark, pack, unpack
from experiments.dds_testbed.scores import auc_of, messages
from qocjax import paper_network

ROOT = Path(__file__).resolve().parents[1]
STATE = State(-3, 5_000_000_007, [1.0, 2.0, 3.0, -1.0, 0.5, 0.1], [0.02, 0.3])
DEADLINE = 0.25  # s
COMMAND = Command(7, 0.4, -1.1)


def test_packed_messages_come_back_and_bear_their_mark() -> None:
    for message in (STATE, COMMAND):
        assert unpack(pack(message), isinstance(message, State)) == message
        assert pack(message).count(mark(message)) == 1
    assert mark(COMMAND) != mark(COMMAND._replace(sequence=8))


def test_arrivals_are_given_in_order_and_waited_for() -> None:
    arrivals = Arrivals()
    assert arrivals.take(0) == []
    arrivals.put(1, "a")
    arrivals.put(0, "b")
    found = arrivals.take(10**9)
    assert [(each.robot, each.content) for each in found] == [(1, "a"), (0, "b")]
    assert found[0].stamp <= found[1].stamp


def packet(payload: bytes, protocol: int = 17, number: int = 0) -> bytes:
    """An Ethernet frame of a datagram, or of a segment of a stream."""
    header = bytes(8) if protocol == 17 else bytes(4) + struct.pack(">I", number) + bytes(4) + b"\x50" + bytes(7)
    length = struct.pack(">H", 20 + len(header) + len(payload))
    return bytes(14) + b"\x45\0" + length + bytes(5) + bytes([protocol]) + bytes(10) + header + payload + bytes(3)


def got(*each: tuple[int, int, bytes]) -> ReceivedBy:
    """Robot, time and mark of each message."""
    rows = np.array([(robot, k, time) for k, (robot, time, _) in enumerate(each)], np.int64).reshape(-1, 3)
    return ReceivedBy(rows, np.zeros((len(each), 2)), np.array([what for *_, what in each], "V4"))


def test_what_came_past_the_radio_is_found() -> None:
    nothing = got()
    frames = [
        Crossed(10, 0, ROBOT, packet(b"..one1..")),
        Crossed(20, 1, ROBOT, packet(b"two2")),
        Crossed(5, 0, EDGE, b""),
    ]
    assert past_the_radio(frames, [got((0, 10, b"one1"), (1, 25, b"two2")), nothing]) == []
    for other in ((0, 9, b"one1"), (1, 30, b"one1"), (0, 30, b"six6")):  # too early, another link, never
        (said,) = past_the_radio(frames, [got((0, 30, b"one1"), other), nothing])
        assert said == "1 of 2 commands came past the emulated radio, expected each in a frame"
    (said,) = past_the_radio(frames, [nothing, got((0, 30, b"one1"))])  # it went the other way
    assert said.startswith("1 of 1 states")


def test_a_stream_is_put_together() -> None:
    """Segments that come twice, late or in pieces, across the end of the sequence numbers."""
    first = 2**32 - 3
    parts = [(10, first, b"abcd"), (20, 5, b"ijkl"), (30, 1, b"efgh"), (40, first, b"abcdefgh")]
    frames = [Crossed(time, 0, ROBOT, packet(what, 6, number)) for time, number, what in parts]
    for what, time in ((b"abcd", 10), (b"cdef", 30), (b"ghij", 30), (b"ijkl", 20)):
        assert past_the_radio(frames, [got((0, time, what)), got()]) == []
        assert past_the_radio(frames, [got((0, time - 1, what)), got()]) != []


def test_fragments_are_put_together() -> None:
    """A datagram in pieces of 16 bytes, the second of which comes last; another one has its offsets."""
    parts = [(10, 1, 0x2000, b"abcd"), (15, 2, 0x2000, b"AAAA"), (20, 1, 4, b"ijkl"), (30, 1, 0x2002, b"efgh")]
    frames = []
    for time, name, place, what in parts:
        content = what.rjust(16, b".") if place == 0x2000 else what.ljust(16, b".")
        header = b"\x45\0" + struct.pack(">HHH", 36, name, place) + b"\0\x11" + bytes(10)
        frames.append(Crossed(time, 0, ROBOT, bytes(14) + header + content))
    assert past_the_radio(frames, [got((0, 30, b"cdef")), got()]) == []
    assert past_the_radio(frames, [got((0, 29, b"cdef")), got()]) != []
    assert past_the_radio(frames, [got((0, 50, b"AAef")), got()]) != []
    again = [*frames, Crossed(40, 0, ROBOT, packet(b"cdef"))]  # sent again, not in pieces
    assert past_the_radio(again, [got((0, 30, b"cdef")), got()]) == []


def test_fast_dds_is_kept_on_the_radio() -> None:
    from xml.etree import ElementTree

    space = "{http://www.eprosima.com}"
    root = ElementTree.fromstring(profile("10.77.0.2", lease=2.5, heartbeat_period=0.02).encode())
    times = [(each.tag.removeprefix(space), [part.text for part in each]) for each in root.iter() if len(each) == 2]
    assert ("leaseDuration", ["2", "500000000"]) in times
    assert ("heartbeat_period", ["0", "20000000"]) in times
    assert [each.text for each in root.iter(f"{space}type")] == ["UDPv4"]
    assert [each.text for each in root.iter(f"{space}useBuiltinTransports")] == ["false"]
    assert [each.text for each in root.iter(f"{space}kind")] == ["OFF", "OFF"]
    assert [each.text for each in root.iter(f"{space}address")] == ["10.77.0.2"]
    own = profile("10.77.0.2", lease=None, heartbeat_period=None)
    assert "leaseDuration" not in own
    assert "heartbeat_period" not in own


@pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")  # of a parser that ROS brings
def test_ros_messages_hold_what_the_loop_needs() -> None:
    """Poses, ages and marks come back from the bytes that ROS sends; what goes along has the stamp, not the mark."""
    pytest.importorskip("rclpy", reason="no ROS 2 here (pip install 'qocjax[ros2]')")
    from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
    from nav_msgs.msg import Path as RosPath
    from rclpy.serialization import deserialize_message, serialize_message

    from experiments.dds_testbed.middlewares import ros_messages
    from qocjax.ros.node import from_stamp, to_stamp

    path, pose, twist = RosPath(), PoseWithCovarianceStamped(), TwistStamped()
    for each in (path, pose, twist):
        each.header.stamp, each.header.frame_id = to_stamp(STATE.uplink_send), ros_messages.FRAME
    ros_messages.fill_path(path, STATE.uplink_send, STATE.poses, STATE.ages)
    ros_messages.fill_pose(pose.pose.pose, STATE.poses[:3])
    ros_messages.fill_twist(twist.twist, COMMAND[1:])
    sent = serialize_message(path)
    came = deserialize_message(sent, RosPath)
    assert sum((ros_messages.placed(each.pose) for each in came.poses), ()) == pytest.approx(STATE.poses)
    ages = [1e-9 * (STATE.uplink_send - from_stamp(each.header.stamp)) for each in came.poses]
    assert ages == pytest.approx(STATE.ages)
    assert sent.count(ros_messages.mark_of(came)) == 1
    assert ros_messages.mark_of(came) not in serialize_message(pose)
    sent = serialize_message(twist)
    assert sent.count(ros_messages.mark_of(deserialize_message(sent, TwistStamped))) == 1


def test_options_of_a_middleware_are_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = read_config(["middleware=zenoh", "zenoh.congestion=block", "qos.depth=null"]).build_plan(False, Path())
    assert plan.options == {"protocol": "tcp", "congestion": "block", "express": False} and plan.depth is None
    assert read_config(["qos.lifespan_ms=100"]).build_plan(False, Path()).lifespan == 0.1
    with pytest.raises(ValueError, match="qos.lifespan_ms: got 100, expected null: Zenoh has no lifespan"):
        read_config(["middleware=zenoh", "qos.lifespan_ms=100"]).build_plan(False, Path())
    with pytest.raises(ValueError, match="zenoh.protocol: got 'quic'"):
        read_config(["zenoh.protocol=quic"])
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    for name in MIDDLEWARES:
        with pytest.raises(OSError, match=f"middleware={name} needs .*, found none: pip install"):
            require(name)


@pytest.fixture
def driven(tmp_path: Path) -> tuple[object, object, int]:
    return recorded(tmp_path, ["scenario.horizon=4.0", f"deadline_ms={DEADLINE * 1e3:g}"])


def recorded(folder: Path, options: list[str]) -> tuple[object, object, int]:
    """A run without a middleware: plan, what the robots received, start. Loops take their time and are lost."""
    config = read_config([*options, "loop.actuation=deadline"])
    plan, start = config.build_plan(False, folder), 77_000_000_000
    times = np.array(paper_network().draw(jax.random.key(3), plan.num_ticks, 2, plan.design["tau"]))
    times[50:60] = np.inf
    run = drive(plan, law_of(plan, config.build_controller()), times)
    stamps, first = np.zeros((2, plan.num_ticks + sum(plan.padding), 2), np.int64), plan.padding[0]
    instants = start + np.arange(plan.num_ticks)[:, None] * plan.tau
    stamps[0, first : first + plan.num_ticks] = instants + 1000
    np.savez(folder / "robot.npz", stamps=stamps, **run.robots.record())
    rows = np.array([(robot, k, start + time) for time, robot, k, _ in run.received])
    speeds = np.array([speeds for *_, speeds in run.received])
    return plan, ReceivedBy(rows, speeds, np.zeros(len(rows), "V1")), start


def test_messages_are_counted_by_their_numbers(driven: tuple, tmp_path: Path) -> None:
    plan, received, _ = driven
    edge = [(robot, k, 1, 1 if k % 10 else 0) for robot in (0, 1) for k in range(plan.num_ticks)]
    np.save(tmp_path / "edge.npy", np.array(edge))
    rows = np.array([(0, 0, 1), (0, 2, 2), (0, 1, 3), (0, 2, 4), (1, -1, 5), (1, plan.num_ticks, 6)])
    up = ReceivedBy(rows, np.zeros((6, 2)), np.zeros(6, "V1"))
    found = messages(plan, [received, up])
    assert found["uplink"] == {"sent": 400, "received": 3, "lost": 397, "repeated": 1, "reordered": 1}
    assert found["downlink"]["sent"] == 360
    assert found["downlink"]["received"] == len({tuple(each[:2]) for each in received.rows.tolist()})


def test_bag_of_a_run_is_read_to_the_same_auc_and_loops(driven: tuple, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from hydra import compose, initialize_config_dir

    from qocjax.commands import ingest
    from qocjax.config import conf_dir, load
    from qocjax.config.ingest import IngestConfig

    plan, received, start = driven
    bag = record(tmp_path / "bag", plan, received, start)
    scenario = read_config(["scenario.horizon=4.0"]).build_scenario()
    expected = auc_of(scenario, plan, np.load(tmp_path / "robot.npz"))
    for topic, actual in (("cmd_vel_nav", True), ("cmd_vel", False)):
        with initialize_config_dir(str(conf_dir().resolve()), version_base="1.3"):
            options = [f"path={bag}", "figures=false", f"topics.commands=['/{{robot}}/{topic}']"]
            config = load(IngestConfig, compose("ingest", options))
        (found,) = ingest.run(config, quiet=True).runs
        np.testing.assert_allclose(found.quality.auc, expected, rtol=3e-3)
        for robot in range(2):
            table = found.loops[f"robot{robot}"].table
            times = np.sort(table["loop_time"][~table["lost"]].to_numpy())
            ours = received.rows[received.rows[:, 0] == robot]
            took = np.sort([(stamp - start - k * plan.tau) * 1e-9 for _, k, stamp in ours.tolist()])
            through = [k * plan.tau * 1e-9 + DEADLINE <= plan.horizon for _, k, stamp in ours.tolist()
                       if (stamp - start - k * plan.tau) * 1e-9 <= DEADLINE]  # fmt: skip
            held = np.full(sum(through), DEADLINE)
            np.testing.assert_allclose(times, took if actual else held, atol=1e-6)


def needs_namespaces(middleware: str) -> None:
    try:
        require(middleware)
    except OSError as error:
        pytest.skip(str(error))
    if not shutil.which("ip") or subprocess.run(["unshare", "--net", "true"], capture_output=True).returncode != 0:
        pytest.skip("needs iproute2 and a network namespace: root, or user namespaces")
    if middleware == "fastdds" and not tap_usable():
        pytest.skip("needs TAP devices: /dev/net/tun")


@pytest.mark.slow
@pytest.mark.parametrize("middleware", MIDDLEWARES)
def test_short_run(middleware: str, tmp_path: Path) -> None:
    """RELIABLE over a link that loses: every message crosses, few loops are lost, the simulator agrees."""
    needs_namespaces(middleware)
    options = [f"middleware={middleware}", "scenario.horizon=4.0", f"folder={tmp_path}", "deadline_ms=1000",
               "network.uplink.loss.probability=0.05", "limits.relay_p99_ms=50", "limits.tick_p99_ms=50"]  # fmt: skip
    command = [sys.executable, "-m", "experiments.dds_testbed", *options]
    done = subprocess.run(command, cwd=ROOT, text=True, capture_output=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr  # nothing came past the radio
    found = json.loads((tmp_path / "record.json").read_text(encoding="utf-8"))
    loops = pd.concat([pd.read_csv(tmp_path / f"loops_{robot}.csv") for robot in (0, 1)])
    assert found["middleware"] == middleware and found["messages"]["uplink"]["sent"] == 400
    assert loops["lost"].mean() < 0.05 and found["messages"]["uplink"]["repeated"] == 0
    assert found["link"]["uplink"]["frames_dropped"] > 0
    np.testing.assert_allclose(found["auc"], found["auc_replayed"], rtol=0.03)


def test_paper_experiment_takes_the_runs_that_count(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for delay, run, rejected in ((0, 0, []), (100, 0, ["late"]), (100, 1, [])):
        place = tmp_path / "runs" / f"delay_{delay}" / str(run)
        (place / "bag").mkdir(parents=True)
        (place / "record.json").write_text(json.dumps({"rejected": rejected}), encoding="utf-8")
    for _ in range(2):  # again, when there are bags already
        bags = paper_experiment.bags_of(tmp_path, [0, 100, 200], 2)
        assert sorted(each.name for each in bags.iterdir()) == ["delay_0_run_0", "delay_100_run_1"]
        assert all((each / "..").resolve().parent.name.startswith("delay_") for each in bags.iterdir())
    with pytest.raises(ValueError, match="got no run that counts"):
        paper_experiment.bags_of(tmp_path, [200], 2)
    for arguments, text in (
        (["--delays", "0", "100"], "got 2 delays and 1 runs, expected 3 delays"),
        (["--delays", "0", "100", "-5"], "deadline_ms: got -5"),
        (["qos.depth=0"], "qos.depth: got 0"),
    ):
        assert paper_experiment.main(["--folder", str(tmp_path / "none"), *arguments]) == 2
        assert text in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


@pytest.mark.slow
def test_paper_experiment_with_robots_that_are_the_simulator_s(tmp_path: Path) -> None:
    """Bags of runs without a middleware: the path from bags to the rank correlation, where E is S with other loops."""
    pytest.importorskip("rosbags")
    delays, options = (100, 200, 300, 400, 600), ["scenario.horizon=4.0"]
    for delay in delays:
        place = tmp_path / "runs" / f"delay_{delay}" / "0"
        place.mkdir(parents=True)
        plan, received, start = recorded(place, [*options, "loop.tau=0.05", f"deadline_ms={delay}"])
        record(place / "bag", plan, received, start)
        (place / "record.json").write_text(json.dumps({"rejected": []}), encoding="utf-8")
        rows = received.rows[received.rows[:, 0] == 0]
        times = np.full(plan.num_ticks, np.inf)
        times[rows[:, 1]] = (rows[:, 2] - start) * 1e-9 - rows[:, 1] * 0.05
        loops = pd.DataFrame({"sequence": np.arange(plan.num_ticks), "loop_time": times})
        loops.to_csv(place / "loops_0.csv", index=False)
    found = paper_experiment.validation(tmp_path, delays, 1, options)
    assert found.validation.curve["delay"].tolist() == pytest.approx([each * 1e-3 for each in delays])
    assert found.validation.agreement.spearman.value >= 0.6
