"""Messages of ROS 2 for bags, made by rosbags from its own definitions: no ROS needed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from qocjax.cost_values import FREE, INSCRIBED, LETHAL, UNKNOWN
from qocjax.navigation.grid import Grid

__all__ = ["diagnostics", "grid", "odometry", "path", "pose", "pose_with_covariance", "store", "transforms", "twist"]

Placed = Sequence[float]
"""x, y, heading (m, m, rad)."""


@cache
def store() -> Any:
    """The definitions."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.LATEST)


def _new(kind: str, **values: Any) -> Any:
    package, name = kind.split("/")
    return store().types[f"{package}/msg/{name}"](**values)


def _header(stamp: int, frame: str) -> Any:
    time = _new("builtin_interfaces/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
    return _new("std_msgs/Header", stamp=time, frame_id=frame)


def _turn(heading: float) -> Any:
    return _new("geometry_msgs/Quaternion", x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2))


def _vector(x: float, y: float, z: float) -> Any:
    return _new("geometry_msgs/Vector3", x=float(x), y=float(y), z=float(z))


def _plain(place: Placed) -> Any:
    point = _new("geometry_msgs/Point", x=float(place[0]), y=float(place[1]), z=0.0)
    return _new("geometry_msgs/Pose", position=point, orientation=_turn(float(place[2])))


def _speeds(speed: Sequence[float]) -> Any:
    ahead, turning, left = (*speed, 0.0)[:3]
    return _new("geometry_msgs/Twist", linear=_vector(ahead, left, 0), angular=_vector(0, 0, turning))


def _certain(place: Placed) -> Any:
    return _new("geometry_msgs/PoseWithCovariance", pose=_plain(place), covariance=np.zeros(36))


def pose(stamp: int, frame: str, place: Placed) -> Any:
    """geometry_msgs/PoseStamped."""
    return _new("geometry_msgs/PoseStamped", header=_header(stamp, frame), pose=_plain(place))


def pose_with_covariance(stamp: int, frame: str, place: Placed) -> Any:
    """geometry_msgs/PoseWithCovarianceStamped."""
    return _new("geometry_msgs/PoseWithCovarianceStamped", header=_header(stamp, frame), pose=_certain(place))


def odometry(stamp: int, frame: str, child: str, place: Placed, speed: Sequence[float]) -> Any:
    """nav_msgs/Odometry, with nu and omega, and nu_y of a holonomic robot."""
    moving = _new("geometry_msgs/TwistWithCovariance", twist=_speeds(speed), covariance=np.zeros(36))
    return _new(
        "nav_msgs/Odometry", header=_header(stamp, frame), child_frame_id=child, pose=_certain(place), twist=moving
    )


def twist(stamp: int, frame: str, command: Sequence[float]) -> Any:
    """geometry_msgs/TwistStamped of nu and omega, and nu_y of a holonomic robot."""
    return _new("geometry_msgs/TwistStamped", header=_header(stamp, frame), twist=_speeds(command))


def transforms(stamp: int, each: Sequence[tuple[str, str, Placed]]) -> Any:
    """tf2_msgs/TFMessage of parents, children and places."""
    made = [
        _new("geometry_msgs/TransformStamped", header=_header(stamp, parent), child_frame_id=child,
             transform=_new("geometry_msgs/Transform", translation=_vector(place[0], place[1], 0),
                            rotation=_turn(float(place[2]))))
        for parent, child, place in each
    ]  # fmt: skip
    return _new("tf2_msgs/TFMessage", transforms=made)


def path(stamp: int, frame: str, points: NDArray[np.floating]) -> Any:
    """nav_msgs/Path through points [L, 2], each with the direction to the next."""
    steps = np.diff(points, axis=0)
    heading = np.arctan2(steps[:, 1], steps[:, 0]) if len(steps) else np.zeros(0)
    heading = np.concatenate([heading, heading[-1:] if len(heading) else [0.0]])
    poses = [pose(stamp, frame, (x, y, turn)) for (x, y), turn in zip(points, heading, strict=True)]
    return _new("nav_msgs/Path", header=_header(stamp, frame), poses=poses)


def grid(stamp: int, frame: str, cells: Grid, cost: NDArray[Any]) -> Any:
    """nav_msgs/OccupancyGrid of costs 0 to 255 as Nav2 publishes them: 100 an obstacle, 99 inscribed, -1 unknown."""
    time = _header(stamp, frame).stamp
    about = _new("nav_msgs/MapMetaData", map_load_time=time, resolution=cells.resolution, width=cells.shape[1],
                 height=cells.shape[0], origin=_plain((*cells.origin, 0.0)))  # fmt: skip
    cost = np.asarray(cost)
    found = np.clip(np.round(1 + (cost.astype(float) - 1) * 97 / 251), 1, 98)  # of 1 to 252
    for value, occupied in ((FREE, 0), (INSCRIBED, 99), (LETHAL, 100), (UNKNOWN, -1)):
        found[cost == value] = occupied
    return _new("nav_msgs/OccupancyGrid", header=_header(stamp, frame), info=about, data=found.astype(np.int8).ravel())


def diagnostics(stamp: int, statuses: Sequence[tuple[str, int, str, Mapping[str, Any]]]) -> Any:
    """diagnostic_msgs/DiagnosticArray of names, levels (0 OK, 1 warning), messages and values."""
    made = [
        _new("diagnostic_msgs/DiagnosticStatus", level=level, name=name, message=message, hardware_id="",
             values=[_new("diagnostic_msgs/KeyValue", key=key, value=f"{value:.6g}") for key, value in values.items()],
             OK=0, WARN=1, ERROR=2, STALE=3)
        for name, level, message, values in statuses
    ]  # fmt: skip
    return _new("diagnostic_msgs/DiagnosticArray", header=_header(stamp, ""), status=made)
