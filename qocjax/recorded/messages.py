"""Poses, commands, transforms and goals out of ROS 2 messages, as plain numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

__all__ = [
    "COMMANDS", "FOOTPRINTS", "GOALS", "ODOMETRY", "POSES", "STAMPLESS", "TRANSFORMS", "Row", "decoder", "polygon",
    "transforms",
]  # fmt: skip

Row = tuple[int, tuple[float, ...], str]
"""Header stamp (ns, 0 for none), three numbers (x, y, heading; or nu, omega, 0), and the frame.

Behind the numbers of odometry come its own nu and omega.
"""

STAMPLESS = -(2**63)
"""Stamp of a message whose type has none."""

TRANSFORMS = "tf2_msgs/msg/TFMessage"
POSES = (
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
)
ODOMETRY = POSES[1]
FOOTPRINTS = ("geometry_msgs/msg/PolygonStamped", "geometry_msgs/msg/Polygon")
COMMANDS = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")
_PATH, _SENT = "nav_msgs/msg/Path", "nav2_msgs/action/NavigateToPose_SendGoal_Event"
GOALS = (POSES[2], _PATH, _SENT)

_NOWHERE: Row = (0, (math.nan, math.nan, math.nan), "")  # of a path or request that is empty

_NAVIGATE = """uint8[16] goal_id
geometry_msgs/PoseStamped pose
string behavior_tree
"""
_EVENT = """uint8 event_type
builtin_interfaces/Time stamp
uint8[16] client_gid
int64 sequence_number
{package}/Request[<=1] request
"""


def decoder(kind: str) -> Callable[[bytes], Row]:
    """How to read messages of a type.

    The returned function raises ValueError for data that is no such message.

    Raises:
        ValueError: The type is none of `POSES`, `COMMANDS` and `GOALS`.
    """
    number: Callable[[Any], Row] | None = {
        POSES[0]: lambda message: _pose(message.header, message.pose.pose),
        ODOMETRY: lambda message: _odometry(message.header, message.pose.pose, message.twist.twist),
        POSES[2]: lambda message: _pose(message.header, message.pose),
        COMMANDS[0]: lambda message: _command(None, message),
        COMMANDS[1]: lambda message: _command(message.header, message.twist),
        _PATH: lambda message: _pose(message.header, message.poses[-1].pose) if message.poses else _NOWHERE,
        _SENT: lambda message: (
            _pose(message.request[0].pose.header, message.request[0].pose.pose) if message.request else _NOWHERE
        ),
    }.get(kind)
    if number is None:
        raise ValueError(f"type: got {kind!r}, expected one of {', '.join((*POSES, *COMMANDS, *GOALS))}")
    parse = _parser(kind)

    def read(data: bytes) -> Row:
        try:
            return number(parse(data, kind))
        except Exception as error:  # whatever the decoder stumbles over, the message is no such message
            raise ValueError(f"{kind}: {str(error) or type(error).__name__}") from None

    return read


def transforms(data: bytes) -> list[tuple[str, str, int, float, float, float]]:
    """Parent, child, stamp (ns), x, y (m) and heading (rad) of each transform of a message.

    Raises:
        ValueError: The data is no such message.
    """
    try:
        found = []
        for each in _parser(TRANSFORMS)(data, TRANSFORMS).transforms:
            place, turn = each.transform.translation, each.transform.rotation
            parent, child = each.header.frame_id.strip("/"), each.child_frame_id.strip("/")
            found.append((parent, child, _stamp(each.header), place.x, place.y, _heading(turn)))
        return found
    except Exception as error:
        raise ValueError(f"{TRANSFORMS}: {str(error) or type(error).__name__}") from None


def polygon(kind: str, data: bytes) -> tuple[int, str, list[tuple[float, float]]]:
    """Stamp (ns, 0 for none), frame and corners (m) of a message of a type of `FOOTPRINTS`.

    Raises:
        ValueError: The data is no such message.
    """
    try:
        message = _parser(kind)(data, kind)
        header, shape = (message.header, message.polygon) if kind == FOOTPRINTS[0] else (None, message)
        points = [(float(point.x), float(point.y)) for point in shape.points]
        return (0, "", points) if header is None else (_stamp(header), header.frame_id, points)
    except Exception as error:
        raise ValueError(f"{kind}: {str(error) or type(error).__name__}") from None


@cache
def _parser(kind: str) -> Callable[[bytes, str], Any]:
    """Reads data of a type of ROS 2; of Nav2's, which rosbags does not know, by its definition."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.LATEST)
    if kind == _SENT and kind not in store.types:
        store.register(get_types_from_msg(_NAVIGATE, "nav2_msgs/msg/Request"))
        store.register(get_types_from_msg(_EVENT.format(package="nav2_msgs"), kind))
    return store.deserialize_cdr


def _pose(header: Any, pose: Any) -> Row:
    return _stamp(header), (pose.position.x, pose.position.y, _heading(pose.orientation)), header.frame_id


def _odometry(header: Any, pose: Any, twist: Any) -> Row:
    stamp, values, frame = _pose(header, pose)
    return stamp, (*values, twist.linear.x, twist.angular.z), frame


def _heading(q: Any) -> float:
    return math.atan2(2.0 * (q.w * q.z + q.x * q.y), q.w**2 + q.x**2 - q.y**2 - q.z**2)


def _command(header: Any, twist: Any) -> Row:
    stamp, frame = (_stamp(header), header.frame_id) if header is not None else (STAMPLESS, "")
    return stamp, (twist.linear.x, twist.angular.z, 0.0), frame


def _stamp(header: Any) -> int:
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec
