"""Robots as they are: poses in transforms alone, deep namespaces, several robots and publishers, goals of the bag."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import (
    AMCL,
    MOCAP,
    ODOM,
    PATH,
    STAMPED,
    TF,
    TWIST,
    Message,
    plan,
    pose,
    speeds,
    stamped,
    transforms,
    write_bag,
)
from hydra import compose, initialize_config_dir

from qocjax.commands.ingest import Ingested, report, run
from qocjax.config import conf_dir, load
from qocjax.config.ingest import IngestConfig
from qocjax.recorded import messages as recorded_messages
from qocjax.recorded.run import RecordedRun

RATE = 0.05


def ingest(path: Path, *options: str) -> Ingested:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        config = load(IngestConfig, compose("ingest", [f"path='{path}'", "figures=false", *options]))
    return run(config, quiet=True)


def read(path: Path, *options: str) -> RecordedRun:
    return ingest(path, *options).runs[0]


def line(
    topic: str = "/odom", kind: str = ODOM, y: float = 0.0, count: int = 200, frame: str = "odom"
) -> list[Message]:
    """A robot on its way along x at 0.2 m/s."""
    return [(RATE * k, topic, kind, pose(kind, RATE * k, 0.2 * RATE * k, y, 0.0, frame)) for k in range(count)]


def in_time(*parts: list[Message]) -> list[Message]:
    return sorted((message for part in parts for message in part), key=lambda message: message[0])


def found(each: RecordedRun) -> dict[str, int]:
    return {finding.cause: finding.count for finding in each.findings}


def tree(prefix: str = "", turn: float = np.pi / 2, localised: bool = True, y: float = 0.0) -> list[Message]:
    """A robot that drives along x of odom, which lies turned in map, as localisation and odometry publish it."""
    messages: list[Message] = [
        (0.0, "/tf_static", TF, transforms((f"{prefix}base_footprint", f"{prefix}base_link", 0.0, 0.0, 0.0, 0.0)))
    ]
    for k in range(200):
        time = RATE * k
        messages.append((time, "/tf", TF, transforms(
            (f"{prefix}odom", f"{prefix}base_footprint", time, 0.2 * time, 0.0, 0.0),
            (f"{prefix}base_link", f"{prefix}wheel_left_link", time, 0.0, 0.1, time),
        )))  # fmt: skip
        if localised and k % 10 == 0:
            messages.append((time, "/tf", TF, transforms(("map", f"{prefix}odom", time + 0.1, 1.0, 2.0 + y, turn))))
    return messages


def test_poses_come_out_of_transforms(tmp_path: Path) -> None:
    judged = read(write_bag(tmp_path / "bag", tree())).quality
    assert judged is not None and judged.robots == ("robot",)
    np.testing.assert_allclose(judged.pose[:, 0, 0], 1.0, atol=1e-9)
    np.testing.assert_allclose(judged.pose[:, 0, 1], 2.0 + 0.2 * judged.time, atol=1e-9)
    np.testing.assert_allclose(judged.pose[:, 0, 2], np.pi / 2, atol=1e-9)
    assert judged.path_length[0] == pytest.approx(0.2 * judged.duration)


def test_robots_of_one_tree_share_the_map(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", in_time(tree("a/"), tree("b/", y=3.0)))
    judged = read(path).quality
    assert judged is not None and judged.robots == ("a", "b") and judged.min_distance == pytest.approx(3.0)
    alone = read(write_bag(tmp_path / "odom", in_time(tree("a/", localised=False), tree("b/", localised=False))))
    assert alone.quality is not None and np.isnan(alone.quality.min_distance)
    assert any("frames of their own" in note for note in alone.findings.notes)


def test_a_topic_with_poses_is_preferred_to_transforms(tmp_path: Path) -> None:
    each = read(write_bag(tmp_path / "bag", in_time(line(), tree())))
    assert list(each.qos) == ["/odom"]
    without = [(0.1, "/tf", TF, transforms(("map", "camera", 0.1, 0.0, 0.0, 0.0))), *line("/cmd_vel", TWIST, count=0)]
    drive: list[Message] = [(RATE * k, "/cmd_vel", TWIST, speeds(0.1, 0.0)) for k in range(30)]
    each = read(write_bag(tmp_path / "none", [*without, *drive]))
    assert each.quality is None and any("no frame is a base_link" in note for note in each.findings.notes)


def test_namespaces_of_any_depth(tmp_path: Path) -> None:
    topics = [f"/fleet/north/{name}" for name in ("a", "b")]
    parts = [line(f"{topic}/odom", y=k) for k, topic in enumerate(topics)]
    drive: list[Message] = [(RATE * k, f"{topics[0]}/cmd_vel", TWIST, speeds(0.2, 0.0)) for k in range(200)]
    each = read(write_bag(tmp_path / "bag", in_time(*parts, drive)))
    assert each.quality is not None and each.quality.robots == ("fleet/north/a", "fleet/north/b")
    assert list(each.commands) == ["fleet/north/a"]


def test_what_lies_in_a_robots_namespace_is_no_robot(tmp_path: Path) -> None:
    each = read(write_bag(tmp_path / "bag", in_time(line("/a/odom"), line("/a/zed/odom"))))
    assert each.quality is not None and each.quality.robots == ("a",)
    assert any("/a/zed/odom: lies within the namespace of a" in note for note in each.findings.notes)


def test_each_robot_has_the_first_of_its_topics(tmp_path: Path) -> None:
    each = read(write_bag(tmp_path / "bag", in_time(line("/a/amcl_pose", AMCL, frame="map"), line("/b/odom"))))
    assert each.quality is not None and each.quality.robots == ("a", "b")


def test_two_publishers_of_a_topic_are_found(tmp_path: Path) -> None:
    drive: list[Message] = [(RATE * k, "/cmd_vel", TWIST, speeds(0.2, 0.0)) for k in range(200)]
    for storage in ("sqlite3", "mcap"):
        each = read(write_bag(tmp_path / storage, in_time(line(), drive), storage, publishers=2))
        assert found(each)["several_publishers"] == 1 and each.findings.total("several_publishers") == 2
    both = in_time(line(), [(m[0] + 0.01, *m[1:3], pose(ODOM, m[0] + 0.01, 5.0, 5.0, 0.0, "world")) for m in line()])
    each = read(write_bag(tmp_path / "frames", both))
    assert found(each)["several_publishers"] == 1
    assert any("in 2 frames (odom, world)" in note for note in each.findings.notes)


def test_a_sparse_localisation_does_not_say_how_far_a_robot_drove(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    seen = [
        (1.0 * k, "/amcl_pose", AMCL, pose(AMCL, 1.0 * k, 0.2 * k + 0.1 * rng.normal(), 0.1 * rng.normal(), 0.0))
        for k in range(10)
    ]
    each = read(write_bag(tmp_path / "bag", in_time(seen, line())))
    assert each.quality is not None and each.quality.duration == pytest.approx(9.0, abs=0.01)
    assert each.quality.path_length[0] == pytest.approx(1.8, abs=0.02)
    assert any("its path length is that of its odometry" in note for note in each.findings.notes)
    dense = read(write_bag(tmp_path / "dense", in_time(line("/amcl_pose", AMCL, frame="map"), line())))
    assert not any("odometry" in note for note in dense.findings.notes)


def test_no_goal_no_auc(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", line())
    result = ingest(path)
    judged = result.runs[0].quality
    assert judged is not None and np.isnan(judged.auc).all() and np.isnan(judged.arrival_time).all()
    assert judged.path_length[0] == pytest.approx(0.2 * RATE * 199)
    assert "no goal" in report(result) and "No QoC" not in report(result) and result.summary["goal"].tolist() == [""]
    judged = read(path, "quality.goal=end", "quality.goal_average=0.01").quality
    assert judged is not None and np.isfinite(judged.auc).all()
    np.testing.assert_allclose(np.ravel(judged.goal), [0.2 * RATE * 199, 0.0], atol=3e-3)
    with pytest.raises(ValueError, match="quality.goal: got 'home', expected one of end"):
        read(path, "quality.goal=home")


def sent(stamp: float, x: float, y: float) -> bytes:
    """A request of Nav2's action as service introspection records it."""
    kind = "nav2_msgs/action/NavigateToPose_SendGoal_Event"
    recorded_messages.decoder(kind)
    store = recorded_messages._parser(kind).__self__  # type: ignore[attr-defined]
    types = store.types
    request = types["nav2_msgs/msg/Request"](
        goal_id=np.zeros(16, np.uint8), pose=_of(store, pose(MOCAP, stamp, x, y, 0.0)), behavior_tree="")  # fmt: skip
    event = types[kind](event_type=0, stamp=request.pose.header.stamp, client_gid=np.zeros(16, np.uint8),
                        sequence_number=1, request=[request])  # fmt: skip
    return bytes(store.serialize_cdr(event, kind))


def _of(store: Any, message: Any) -> Any:
    from bags import STORE

    return store.deserialize_cdr(STORE.serialize_cdr(message, MOCAP), MOCAP)


GOALS = {
    "/goal_pose": (MOCAP, lambda: pose(MOCAP, 0.0, 3.0, 1.0, 0.0)),
    "/plan": (PATH, lambda: plan(0.0, [(0.0, 0.0), (3.0, 1.0)])),
    "/navigate_to_pose/_action/send_goal/_service_event": (
        "nav2_msgs/action/NavigateToPose_SendGoal_Event", lambda: sent(0.0, 3.0, 1.0)),
}  # fmt: skip


@pytest.mark.parametrize("topic", GOALS)
def test_the_goal_that_a_bag_has(topic: str, tmp_path: Path) -> None:
    from bag_files import write_mcap

    kind, make = GOALS[topic]
    path = write_mcap(tmp_path / "bag.mcap", [(0.0, topic, kind, make()), *line("/amcl_pose", AMCL, frame="map")])
    each = read(path)
    assert each.quality is not None and np.isfinite(each.quality.auc).all()
    np.testing.assert_allclose(np.ravel(each.quality.goal), [3.0, 1.0])
    assert any(f"the goal is that of {topic}" in note for note in each.findings.notes)
    given = read(path, "quality.goal=[1.0,0.0]").quality
    assert given is not None and np.ravel(given.goal).tolist() == [1.0, 0.0]


def test_goals_of_another_frame_and_several_goals(tmp_path: Path) -> None:
    goal = (0.0, "/goal_pose", MOCAP, pose(MOCAP, 0.0, 3.0, 1.0, 0.0))
    each = read(write_bag(tmp_path / "odom", [goal, *line()]))
    assert each.quality is not None and np.isnan(each.quality.auc).all()
    assert any("is in the frame 'map' and the poses of robot are in 'odom'" in note for note in each.findings.notes)
    second = (1.0, "/goal_pose", MOCAP, pose(MOCAP, 1.0, 2.0, 0.0, 0.0))
    each = read(write_bag(tmp_path / "two", in_time([goal, second], line("/amcl_pose", AMCL, frame="map"))))
    assert each.quality is not None and np.ravel(each.quality.goal).tolist() == [2.0, 0.0]
    assert any("has 2 goals" in note for note in each.findings.notes)
    empty = (0.0, "/plan", PATH, plan(0.0, []))
    each = read(write_bag(tmp_path / "empty", [empty, *line("/amcl_pose", AMCL, frame="map")]))
    assert each.quality is not None and np.isnan(each.quality.auc).all() and found(each) == {}


def test_each_robot_has_its_goal(tmp_path: Path) -> None:
    goals = [(0.0, f"/{name}/goal_pose", MOCAP, pose(MOCAP, 0.0, x, 0.0, 0.0)) for name, x in (("a", 3.0), ("b", 4.0))]
    poses = [line(f"/{name}/amcl_pose", AMCL, y=y, frame="map") for name, y in (("a", 0.0), ("b", 1.0))]
    each = read(write_bag(tmp_path / "bag", in_time(goals, *poses)))
    assert each.quality is not None and each.quality.goal.tolist() == [[3.0, 0.0], [4.0, 0.0]]
    assert np.isfinite(each.quality.auc).all()


def nav2(published: bool, repeats: int = 1, delay: float = 0.15, count: int = 400) -> list[Message]:
    """Commands computed from odometry, stamped when they are published, or with the stamp of their source."""
    rng = np.random.default_rng(5)
    commands: list[Message] = []
    for k in range(1, count - 10):
        out = RATE * k + delay + 0.01 * rng.random()
        stamp = out if published else RATE * k
        commands += [
            (out + 0.002 + 0.001 * n, "/cmd_vel", STAMPED, stamped(stamp, 0.2, 0.01 * n)) for n in range(repeats)
        ]
    return in_time(line(count=count), commands)


@pytest.mark.parametrize("repeats", [1, 4])
def test_stamps_of_publication_tell_no_loop_time(repeats: int, tmp_path: Path) -> None:
    result = ingest(write_bag(tmp_path / "bag", nav2(True, repeats)))
    each = result.runs[0]
    assert each.loops == {}
    assert any("0% of the stamps are those of poses" in n and "Copy the stamp" in n for n in each.findings.notes)
    source = read(write_bag(tmp_path / "source", nav2(False, repeats))).loops["robot"].table
    assert len(source) == 389 and source["loop_time"].median() == pytest.approx(0.157, abs=2e-3)


def test_stamps_without_poses_prove_nothing(tmp_path: Path) -> None:
    each = read(write_bag(tmp_path / "bag", [m for m in nav2(False) if m[1] == "/cmd_vel"]))
    assert each.loops == {}


def test_a_simulated_clock_has_few_stamps(tmp_path: Path) -> None:
    # The controller's now() falls on a stamp of odometry because the clock knows no other times.
    commands = [(RATE * k, "/cmd_vel", STAMPED, stamped(RATE * k, 0.2, 0.0)) for k in range(200)]
    each = read(write_bag(tmp_path / "bag", in_time(line(), commands)))
    assert each.loops == {} and any("as of a simulated clock" in note for note in each.findings.notes)


def test_stamps_of_another_epoch_are_no_loop_times(tmp_path: Path) -> None:
    simulated = [(m[0], m[1], m[2], stamped(RATE * k - 1e9, 0.2, 0.0)) for k, m in
                 enumerate(m for m in nav2(False) if m[1] == "/cmd_vel")]  # fmt: skip
    each = read(write_bag(tmp_path / "bag", in_time(line(count=400), simulated)))
    assert each.loops == {} and found(each)["clock_unknown"] == 1
