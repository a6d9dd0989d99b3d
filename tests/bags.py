"""Bags for the tests, written with rosbags' own writer."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.LATEST)
EPOCH = 1_700_000_000_000_000_000  # ns
AMCL = "geometry_msgs/msg/PoseWithCovarianceStamped"
ODOM = "nav_msgs/msg/Odometry"
MOCAP = "geometry_msgs/msg/PoseStamped"
TWIST = "geometry_msgs/msg/Twist"
STAMPED = "geometry_msgs/msg/TwistStamped"
TF = "tf2_msgs/msg/TFMessage"
PATH = "nav_msgs/msg/Path"
POLYGON = "geometry_msgs/msg/Polygon"
PLACED = "geometry_msgs/msg/PolygonStamped"

Message = tuple[float, str, str, Any]  # record time (s), topic, type, message
_FOREVER = QosTime(9223372036, 854775807)


def _type(kind: str) -> Any:
    return STORE.types[kind]


def header(stamp: float, frame: str = "map") -> Any:
    ns = EPOCH + round(stamp * 1e9)
    time = _type("builtin_interfaces/msg/Time")(sec=ns // 10**9, nanosec=ns % 10**9)
    return _type("std_msgs/msg/Header")(stamp=time, frame_id=frame)


def pose(
    kind: str, stamp: float, x: float, y: float, heading: float, frame: str = "map",
    driven: tuple[float, float] = (0.0, 0.0),
) -> Any:  # fmt: skip
    point = _type("geometry_msgs/msg/Point")(x=x, y=y, z=0.0)
    turn = _type("geometry_msgs/msg/Quaternion")(x=0.0, y=0.0, z=np.sin(heading / 2), w=np.cos(heading / 2))
    plain = _type("geometry_msgs/msg/Pose")(position=point, orientation=turn)
    if kind == MOCAP:
        return _type(kind)(header=header(stamp, frame), pose=plain)
    both = _type("geometry_msgs/msg/PoseWithCovariance")(pose=plain, covariance=np.zeros(36))
    if kind == AMCL:
        return _type(kind)(header=header(stamp, frame), pose=both)
    twist = _type("geometry_msgs/msg/TwistWithCovariance")(twist=speeds(*driven), covariance=np.zeros(36))
    return _type(kind)(header=header(stamp, frame), child_frame_id="base_link", pose=both, twist=twist)


def speeds(nu: float, omega: float) -> Any:
    vector = _type("geometry_msgs/msg/Vector3")
    return _type(TWIST)(linear=vector(x=nu, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=omega))


def stamped(stamp: float, nu: float, omega: float) -> Any:
    return _type(STAMPED)(header=header(stamp, "base_link"), twist=speeds(nu, omega))


def transforms(*each: tuple[str, str, float, float, float, float]) -> Any:
    """A message of transforms: parent, child, stamp, x, y, heading of each."""
    made = []
    for parent, child, stamp, x, y, heading in each:
        turn = _type("geometry_msgs/msg/Quaternion")(x=0.0, y=0.0, z=np.sin(heading / 2), w=np.cos(heading / 2))
        place = _type("geometry_msgs/msg/Transform")(
            translation=_type("geometry_msgs/msg/Vector3")(x=x, y=y, z=0.0), rotation=turn
        )
        stamped_ = _type("geometry_msgs/msg/TransformStamped")
        made.append(stamped_(header=header(stamp, parent), child_frame_id=child, transform=place))
    return _type(TF)(transforms=made)


def outline(kind: str, stamp: float, corners: list[tuple[float, float]], frame: str = "odom") -> Any:
    """A footprint of either type."""
    point = _type("geometry_msgs/msg/Point32")
    shape = _type(POLYGON)(points=[point(x=x, y=y, z=0.0) for x, y in corners])
    return shape if kind == POLYGON else _type(kind)(header=header(stamp, frame), polygon=shape)


def plan(stamp: float, points: list[tuple[float, float]], frame: str = "map") -> Any:
    return _type(PATH)(header=header(stamp, frame), poses=[pose(MOCAP, stamp, x, y, 0.0, frame) for x, y in points])


def write_bag(
    path: Path,
    messages: Iterable[Message],
    storage: str = "sqlite3",
    reliability: str = "RELIABLE",
    depth: int = 10,
    publishers: int = 1,
    compression: Any = None,
) -> Path:
    """Writes messages in the order given; `compression` is a mode and a format of rosbags."""
    qos = Qos(
        QosHistory.KEEP_LAST, depth, QosReliability[reliability], QosDurability.VOLATILE, _FOREVER, _FOREVER,
        QosLiveliness.AUTOMATIC, _FOREVER, False,
    )  # fmt: skip
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    made = Writer(path, version=9, storage_plugin=plugin)
    if compression:
        made.set_compression(*compression)
    with made as writer:
        topics: dict[tuple[str, str], Any] = {}
        for record, topic, kind, message in messages:
            if (topic, kind) not in topics:
                topics[topic, kind] = writer.add_connection(
                    topic, kind, typestore=STORE, offered_qos_profiles=[qos] * publishers
                )
            data = message if isinstance(message, bytes) else bytes(STORE.serialize_cdr(message, kind))
            writer.write(topics[topic, kind], EPOCH + round(record * 1e9), data)
    return path
