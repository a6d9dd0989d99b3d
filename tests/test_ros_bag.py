"""A simulated run as a bag: read back by ingest to the same AUC, and by tools that know nothing of qocjax."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from hydra import compose, initialize_config_dir

pytest.importorskip("rosbags")

from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability
from rosbags.typesys import Stores, get_typestore

import qocjax
from qocjax.commands import ingest
from qocjax.commands.show import run as show
from qocjax.config import conf_dir, load
from qocjax.config.ingest import IngestConfig
from qocjax.config.show import ShowConfig
from qocjax.navigation import Grid, Rectangle, map_of_shapes
from qocjax.robots import Acceleration, Unicycle
from qocjax.ros.bag import BEGIN

HORIZON, TAU, DEADLINE = 8.0, 0.02, 0.21
TICKS = round(HORIZON / TAU)


@pytest.fixture(scope="module")
def simulated() -> Any:
    """Two robots that take time to obey; loops are lost and late, the deadline lies between two sampling instants."""
    scenario = qocjax.Scenario(horizon=HORIZON, robot=Unicycle(Acceleration(2.0, -2.0, 4.0)))
    times = np.array(qocjax.paper_network().draw(jax.random.key(3), TICKS, 2, TAU))
    times[100:140] = np.inf
    return qocjax.simulate(scenario, qocjax.Design(deadline=DEADLINE, tau=TAU), times)


@pytest.fixture(scope="module")
def bag(simulated: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    room = map_of_shapes(Grid(0.1, (-3.0, -3.0), (60, 70)), [Rectangle((0.0, 2.0), (0.4, 0.4))])
    return simulated.to_bag(tmp_path_factory.mktemp("bag") / "run", room)


def composed(name: str, kind: Any, *options: str) -> Any:
    with initialize_config_dir(str(conf_dir().resolve()), version_base="1.3"):
        return load(kind, compose(name, list(options)))


def content(path: Path) -> Iterator[tuple[str, int, Any]]:
    with AnyReader([path], default_typestore=get_typestore(Stores.EMPTY)) as reader:  # by the bag's own definitions
        for connection, time, data in reader.messages():
            yield connection.topic, time, reader.deserialize(data, connection.msgtype)


def ns(header: Any) -> int:
    return header.stamp.sec * 10**9 + header.stamp.nanosec


@pytest.mark.parametrize("topic", ["amcl_pose", "odom"])
def test_ingest_gives_the_auc_of_the_run(simulated: Any, bag: Path, topic: str) -> None:
    """From the positions on the map, with the goal of the bag; and from odometry, given where it begins."""
    starts = ", ".join(f"robot{k}: {np.asarray(simulated.pose[0, k]).tolist()}" for k in range(2))
    options = [f"topics.poses=['/{{robot}}/{topic}']", "figures=false", f"path={bag}"]
    if topic == "odom":
        options += [f"quality.starts={{{starts}}}", "quality.goal=[2.0, 0.0]"]
    (found,) = ingest.run(composed("ingest", IngestConfig, *options), quiet=True).runs
    assert found.quality is not None and found.quality.robots == ("robot0", "robot1")
    np.testing.assert_allclose(found.quality.auc, simulated.auc, rtol=2e-3)  # positions between are on straight lines
    np.testing.assert_allclose(found.quality.min_distance, simulated.min_distance, atol=1e-6)
    np.testing.assert_allclose(found.quality.path_length, simulated.path_length, rtol=1e-2)
    for k in range(2):
        trace = found.loops[f"robot{k}"].table
        times = trace["loop_time"][~trace["lost"]]
        np.testing.assert_allclose(times, np.ceil(DEADLINE / TAU) * TAU, atol=1e-6)  # D_cfg, at the next record
        assert trace["lost"].sum() >= 39
    assert {each.cause for each in found.findings} == {"gaps"}  # of commands, where all loops were lost


def test_every_message_says_what_the_run_did(simulated: Any, bag: Path) -> None:
    found: dict[str, list[tuple[int, Any]]] = {}
    for topic, time, message in content(bag):
        found.setdefault(topic, []).append((time, message))
    each = [f"/robot{k}/{name}" for k in range(2) for name in ("odom", "amcl_pose", "cmd_vel", "goal_pose")]
    assert set(found) == {*each, "/tf", "/tf_static", "/map", "/diagnostics"}
    begin = round(BEGIN * 1e9)
    for k in range(2):
        odom = found[f"/robot{k}/odom"]
        assert [time for time, _ in odom] == [begin + round(p * TAU * 1e9) for p in range(TICKS + 1)]
        assert all(ns(message.header) == time for time, message in odom)
        first = odom[0][1].pose.pose
        assert (first.position.x, first.position.y, first.orientation.z, first.orientation.w) == (0, 0, 0, 1)
        driven = np.array([(m.twist.twist.linear.x, m.twist.twist.angular.z) for _, m in odom])
        np.testing.assert_array_equal(driven[:-1], np.asarray(simulated.speed)[:, k])
        assert np.abs(driven[:-1] - np.asarray(simulated.command)[:, k]).max() > 0.5
        sent = {time: message for time, message in found[f"/robot{k}/cmd_vel"]}
        force, source = (0.0, 0.0), begin
        for p in range(TICKS):
            stamp = begin + round(p * TAU * 1e9)
            if stamp in sent:  # else what was in force before is still
                force = (sent[stamp].twist.linear.x, sent[stamp].twist.angular.z)
                source = ns(sent[stamp].header)
            assert force == tuple(np.asarray(simulated.command)[p, k])
            assert stamp - source == round(float(simulated.age[p, k]) / TAU) * round(TAU * 1e9)
        assert len(sent) < TICKS - 39
    (_, floor), (_, frames) = found["/map"][0], found["/tf_static"][0]
    assert (floor.info.width, floor.info.height, floor.info.resolution) == (70, 60, pytest.approx(0.1))
    cells = np.asarray(floor.data).reshape(60, 70)
    assert set(np.unique(cells)) == {0, 100} and cells[48:52, 28:32].min() == 100
    _, moved = found["/tf"][-1]
    for k in range(2):  # the frames in a row lead to where the robot is on the map
        x, y, heading = 0.0, 0.0, 0.0
        for transform in (frames.transforms[k], moved.transforms[k]):
            place, turn = transform.transform.translation, transform.transform.rotation
            c, s = np.cos(heading), np.sin(heading)
            x, y = x + c * place.x - s * place.y, y + s * place.x + c * place.y
            heading += 2 * np.arctan2(turn.z, turn.w)
        np.testing.assert_allclose((x, y), np.asarray(simulated.pose)[-1, k, :2], atol=1e-9)
        assert moved.transforms[k].header.frame_id == frames.transforms[k].child_frame_id == f"robot{k}/odom"


def test_the_last_diagnostics_count_all_loops(simulated: Any, bag: Path) -> None:
    *_, (_, time, last) = (each for each in content(bag) if each[0] == "/diagnostics")
    over = int((1e-9 * time - BEGIN - DEADLINE) / TAU) + 1
    for k, status in enumerate(last.status):
        values = {each.key: float(each.value) for each in status.values}
        assert status.name == f"/robot{k}/deadline: loops"
        assert values["completed"] + values["missed"] == over
    times = np.array(qocjax.paper_network().draw(jax.random.key(3), TICKS, 2, TAU))
    times[100:140] = np.inf
    done = [float(each.value) for status in last.status for each in status.values if each.key == "completed"]
    np.testing.assert_allclose(done, (times[:over] <= DEADLINE).sum(axis=0), atol=1)  # a loop may act within a tick


def test_tools_find_definitions_and_latched_maps(bag: Path) -> None:
    """What Foxglove and PlotJuggler need of a file: schemas in ROS's own text; RViz of a map: that it is latched."""
    (path,) = bag.glob("*.mcap")
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == sum(1 for _ in content(bag))
    for channel in summary.channels.values():
        schema = summary.schemas[channel.schema_id]
        assert (channel.message_encoding, schema.encoding) == ("cdr", "ros2msg") and schema.data
    with AnyReader([bag]) as reader:
        latched = {each.topic for each in reader.connections
                   if each.ext.offered_qos_profiles[0].durability is QosDurability.TRANSIENT_LOCAL}  # type: ignore[union-attr]  # fmt: skip
    assert latched == {"/map", "/tf_static", "/robot0/goal_pose", "/robot1/goal_pose"}


def test_a_bag_is_replaced_and_nothing_else_is(simulated: Any, bag: Path, tmp_path: Path) -> None:
    before = sum(1 for _ in content(bag))
    simulated.to_bag(bag)
    assert before - 1 == sum(1 for _ in content(bag))  # the map has gone
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("")
    with pytest.raises(ValueError, match="path: got .*mine, which is there and no bag, expected a new folder"):
        simulated.to_bag(tmp_path / "mine")
    assert [each.name for each in tmp_path.iterdir()] == ["mine"]


def test_several_runs_are_no_bag(simulated: Any, tmp_path: Path) -> None:
    both = jax.tree.map(lambda a: np.stack([a, a]), simulated)
    with pytest.raises(ValueError, match=r"run: got poses of shape \(2, 401, 2, 3\), expected those of one run"):
        both.to_bag(tmp_path / "bag")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_the_stack_s_paths_and_costmaps_are_there(tmp_path: Path) -> None:
    options = ["bag=true", "figures=false", "controller=navigation", "controller.mppi.batch_size=60",
               "scenario.horizon=2.5", "loop.tau=0.1"]  # fmt: skip
    done = show(composed("show", ShowConfig, *options), tmp_path).run
    found: dict[str, list[Any]] = {}
    for topic, _, message in content(tmp_path / "bag"):
        found.setdefault(topic, []).append(message)
    assert len(found["/robot0/costmap"]) == len(found["/robot1/costmap"]) == 3
    assert max(np.asarray(found["/robot0/costmap"][0].data)) == 100  # the other robot
    for k in range(2):
        plan = found[f"/robot{k}/plan"][0]
        places = np.array([(each.pose.position.x, each.pose.position.y) for each in plan.poses])
        assert np.hypot(*(places[0] - np.asarray(done.pose)[0, k, :2])) < 0.2
        assert np.hypot(*(places[-1] - (2.0, 0.0))) < 0.6 and (np.hypot(*np.diff(places, axis=0).T) > 0).all()
