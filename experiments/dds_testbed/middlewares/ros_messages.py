"""Contents of ROS 2 messages: made once, filled for each use."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Any

from qocjax.ros.node import to_stamp

__all__ = ["FRAME", "fill_path", "fill_pose", "fill_twist", "mark_of", "placed"]

FRAME = "map"


def fill_pose(pose: Any, place: Sequence[float]) -> None:
    """geometry_msgs/Pose of x, y, heading."""
    pose.position.x, pose.position.y = place[0], place[1]
    pose.orientation.z, pose.orientation.w = math.sin(place[2] / 2), math.cos(place[2] / 2)


def placed(pose: Any) -> tuple[float, float, float]:
    """x, y, heading of a geometry_msgs/Pose."""
    return pose.position.x, pose.position.y, 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)


def fill_twist(twist: Any, speeds: Sequence[float]) -> None:
    """geometry_msgs/Twist of nu, omega."""
    twist.linear.x, twist.angular.z = speeds


def mark_of(message: Any) -> bytes:
    """What no other message on the link has, as it is in CDR, little-endian.

    Of a path it is the header and the number of poses: a message about one robot has none, under the same stamp.
    """
    stamp, frame = message.header.stamp, message.header.frame_id.encode() + b"\0"
    header = struct.pack("<iII", stamp.sec, stamp.nanosec, len(frame)) + frame
    return header + struct.pack("<I", len(message.poses)) if hasattr(message, "poses") else header


def fill_path(path: Any, stamp: int, poses: Sequence[float], ages: Sequence[float]) -> None:
    """nav_msgs/Path of the poses of all robots, each stamped with the state that its command in force answers."""
    from geometry_msgs.msg import PoseStamped

    if len(path.poses) != len(ages):
        path.poses = [PoseStamped() for _ in ages]
    for robot, (each, age) in enumerate(zip(path.poses, ages, strict=True)):
        each.header.stamp, each.header.frame_id = to_stamp(stamp - round(age * 1e9)), FRAME
        fill_pose(each.pose, poses[3 * robot : 3 * robot + 3])
