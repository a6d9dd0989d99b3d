"""The nodes on real ROS 2: tick by tick under a simulated clock, a closed loop over loopback, parameters, ends."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here (pip install 'qocjax[ros2]')")

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from test_ros_gate import CODES, EPOCH, MS, RULES, TAU, TAU_MS, TICKS, replayed

from qocjax.network.schedule import Rules
from qocjax.recorded.findings import Findings
from qocjax.recorded.stamps import StampsFormat, read_stamps
from qocjax.ros import deadline
from qocjax.ros.deadline import DeadlineNode
from qocjax.ros.node import to_stamp
from qocjax.ros.parameters import DEADLINE, STAMPS
from qocjax.ros.stamps import StampNode

pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")  # of a parser that ROS brings

HERE = Path(__file__).parent
PATIENCE = 90.0  # s; nothing here takes as long


@pytest.fixture(scope="module")
def ros() -> Iterator[None]:
    """A domain of its own on this machine alone, for this process and those that it starts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        rclpy.init(args=[])
        yield
        rclpy.shutdown()


@pytest.fixture
def executor(ros: None) -> Iterator[SingleThreadedExecutor]:
    made = SingleThreadedExecutor()
    yield made
    for node in made.get_nodes():
        node.destroy_node()
    made.shutdown()


def until(executor: SingleThreadedExecutor, true: Callable[[], Any]) -> bool:
    """Lets the nodes work until something is so; False where it never is."""
    end = time.monotonic() + PATIENCE
    while not (found := bool(true())) and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.01)
    return found


def overrides(**values: Any) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in values.items()]


def command(stamp: int, nu: float, omega: float) -> TwistStamped:
    message = TwistStamped()
    message.header.stamp = to_stamp(stamp)
    message.twist.linear.x, message.twist.angular.z = nu, omega
    return message


class Bench:
    """A deadline node under a simulated clock, and a robot that hears it, in one executor."""

    def __init__(self, executor: SingleThreadedExecutor, **given: Any) -> None:
        self.executor = executor
        values = overrides(use_sim_time=True, stamped_out=False, **given)
        self.node = rclpy.create_node("deadline", namespace="bench", parameter_overrides=values)
        self.served = DeadlineNode(self.node)
        robot = rclpy.create_node("robot", namespace="bench")
        self.received: list[tuple[float, float]] = [(0.0, 0.0)]
        robot.create_subscription(Twist, "cmd_vel_out", self._hear, 10)
        self._clock = robot.create_publisher(Clock, "/clock", 10)
        self._out = robot.create_publisher(TwistStamped, "cmd_vel_in", 10)
        for each in (self.node, robot):
            executor.add_node(each)
        assert until(executor, lambda: self._clock.get_subscription_count() and self._out.get_subscription_count())
        assert until(executor, lambda: robot.count_publishers("cmd_vel_out"))

    def _hear(self, message: Twist) -> None:
        self.received.append((message.linear.x, message.angular.z))

    def at(self, moment: int) -> None:
        self._clock.publish(Clock(clock=to_stamp(moment)))
        assert until(self.executor, lambda: self.node.get_clock().now().nanoseconds == moment)

    def send(self, stamp: int, nu: float, omega: float) -> None:
        before = self.served._sequence
        self._out.publish(command(stamp, nu, omega))
        assert until(self.executor, lambda: self.served._sequence > before)

    def hears(self, wanted: Any) -> bool:
        return until(self.executor, lambda: np.allclose(self.received[-1], wanted, rtol=1e-9))


@pytest.mark.parametrize("rules", [RULES[0], RULES[1], RULES[2], RULES[4], RULES[5], RULES[6]], ids=str)
def test_the_node_commands_as_the_model_tick_by_tick(executor: SingleThreadedExecutor, rules: Rules) -> None:
    """The gate alone is tested against the simulator, and here the node against the gate."""
    times = np.random.default_rng(5).choice([15.0, 40.0, 60.0, 75.0, np.inf], TICKS // 2)
    times[12:17] = np.inf
    wanted, _, gate = replayed(np.concatenate([times, np.full(TICKS // 2, np.inf)]), 60.0, rules, CODES)
    told = {name: value for name, value in asdict(rules).items() if name != "plan_length"}  # of which it knows nothing
    bench = Bench(executor, deadline=0.06, period=TAU, **told)
    events = [(round(t * MS) + p * TAU_MS * MS, 1, p) for p, t in enumerate(times) if np.isfinite(t)]
    events += [(p * TAU_MS * MS, 2, p) for p in range(TICKS // 2)]
    for moment, kind, p in sorted(events):
        bench.at(EPOCH + moment)
        if kind == 1:
            bench.send(EPOCH + p * TAU_MS * MS, *CODES[p])
        else:
            assert bench.hears(wanted[p]), (p, bench.received[-1])
    assert bench.served.gate.counts.completed == gate.counts.completed
    assert len(bench.received) <= 1 + TICKS // 2


def test_delays_are_put_on_and_a_simulator_that_begins_again_stops_the_robot(executor: SingleThreadedExecutor) -> None:
    options = "network=loop delay@network.compute=constant network.compute.value=0.05"
    bench = Bench(executor, deadline=0.1, period=TAU, actuation="arrival", network=options)
    bench.at(EPOCH)
    bench.send(EPOCH, 1.0, 2.0)
    bench.at(EPOCH + 49 * MS)
    bench.send(EPOCH + 20 * MS, 3.0, 4.0)
    assert bench.served.gate.in_force is None and len(bench.received) == 1
    bench.at(EPOCH + 60 * MS)  # the next sampling instant
    assert bench.hears((1.0, 2.0))
    bench.at(EPOCH + 80 * MS)
    assert bench.hears((3.0, 4.0))
    bench.at(EPOCH - 100_000 * MS)
    bench.send(EPOCH - 100_000 * MS, 5.0, 6.0)
    assert bench.hears((0.0, 0.0)) and bench.served.gate.counts.restarts == 1


def start(module: str, *arguments: str) -> subprocess.Popen:
    order = [sys.executable, *([module] if module.endswith(".py") else ["-m", module]), *arguments]
    return subprocess.Popen(order, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=HERE.parent)


def ended(process: subprocess.Popen, number: int) -> tuple[int, str]:
    process.send_signal(number)
    _, errors = process.communicate(timeout=PATIENCE)
    return process.returncode, errors


def test_a_loop_over_loopback_drives_a_robot_to_its_goal(executor: SingleThreadedExecutor, tmp_path: Path) -> None:
    """Robot here; controller, stamp carrier and deadline node a process each; then SIGINT stops the robot."""
    own = ["--ros-args", "-r", "__ns:=/robot0"]
    (tmp_path / "deadline.yaml").write_text("/robot0/deadline:\n  ros__parameters: {deadline: 0.15, period: 0.05}\n")
    processes = [
        start(str(HERE / "ros_edge.py"), *own),
        start("qocjax.ros.stamps", *own, "-p", "stamped_in:=false", "-p", f"record:={tmp_path}/edge.csv",
              "-r", "pose:=odom", "-r", "cmd_vel_in:=cmd_vel_plain", "-r", "cmd_vel_out:=cmd_vel_nav"),
        start("qocjax.ros.deadline", *own, "-r", "cmd_vel_in:=cmd_vel_nav", "-r", "cmd_vel_out:=cmd_vel",
              "--params-file", f"{tmp_path}/deadline.yaml", "-p", f"record:={tmp_path}/robot.csv"),
    ]  # fmt: skip
    robot = rclpy.create_node("robot", namespace="robot0")
    executor.add_node(robot)
    received: list[tuple[int, TwistStamped]] = []
    told: list[DiagnosticArray] = []
    now = lambda: robot.get_clock().now().nanoseconds  # noqa: E731
    robot.create_subscription(TwistStamped, "cmd_vel", lambda m: received.append((now(), m)), 10)
    robot.create_subscription(DiagnosticArray, "/diagnostics", told.append, 10)
    out = robot.create_publisher(Odometry, "odom", 1)
    pose, last, stamps = np.array([0.0, 0.0, 0.0]), now(), set()

    def step() -> bool:
        """Moves on, and sends where it is."""
        nonlocal last
        time_, move = now(), received[-1][1].twist if received else Twist()
        h, last = 1e-9 * (time_ - last), time_
        middle = pose[2] + 0.5 * h * move.angular.z
        pose[:] += h * np.array([move.linear.x * math.cos(middle), move.linear.x * math.sin(middle), move.angular.z])
        message = Odometry()
        message.header.stamp = to_stamp(time_)
        message.pose.pose.position.x, message.pose.pose.position.y = pose[:2].tolist()
        message.pose.pose.orientation.z, message.pose.pose.orientation.w = math.sin(pose[2] / 2), math.cos(pose[2] / 2)
        out.publish(message)
        stamps.add(time_)
        return math.hypot(pose[0] - 1.0, pose[1] - 0.5) < 0.25

    robot.create_timer(0.05, step)
    try:
        assert until(executor, lambda: math.hypot(pose[0] - 1.0, pose[1] - 0.5) < 0.25), [
            each.communicate(timeout=5) for each in processes if each.poll() is not None
        ]
        assert until(executor, lambda: len({s.name for array in told for s in array.status}) == 2)
        (deadline_end, words) = ended(processes[2], signal.SIGINT)
        assert (deadline_end, words) == (0, "")
        assert until(executor, lambda: received[-1][1].twist == Twist())  # the last word is a stop
        assert ended(processes[1], signal.SIGTERM)[0] == 0
    finally:
        for each in processes:
            each.kill()
            each.communicate()
    for moment, message in received[:-1]:
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        assert stamp in stamps and moment - stamp >= 150 * MS
    names = {status.name for array in told for status in array.status}
    assert names == {"/robot0/deadline: loops", "/robot0/stamps: pairs"}
    values = {each.key: each.value for array in told for s in array.status if "loops" in s.name for each in s.values}
    assert int(values["completed"]) > 5 < len(received)
    _records_join(tmp_path)


def _records_join(folder: Path) -> None:
    """The robot's record and the edge's give the four stamps of a loop, by the number that the writer gave it."""
    edge, robot = (pd.read_csv(folder / f"{name}.csv").set_index("sequence") for name in ("edge", "robot"))
    layout = StampsFormat(edge_columns=("sequence", "edge_receive", "edge_send"), edge_files="edge.csv", unit="ns")
    (found,) = read_stamps(folder / "robot.csv", layout, folder / "edge.csv", Findings())
    assert (edge["source_stamp"].reindex(robot.index) == robot["uplink_send"]).all()
    four = [getattr(found, each) for each in ("uplink_send", "edge_receive", "edge_send", "downlink_receive")]
    assert len(robot) == len(four[0]) > 5 and np.isfinite(four).all()
    assert (np.diff(four, axis=0) >= 0).all()


BAD = [
    (["-p", "deadlin:=0.3"], "deadlin: got an unknown parameter, expected one of actuation, ahead, deadline"),
    (["-p", "deadline:=1"], "deadline: got 1, expected a value of type double, 1.0"),
    (["-p", "deadline:=-1.0"], "deadline: got -1.0, expected 0 to 60"),
    (["-p", "hold:=none"], "hold: got 'none', expected one of hold, zero, timeout, decay"),
    (["-p", "hold:=zero"], "period: got 0 with hold 'zero'"),
    (["-p", "network:=network=paper"], "period: got 0 with a network"),
    (["--params-file", "none.yaml"], "Failed to parse ROS arguments: Couldn't parse params file"),
    (["--such"], "got unknown ROS arguments ['--such']"),
]


@pytest.mark.parametrize(("arguments", "words"), BAD, ids=[" ".join(each[0]) for each in BAD])
def test_bad_parameters_are_one_line(
    ros: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, arguments: list[str], words: str
) -> None:
    """As of the command line, but here, so that Python need not begin anew each time."""
    monkeypatch.setattr(sys, "argv", ["deadline", "--ros-args", *arguments])
    rclpy.shutdown()
    handlers = [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)]
    try:
        assert deadline.main() == 2
    finally:
        for each, handler in zip((signal.SIGINT, signal.SIGTERM), handlers, strict=True):
            signal.signal(each, handler)
        rclpy.init(args=[])
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith(f"error: {words}")


def test_parameters_have_descriptions_types_and_ranges(executor: SingleThreadedExecutor) -> None:
    for table, make in ((DEADLINE, DeadlineNode), (STAMPS, StampNode)):
        node = rclpy.create_node("described")
        make(node)
        for each in table:
            told = node.describe_parameter(each.name)
            assert told.description == each.meaning and told.read_only
            assert node.get_parameter(each.name).type_.name.lower() == each.type
            ranges = [*told.floating_point_range, *told.integer_range]
            assert [(one.from_value, one.to_value) for one in ranges] == [(each.least, each.most)] * len(ranges)
        node.destroy_node()


def test_qos_goes_by_overrides_of_the_topic_s_own_name(executor: SingleThreadedExecutor) -> None:
    name = "qos_overrides./there/nav.subscription."
    given = overrides(**{f"{name}depth": 3, f"{name}reliability": "best_effort"})
    remap = ["--ros-args", "-r", "cmd_vel_in:=/there/nav"]
    node = rclpy.create_node("deadline", parameter_overrides=given, cli_args=remap, use_global_arguments=False)
    served = DeadlineNode(node)
    (found,) = node.get_subscriptions_info_by_topic("/there/nav")
    assert found.qos_profile.reliability.name == "BEST_EFFORT"
    assert served._in.qos_profile.depth == 3
    (sent,) = node.get_publishers_info_by_topic("/cmd_vel_out")
    assert sent.qos_profile.reliability.name == "RELIABLE" and served._out.qos_profile.depth == 1
    node.destroy_node()
