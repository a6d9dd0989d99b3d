"""Bags written with rosbags: known trajectories give the simulator's AUC, each kind of dirt its count."""

from __future__ import annotations

import shutil
import tracemalloc
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from bags import AMCL, EPOCH, MOCAP, ODOM, STAMPED, STORE, TWIST, Message, pose, speeds, stamped, write_bag

import qocjax
from qocjax.recorded import Rules, RunFiles, TopicPatterns, Yardstick, read_run
from qocjax.recorded.bags import storage_files
from qocjax.recorded.run import RecordedRun

TOPICS = TopicPatterns(
    ("/{robot}/amcl_pose", "/{robot}/pose", "/{robot}/odom", "/odom"), ("/{robot}/cmd_vel", "/cmd_vel")
)
GOAL = Yardstick(goal=(2.0, 0.0))
RATE = 0.02  # s


@pytest.fixture(scope="module")
def simulated() -> Any:
    """A run of two robots with a late network."""
    scenario = qocjax.Scenario(horizon=12.0)
    times = np.asarray(qocjax.paper_network().draw(jax.random.key(3), 1200, 2, 0.01))
    return qocjax.simulate(scenario, qocjax.Design(deadline=0.2), times)


def poses(run: Any, kind: str = AMCL, topic: str = "/robot{}/amcl_pose", every: int = 2) -> list[Message]:
    """Poses of a simulated run, each recorded 4 to 9 ms after its stamp."""
    late = 0.004 + 0.005 * np.random.default_rng(1).random(len(run.time))
    return sorted(
        (
            (float(time + late[k]), topic.format(robot), kind, pose(kind, float(time), *map(float, run.pose[k, robot])))
            for k, time in list(enumerate(np.asarray(run.time)))[::every]
            for robot in range(run.pose.shape[1])
        ),
        key=lambda message: message[0],
    )


def line(count: int = 200, kind: str = AMCL, topic: str = "/a/amcl_pose") -> list[Message]:
    """One robot on its way along x at 0.5 m/s, heard of every 20 ms without delay."""
    return [(RATE * k, topic, kind, pose(kind, RATE * k, 0.5 * RATE * k, 1.0, 0.1)) for k in range(count)]


def drive(count: int = 200, topic: str = "/a/cmd_vel") -> list[Message]:
    """Its commands."""
    return [(RATE * k, topic, TWIST, speeds(0.5, 0.1)) for k in range(count)]


def read(path: Path, yardstick: Yardstick = GOAL, topics: TopicPatterns = TOPICS, **rules: Any) -> RecordedRun:
    return read_run(RunFiles("run", bag=path), Rules(topics, yardstick=yardstick, **rules), quiet=True)


def found(run: RecordedRun) -> dict[str, int]:
    return {each.cause: each.count for each in run.findings}


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize(("kind", "name"), [(AMCL, "amcl_pose"), (MOCAP, "pose"), (ODOM, "odom")])
def test_auc_is_that_of_the_simulated_run(simulated: Any, storage: str, kind: str, name: str, tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", poses(simulated, kind, f"/robot{{}}/{name}"), storage)
    starts = {f"robot{k}": tuple(map(float, simulated.pose[0, k])) for k in range(2)} if kind == ODOM else None
    judged = read(path, Yardstick(goal=(2.0, 0.0), starts=starts, path_resolution=1e-3)).quality
    assert judged is not None and judged.robots == ("robot0", "robot1")
    np.testing.assert_allclose(judged.auc, simulated.auc, rtol=1e-3)
    assert judged.min_distance == pytest.approx(float(simulated.min_distance), abs=2e-3)
    np.testing.assert_allclose(judged.path_length, simulated.path_length, rtol=2e-3)
    np.testing.assert_allclose(judged.arrival_time, simulated.arrival_time, atol=0.03)
    np.testing.assert_allclose(judged.pose[-1, :, 2], simulated.pose[-1, :, 2], atol=1e-2)  # continuous headings


def test_auc_of_a_straight_line_in_closed_form(tmp_path: Path) -> None:
    # At the cap of the reference a robot 1 m beside it keeps its disagreement: J = T, with p̄ on the same x.
    path = write_bag(tmp_path / "bag", line(101) + line(101, topic="/b/amcl_pose"))
    still = Yardstick(goal=(50.0, 1.0), v_max=0.5, normaliser="goal_distance")
    judged = read(path, still).quality
    assert judged is not None
    np.testing.assert_allclose(judged.auc, 0.0, atol=1e-9)
    slower = Yardstick(
        goal=(50.0, 1.0), v_max=0.25, normaliser="goal_distance"
    )  # delta = 0.25 t, J = 0.25² T³ / 3 / 50²
    judged = read(path, slower).quality
    assert judged is not None
    np.testing.assert_allclose(judged.auc, 0.25**2 * 2.0**3 / 3 / 50**2, rtol=1e-5)


def test_a_horizon_and_a_begin_cut_the_run(simulated: Any, tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", poses(simulated) + [(3.0, "/robot0/cmd_vel", TWIST, speeds(0.1, 0.0))])
    for begin, horizon, began, lasts in (
        ("first", 5.0, 0.0, 5.0), (2.0, None, 2.0, 10.0), ("command", 1.0, 3.0, 1.0), ("motion", 1.0, 0.3, 1.0),
    ):  # fmt: skip
        judged = read(path, Yardstick(goal=(2.0, 0.0), begin=begin, horizon=horizon)).quality
        assert judged is not None
        assert judged.began == pytest.approx(began, abs=0.11) and judged.duration == pytest.approx(lasts, abs=0.02)
    short = read(path, Yardstick(goal=(2.0, 0.0), horizon=30.0))
    assert any("expected 30 s" in note for note in short.findings.notes)


def test_the_goal_is_where_robots_end_by_default(simulated: Any, tmp_path: Path) -> None:
    judged = read(write_bag(tmp_path / "bag", poses(simulated)), Yardstick(goal="end")).quality
    assert judged is not None
    end = np.asarray(simulated.pose)[np.asarray(simulated.time) >= 11.0].mean(axis=(0, 1))[:2]
    np.testing.assert_allclose(judged.goal, end, atol=5e-3)


def test_odometry_alone_gives_no_distance(tmp_path: Path) -> None:
    both = line(kind=ODOM, topic="/a/odom") + line(kind=ODOM, topic="/b/odom")
    run = read(write_bag(tmp_path / "bag", both))
    assert run.quality is not None and np.isnan(run.quality.min_distance) and run.quality.collided is None
    assert any("frames of their own" in note for note in run.findings.notes)


def test_times_do_not_owe_to_the_delay(tmp_path: Path) -> None:
    # A radio that delays poses by up to 80 ms, from a robot whose clock is 100 s behind and drifts.
    late = 0.08 * np.random.default_rng(2).random(1500) ** 3
    messages = [
        (
            k * RATE + late[k],
            "/a/amcl_pose",
            AMCL,
            pose(AMCL, 1e-4 * k * RATE - 100.0 + k * RATE, 0.5 * k * RATE, 1.0, 0.0),
        )
        for k in range(1500)
    ]
    run = read(write_bag(tmp_path / "bag", sorted(messages, key=lambda message: message[0])))
    judged = run.quality
    assert judged is not None
    begin = judged.pose[0, 0, 0]
    np.testing.assert_allclose(judged.pose[:, 0, 0] - begin, 0.5 * judged.time, atol=1.5e-3)
    np.testing.assert_allclose(np.percentile(run.late["/a/amcl_pose"], 50), np.percentile(late, 50), atol=2e-3)


def test_stamped_commands_tell_the_loop_time_and_what_is_lost(tmp_path: Path) -> None:
    delay = 0.12 + 0.06 * np.random.default_rng(4).random(300)
    lost = {40, 41, 42, 100}
    commands = [
        (RATE * k + delay[k], "/a/cmd_vel", STAMPED, stamped(RATE * k, 0.3, 0.0)) for k in range(300) if k not in lost
    ]
    run = read(write_bag(tmp_path / "bag", sorted(line(300) + commands, key=lambda message: message[0])))
    table = run.loops["a"].table
    assert table.index[table["lost"]].tolist() == sorted(lost)
    np.testing.assert_allclose(
        table["loop_time"][~table["lost"]], [delay[k] for k in range(300) if k not in lost], atol=1e-6
    )
    np.testing.assert_allclose(table["source_stamp"], RATE * np.arange(300), atol=1e-6)


def test_stamps_of_another_clock_give_no_loop_time(tmp_path: Path) -> None:
    commands = [(RATE * k, "/a/cmd_vel", STAMPED, stamped(RATE * k + 5.0, 0.3, 0.0)) for k in range(50)]
    run = read(write_bag(tmp_path / "bag", commands))
    assert run.loops == {} and found(run)["clock_unknown"] == 1


def test_commands_gaps_and_holds(tmp_path: Path) -> None:
    commands = [each for each in drive(300) if not 2.0 < each[0] < 4.0]
    commands[10] = (*commands[10][:3], speeds(0.5, 94.48))
    run = read(write_bag(tmp_path / "bag", [*line(300), *commands]))
    report = run.commands["a"]
    assert found(run) == {"gaps": 1, "outlier_commands": 1}
    assert report.period == pytest.approx(RATE) and report.longest_gap == pytest.approx(2.0)
    assert report.hold_time == pytest.approx(2.0 - RATE) == report.driving_hold_time
    assert report.omega_max == pytest.approx(0.1) and report.v_max == pytest.approx(0.5)
    assert any("94.48 rad/s" in note for note in run.findings.notes)


def test_offered_qos_is_read(tmp_path: Path) -> None:
    for storage in ("sqlite3", "mcap"):
        path = write_bag(tmp_path / storage, [*line(5), *drive(5)], storage, "BEST_EFFORT", 5)
        words = {"/a/amcl_pose": "best_effort keep_last(5)", "/a/cmd_vel": "best_effort keep_last(5)"}
        assert read(path).qos == words
        (path / "metadata.yaml").unlink()
        assert read(path).qos == words
        assert read(storage_files(path)[0]).qos == words  # a file on its own


def swapped(messages: list[Message], *places: int) -> list[Message]:
    """Stamps and poses of some messages exchanged with the next, record times kept."""
    for k in places:
        messages[k], messages[k + 1] = (messages[k][0], *messages[k + 1][1:]), (messages[k + 1][0], *messages[k][1:])
    return messages


def with_pose(messages: list[Message], places: Sequence[int], make: Callable[[float], Any]) -> list[Message]:
    for k in places:
        messages[k] = (*messages[k][:3], make(messages[k][0]))
    return messages


def late_start(count: int) -> list[Message]:
    """A clock that is set back by an hour in the middle."""
    return [
        (
            RATE * k,
            "/a/amcl_pose",
            AMCL,
            pose(AMCL, RATE * k - (3600.0 if k > count // 2 else 0.0), 0.5 * RATE * k, 1.0, 0.0),
        )
        for k in range(count)
    ]


DIRT: dict[str, tuple[Callable[[], list[Message]], int]] = {
    "duplicates": (lambda: [*line(), (4.0, *line()[199][1:]), (4.0, *line()[198][1:])], 2),
    "unordered": (lambda: swapped(line(), 20, 70, 111), 3),
    "restarts": (lambda: late_start(200), 1),
    "gaps": (lambda: [each for each in line() if not 1.0 < each[0] < 2.0], 1),
    "jumps": (lambda: with_pose(line(), [60], lambda t: pose(AMCL, t, 9.0, 1.0, 0.0)), 2),
    "not_finite": (lambda: with_pose(line(), [60, 80], lambda t: pose(AMCL, t, float("nan"), 1.0, 0.0)), 2),
    "no_stamp": (lambda: with_pose(line(), [60], lambda t: pose(AMCL, -EPOCH / 1e9, 0.5 * t, 1.0, 0.0)), 1),
    "ahead_of_clock": (
        lambda: with_pose(line(8000), [2500], lambda t: pose(AMCL, t + 0.5, 0.5 * (t + 0.5), 1.0, 0.0)),
        1,
    ),
    "unreadable": (lambda: with_pose(line(), [60, 61], lambda t: b"\x00\x01\x00\x00\x05"), 2),
}


@pytest.mark.parametrize("cause", DIRT)
def test_each_kind_of_dirt_is_counted(cause: str, tmp_path: Path) -> None:
    spoil, count = DIRT[cause]
    run = read(write_bag(tmp_path / "bag", spoil()))
    assert found(run) == {cause: count} | {"ahead_of_clock": {"unordered": 1}, "gaps": {"silences": 1}}.get(cause, {})
    assert run.quality is not None and np.isfinite(run.quality.auc).all()
    if cause not in ("jumps", "gaps"):
        np.testing.assert_allclose(run.quality.pose[:, 0, 0], 0.5 * run.quality.time, atol=1e-6)


def cut(path: Path, share: float) -> int:
    """Cuts a file and returns how many bytes are left."""
    size = int(share * path.stat().st_size)
    with path.open("rb+") as file:
        file.truncate(size)
    return size


@pytest.mark.parametrize("metadata", [True, False])
@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_bag_cut_in_the_middle_is_read_as_far_as_it_goes(storage: str, metadata: bool, tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", line(3000), storage)
    (file,) = storage_files(path)
    cut(file, 0.5)
    if not metadata:
        (path / "metadata.yaml").unlink()
    run = read(path)
    counts = found(run)
    assert counts.pop("truncated") == 1
    assert counts.get("missing_messages", 0) == (3000 - run.quality.time.size if metadata and run.quality else 0)
    assert run.quality is not None and 0.35 * 60.0 < run.quality.duration < 0.65 * 60.0
    np.testing.assert_allclose(run.quality.pose[:, 0, 0], 0.5 * run.quality.time, atol=1e-6)


@pytest.mark.parametrize("method", ["lz4", "zstd"])
def test_compressed_chunks_of_a_cut_file_are_read(method: str, tmp_path: Path) -> None:
    import importlib
    import struct
    import sys

    path = write_bag(tmp_path / "bag", line(300), "mcap")
    (file,) = storage_files(path)
    whole = file.read_bytes()
    records, place = whole[8:], 0
    kept, packed = b"", b""
    while place + 9 <= len(records) and records[place] != 0x0F:
        code, size = struct.unpack_from("<BQ", records, place)
        data = records[place : place + 9 + size]
        if code == 0x06:
            (length,) = struct.unpack_from("<I", data, 9 + 28)
            packed += data[9 + 28 + 4 + length + 8 :]
        elif code in (0x03, 0x04, 0x05):
            packed += data
        place += 9 + size
    name = "lz4.frame" if method == "lz4" else "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
    squeezed = importlib.import_module(name).compress(packed)
    label = struct.pack("<I", len(method)) + method.encode()
    body = struct.pack("<QQQI", 0, 0, len(packed), 0) + label + struct.pack("<Q", len(squeezed)) + squeezed
    kept = whole[:8] + struct.pack("<BQ", 0x06, len(body)) + body
    cut_off = tmp_path / "cut.mcap"
    cut_off.write_bytes(kept + struct.pack("<BQ", 0x06, 10_000) + b"half of a chunk")
    run = read(cut_off)
    assert found(run) == {"truncated": 1}
    assert run.quality is not None and run.quality.duration == pytest.approx(299 * RATE)


def test_messages_that_the_metadata_promises_are_counted(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", line(50))
    text = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(text.replace("message_count: 50", "message_count: 60"))
    assert found(read(path)) == {"missing_messages": 10}


def test_robots_and_topics_go_by_pattern(tmp_path: Path) -> None:
    every = [*line(), *line(topic="/chair/amcl_pose"), *line(kind=ODOM, topic="/a/odom")]
    path = write_bag(tmp_path / "bag", every)
    run = read(path, topics=TopicPatterns(("/{robot}/amcl_pose", "/{robot}/odom"), (), only=("a*",)))
    assert run.quality is not None and run.quality.robots == ("a",)
    assert any("chair" in note for note in run.findings.notes)  # what is left out is said
    run = read(path, topics=TopicPatterns(("/{robot}/odom",), ()))
    assert run.quality is not None and list(run.qos) == ["/a/odom"]


def test_bad_bags_are_one_clear_line(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", line(5))
    empty = tmp_path / "empty"
    empty.mkdir()
    noise = tmp_path / "noise.mcap"
    noise.write_bytes(b"no bag at all, but a long enough text to be read as one")
    base = tmp_path / "noise.db3"
    base.write_bytes(b"no bag at all, but a long enough text to be read as one")
    old = tmp_path / "old.bag"
    old.write_bytes(b"#ROSBAG V2.0\n")
    gone = tmp_path / "gone"
    shutil.copytree(bag, gone)
    storage_files(gone)[0].unlink()
    for path, message in (
        (tmp_path / "missing", "no such file or folder, expected a rosbag2 folder"),
        (empty, "holds no .db3 or .mcap file"),
        (noise, "is no MCAP file"),
        (base, "cannot be read as a rosbag2 SQLite3 file"),
        (old, "is a bag of ROS 1, expected rosbag2"),
        (gone, "names files in its metadata.yaml that are not there"),
    ):
        with pytest.raises(ValueError, match=message) as error:
            read(path)
        assert str(path) in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(ValueError, match=r"its topics are /a/amcl_pose \(PoseWithCovarianceStamped\)"):
        read(bag, topics=TopicPatterns(("/nothing",), ()))


def test_messages_of_other_types_are_no_poses(tmp_path: Path) -> None:
    text = STORE.types["std_msgs/msg/String"](data="here")
    path = write_bag(tmp_path / "bag", [(0.0, "/a/amcl_pose", "std_msgs/msg/String", text), *drive(20)])
    run = read(path)
    assert run.quality is None and "a" in run.commands
    assert any("is of type std_msgs/msg/String" in note for note in run.findings.notes)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_memory_does_not_grow_with_the_bag(storage: str, tmp_path: Path) -> None:
    image = bytes(STORE.serialize_cdr(STORE.types["std_msgs/msg/String"](data="x" * 100_000), "std_msgs/msg/String"))
    poses_ = line(300)
    messages = [each for k in range(300) for each in (poses_[k], (RATE * k, "/camera", "std_msgs/msg/String", image))]
    path = write_bag(tmp_path / "bag", messages, storage)
    read(path)  # imports and caches
    tracemalloc.start()
    run = read(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert run.quality is not None and run.quality.time.size == 300
    assert sum(file.stat().st_size for file in storage_files(path)) > 30e6
    assert peak < 6e6
