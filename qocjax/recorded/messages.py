"""Poses and commands out of ROS 2 messages, as plain numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

__all__ = ["COMMANDS", "POSES", "decoder"]

Row = tuple[int, float, float, float, str]
"""Header stamp (ns, 0 for none), three numbers (x, y, heading; or nu, omega, 0), and the frame."""

POSES = (
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
)
COMMANDS = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")


def decoder(kind: str) -> Callable[[bytes], Row]:
    """How to read messages of a type.

    The returned function raises ValueError for data that is no such message.

    Raises:
        ValueError: The type is none of `POSES` and `COMMANDS`.
    """
    if kind not in (*POSES, *COMMANDS):
        raise ValueError(f"type: got {kind!r}, expected one of {', '.join((*POSES, *COMMANDS))}")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    number = {
        POSES[0]: lambda message: _pose(message.header, message.pose.pose),
        POSES[1]: lambda message: _pose(message.header, message.pose.pose),
        POSES[2]: lambda message: _pose(message.header, message.pose),
        COMMANDS[0]: lambda message: _command(None, message),
        COMMANDS[1]: lambda message: _command(message.header, message.twist),
    }[kind]

    def read(data: bytes) -> Row:
        try:
            return number(store.deserialize_cdr(data, kind))
        except Exception as error:  # whatever the decoder stumbles over, the message is no such message
            raise ValueError(f"{kind}: {error}") from None

    return read


def _pose(header: Any, pose: Any) -> Row:
    q = pose.orientation
    heading = math.atan2(2.0 * (q.w * q.z + q.x * q.y), q.w**2 + q.x**2 - q.y**2 - q.z**2)
    return _stamp(header), pose.position.x, pose.position.y, heading, header.frame_id


def _command(header: Any, twist: Any) -> Row:
    stamp, frame = (_stamp(header), header.frame_id) if header is not None else (0, "")
    return stamp, twist.linear.x, twist.angular.z, 0.0, frame


def _stamp(header: Any) -> int:
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec
