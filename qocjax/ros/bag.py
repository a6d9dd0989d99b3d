"""A simulated run as a rosbag2 (MCAP), with the names, frames and types that a robot with Nav2 has."""

from __future__ import annotations

import importlib.util
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from qocjax import _checks
from qocjax.navigation import NavigationStack, StaticMap, snapshot
from qocjax.navigation.cycle import View
from qocjax.ros import messages

__all__ = ["BEGIN", "Message", "from_start", "save", "write_bag"]

BEGIN = 1_700_000_000.0
"""When a run begins (s since 1970); a stamp of 0 is none."""

_LATCHED = ("/map", "/tf_static", "goal_pose")
_EVERY = 1.0  # s between two costmaps, and two diagnostics


class Message(NamedTuple):
    """What a bag holds at a time."""

    time: int  # ns
    topic: str
    content: Any


def write_bag(
    path: str | Path, run: Any, static_map: StaticMap | None = None, stack: NavigationStack | None = None,
    begin: float = BEGIN,
) -> Path:  # fmt: skip
    """Writes a run as a bag; one that lies there is replaced.

    For each robot, from robot0 on, at every sampling instant `/robot0/odom`, from where it starts, `/robot0/amcl_pose`,
    on the map, `/tf`, and, where another is in force than before, `/robot0/cmd_vel` with the stamp of the state that it
    was computed from; its `/robot0/goal_pose`; `/diagnostics`; of a navigation stack `/robot0/plan`; the map on `/map`,
    and with the stack each robot's costmap every second.

    Args:
        path: Folder of the bag.
        run: From `simulate` or `replay`.
        static_map: Map of the room; None for none, or the stack's.
        stack: That the run was simulated with, for costmaps.
        begin: When the run begins (s since 1970).

    Raises:
        OSError: The folder cannot be written.
        ValueError: rosbags is not installed, something other than a bag lies there, or there are several runs.
    """
    start = round(1e9 * float(_checks.bounded("begin", begin, above=0.0, shape=())))
    return save(path, _messages(run, static_map, stack, start))


def save(path: str | Path, found: Iterable[Message], reliable: bool = True, depth: int | None = 10) -> Path:
    """Writes messages as a bag, in the order of their times; a bag that lies there is replaced.

    Args:
        path: Folder of the bag.
        found: Messages, as `qocjax.ros.messages` makes them.
        reliable: Whether the topics were offered RELIABLE; those that are latched always are.
        depth: Their KEEP_LAST depth; None for KEEP_ALL.

    Raises:
        OSError: The folder cannot be written.
        ValueError: rosbags is not installed, or something other than a bag lies there.
    """
    path = Path(path)
    if importlib.util.find_spec("rosbags") is None:
        raise ValueError(f"{path}: needs rosbags to be written, expected it installed: pip install 'qocjax[ros]'")
    if path.exists() and not _is_bag(path):
        raise ValueError(f"path: got {path}, which is there and no bag, expected a new folder")
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{path.name}-", dir=path.parent) as temporary:
        made = Path(temporary) / path.name
        _write(made, sorted(found, key=lambda each: each.time), reliable, depth)
        if path.exists():
            shutil.rmtree(path)
        made.rename(path)
    return path


def _is_bag(path: Path) -> bool:
    names = {each.suffix for each in path.iterdir()} if path.is_dir() else {"file"}
    return names <= {".yaml", ".mcap", ".db3"}


def _write(folder: Path, found: list[Message], reliable: bool, depth: int | None) -> None:
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
    from rosbags.rosbag2 import StoragePlugin, Writer

    forever = QosTime(9223372036, 854775807)

    def offered(latched: bool) -> Qos:
        history = QosHistory.KEEP_LAST if latched or depth else QosHistory.KEEP_ALL
        reliability = QosReliability.RELIABLE if latched or reliable else QosReliability.BEST_EFFORT
        durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
        return Qos(history, 1 if latched else depth or 0, reliability, durability, forever, forever,
                   QosLiveliness.AUTOMATIC, forever, False)  # fmt: skip

    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics: dict[str, Any] = {}
        for time, topic, content in found:
            if topic not in topics:
                qos = offered(topic.endswith(_LATCHED))
                topics[topic] = writer.add_connection(
                    topic, content.__msgtype__, typestore=messages.store(), offered_qos_profiles=[qos]
                )
            writer.write(topics[topic], time, messages.store().serialize_cdr(content, content.__msgtype__))


def _messages(run: Any, static_map: StaticMap | None, stack: NavigationStack | None, begin: int) -> Iterator[Message]:
    done = jax.tree.map(np.asarray, run)
    if done.pose.ndim != 3:
        raise ValueError(f"run: got poses of shape {done.pose.shape}, expected those of one run, (P + 1, N, 3)")
    instants = begin + np.round(1e9 * np.asarray(done.time, np.float64)).astype(np.int64)
    stamps = [int(each) for each in instants]
    room = stack.static_map if static_map is None and stack is not None else static_map
    if room is not None:
        yield Message(begin, "/map", messages.grid(begin, "map", room.grid, room.cost))
    robots = range(done.pose.shape[1])
    names = [f"robot{robot}" for robot in robots]
    starts = [("map", f"{name}/odom", done.pose[0, robot]) for robot, name in enumerate(names)]
    yield Message(begin, "/tf_static", messages.transforms(begin, starts))
    odom = np.stack([from_start(done.pose[:, robot]) for robot in robots], axis=1)
    for k, stamp in enumerate(stamps):
        moved = [(f"{name}/odom", f"{name}/base_footprint", odom[k, robot]) for robot, name in enumerate(names)]
        yield Message(stamp, "/tf", messages.transforms(stamp, moved))
    for robot, name in enumerate(names):
        goal = (*np.broadcast_to(done.goal, (len(names), 2))[robot], 0.0)
        yield Message(begin, f"/{name}/goal_pose", messages.pose(begin, "map", goal))
        yield from _motion(done, robot, name, odom[:, robot], stamps)
        if isinstance(done.view, View):
            yield from _plans(done.view, robot, name, stamps)
    yield from _diagnostics(done, names, stamps)
    if stack is not None:
        yield from _costmaps(done, stack, names, stamps)


def from_start(pose: np.ndarray) -> np.ndarray:
    """Poses [K, 3] in the frame of the first."""
    step, turn = pose[:, :2] - pose[0, :2], pose[0, 2]
    along = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return np.column_stack([step @ along, pose[:, 2] - turn])


def _motion(done: Any, robot: int, name: str, odom: np.ndarray, stamps: list[int]) -> Iterator[Message]:
    """Odometry, localisation and commands of a robot."""
    frame, base = f"{name}/odom", f"{name}/base_footprint"
    speed = done.speed[:, robot]
    ages = np.round(1e9 * np.asarray(done.age, np.float64)[:, robot]).astype(np.int64)
    last: tuple[int, tuple[float, ...]] = (stamps[0], (0.0,) * speed.shape[1])
    for k, stamp in enumerate(stamps):
        at = messages.odometry(stamp, frame, base, odom[k], speed[min(k, len(speed) - 1)])
        yield Message(stamp, f"/{name}/odom", at)
        place = messages.pose_with_covariance(stamp, "map", done.pose[k, robot])
        yield Message(stamp, f"/{name}/amcl_pose", place)
        if k == len(ages):
            break
        now = (_at_instant(stamp - int(ages[k]), stamps), tuple(map(float, done.command[k, robot])))
        if now != last:
            yield Message(stamp, f"/{name}/cmd_vel", messages.twist(now[0], base, now[1]))
            last = now


def _at_instant(stamp: int, stamps: list[int]) -> int:
    """The sampling instant nearest to a stamp: ages may be of single precision."""
    k = int(np.searchsorted(stamps, stamp))
    return min(stamps[max(k - 1, 0) : k + 1], key=lambda each: abs(each - stamp))


def _plans(view: View, robot: int, name: str, stamps: list[int]) -> Iterator[Message]:
    """The global path, whenever it is another."""
    last: np.ndarray | None = None
    paths, has = np.asarray(view.path)[:, robot], np.asarray(view.has_path)[:, robot]
    for stamp, points, there in zip(stamps, paths, has, strict=False):
        if there and (last is None or not np.array_equal(points, last)):
            last = points
            ends = len(points) - int(np.argmax(np.any(points[::-1] != points[-1], axis=1)))  # the last point repeated
            yield Message(stamp, f"/{name}/plan", messages.path(stamp, "map", points[: min(ends + 1, len(points))]))


def _diagnostics(done: Any, names: list[str], stamps: list[int]) -> Iterator[Message]:
    """What the deadline node of each robot would tell every second: age, and loops whose time is over."""
    deadline, time = float(done.deadline), np.asarray(done.time, np.float64)[:-1]
    tau = float(time[1]) if time.size > 1 else float(done.time[-1])
    sources = np.round((time[:, None] - np.asarray(done.age, np.float64)) / tau)
    later = np.diff(sources, axis=0, prepend=0.0) > 0
    moved_by_first = np.maximum.accumulate((sources == 0) & done.command.any(axis=-1), axis=0)  # or none came before
    acted = np.cumsum(later, axis=0) + moved_by_first
    for k in range(0, time.size, max(round(_EVERY / tau), 1)):
        over = max(int((time[k] - deadline) / tau + 1e-6) + 1, 0) if time[k] >= deadline else 0
        told = []
        for robot, name in enumerate(names):
            completed = min(int(acted[k, robot]), over)
            values = {"age (s)": done.age[k, robot], "deadline (s)": deadline, "completed": completed,
                      "missed": over - completed}  # fmt: skip
            words = f"{completed} loops completed, {over - completed} missed"
            told.append((f"/{name}/deadline: loops", 0, words, values))
        yield Message(stamps[k], "/diagnostics", messages.diagnostics(stamps[k], told))


def _costmaps(done: Any, stack: NavigationStack, names: list[str], stamps: list[int]) -> Iterator[Message]:
    tau = float(done.time[1])
    for k in range(0, len(stamps) - 1, max(round(_EVERY / tau), 1)):
        for robot, name in enumerate(names):
            cost = np.asarray(snapshot(stack, done, k, robot).layers.total())
            made = messages.grid(stamps[k], "map", stack.static_map.grid, np.round(cost))
            yield Message(stamps[k], f"/{name}/costmap", made)
