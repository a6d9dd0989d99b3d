"""ROS 2 over eProsima Fast DDS: nodes of rclpy with rmw_fastrtps_cpp, a context and a domain for each robot.

Every message is one of ROS's own. At a sampling instant a robot publishes, in this order,

    /robot0/states     nav_msgs/Path: where each robot is; a pose's own stamp is that of the state from which the
                       command in force of its robot was computed, so its age is the difference of the two stamps
    /robot0/amcl_pose  geometry_msgs/PoseWithCovarianceStamped of this robot, and
    /robot0/odom       nav_msgs/Odometry, with the speeds in force: both as a robot with Nav2 sends them, and read by
                       the edge, whose navigation stack looks at the speeds

and the edge answers `states` with `/robot0/cmd_vel`, geometry_msgs/TwistStamped, which has its stamp. All stamps are
sampling instants, so they tell the sequence number.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path as File
from typing import Any

from experiments.dds_testbed.link import ROBOT, address, configure
from experiments.dds_testbed.messages import Command, Message, Received, State
from experiments.dds_testbed.middlewares.arrivals import Arrivals
from experiments.dds_testbed.middlewares.fastdds_profile import profile
from experiments.dds_testbed.middlewares.ros_messages import FRAME, fill_path, fill_pose, fill_twist, mark_of, placed
from experiments.dds_testbed.namespaces import Room
from experiments.dds_testbed.plan import Plan
from qocjax.ros.node import from_stamp, to_stamp

__all__ = ["Ends"]

_SUBNET = 0
_SWITCH = 1e-4  # s, after which a thread of rclpy gives way to the loop


class Ends:
    """The ends of one side: a node for each robot, in a network namespace with nothing but its link.

    rmw_fastrtps takes one profile for all participants of a process and would send the messages of each over every
    interface, so each has but one; and it reads the addresses once, so these are the same in all of them.
    """

    def __init__(self, plan: Plan, side: int) -> None:
        self._plan, self._side, self._start = plan, side, 0
        self._arrivals, self._ended = Arrivals(), threading.Event()
        file = File(plan.folder) / f"fastdds_{side}.xml"
        file.write_text(profile(address(_SUBNET, 1 - side), **plan.options), encoding="utf-8")
        os.environ |= {
            "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
            "FASTDDS_DEFAULT_PROFILES_FILE": str(file),
            "ROS_LOG_DIR": plan.folder,
        }  # fmt: skip
        sys.setswitchinterval(_SWITCH)
        self._robots = [self._robot(link) for link in range(plan.num_robots)]
        self._threads = [threading.Thread(target=self._spin, args=(each,), daemon=True) for each in self._robots]
        for thread in self._threads:
            thread.start()

    def _robot(self, link: int) -> _Robot:
        room = Room()
        room.take_in(f"radio{link}")
        with room:
            configure(link, self._side, _SUBNET)
            return _Robot(self._plan, link, self._side, self._arrivals)

    def _spin(self, robot: _Robot) -> None:
        while not self._ended.is_set():
            robot.executor.spin_once(timeout_sec=0.05)

    def matched(self) -> bool:
        """Whether every publisher has found its subscription."""
        return all(each.matched() for each in self._robots)

    def begin(self, start: int) -> None:
        """Stamps count from there."""
        self._start = start

    def write(self, robot: int, message: Message) -> None:
        """Publishes what a message says."""
        stamp = self._start + message.sequence * self._plan.tau
        self._robots[robot].write(stamp, message)

    def take(self, nanoseconds: int) -> list[Received]:
        """Takes what has arrived, as soon as something has."""
        for each in self._robots:
            each.accompany()
        return [self._received(*arrival) for arrival in self._arrivals.take(nanoseconds)]

    def _received(self, robot: int, content: Any, stamp: int) -> Received:
        source = from_stamp(content.header.stamp)
        sequence = round((source - self._start) / self._plan.tau)
        if self._side == ROBOT:
            command = Command(sequence, content.twist.linear.x, content.twist.angular.z)
            return Received(robot, command, stamp, mark_of(content))
        poses = [value for each in content.poses for value in placed(each.pose)]
        ages = [1e-9 * (source - from_stamp(each.header.stamp)) for each in content.poses]
        state = State(sequence, source, poses, ages, self._robots[robot].speeds)
        return Received(robot, state, stamp, mark_of(content))

    def close(self) -> None:
        """Ends the nodes."""
        self._ended.set()
        for thread in self._threads:
            thread.join()
        for each in self._robots:
            each.close()


class _Robot:
    """The node of one robot on one side."""

    def __init__(self, plan: Plan, link: int, side: int, arrivals: Arrivals) -> None:
        import rclpy
        from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
        from nav_msgs.msg import Odometry, Path
        from rclpy.executors import SingleThreadedExecutor

        self._context = rclpy.Context()
        self._context.init([], domain_id=link)
        self._node = rclpy.create_node(
            "qocjax", context=self._context, namespace=f"robot{link}", enable_rosout=False,
            start_parameter_services=False,
        )  # fmt: skip
        up = {"states": Path, "amcl_pose": PoseWithCovarianceStamped, "odom": Odometry}
        down = {"cmd_vel": TwistStamped}
        sent, received = (up, down) if side == ROBOT else (down, up)
        qos = _qos(plan)
        self._publishers = {name: (self._node.create_publisher(kind, name, qos), kind()) for name, kind in sent.items()}
        self._link = link
        self._waiting: tuple[int, State] | None = None  # what pose and odometry are of
        self.speeds = (0.0, 0.0)  # nu, omega of the newest odometry
        for name, kind in received.items():
            callback = {"odom": self._hear, "amcl_pose": lambda message: None}.get(name, partial(arrivals.put, link))
            self._node.create_subscription(kind, name, callback, qos)
        self.executor = SingleThreadedExecutor(context=self._context)
        self.executor.add_node(self._node)

    def _hear(self, odometry: Any) -> None:
        twist = odometry.twist.twist
        self.speeds = twist.linear.x, twist.angular.z

    def matched(self) -> bool:
        """Whether every publisher has found its subscription."""
        return all(each.get_subscription_count() for each, _ in self._publishers.values())

    def write(self, stamp: int, message: Message) -> None:
        """Publishes what the loop needs; what goes with it waits until all robots have sent that."""
        if isinstance(message, Command):
            self._publish("cmd_vel", stamp, lambda to: fill_twist(to.twist, (message.nu, message.omega)))
            return
        self._publish("states", stamp, lambda to: fill_path(to, stamp, message.poses, message.ages))
        self._waiting = stamp, message

    def accompany(self) -> None:
        """Publishes pose and odometry of the last state."""
        if self._waiting is None:
            return
        (stamp, state), self._waiting = self._waiting, None
        place = state.poses[3 * self._link : 3 * self._link + 3]
        self._publish("amcl_pose", stamp, lambda to: fill_pose(to.pose.pose, place))
        self._publish(
            "odom", stamp, lambda to: (fill_pose(to.pose.pose, place), fill_twist(to.twist.twist, state.speeds))
        )

    def _publish(self, topic: str, stamp: int, fill: Callable[[Any], Any]) -> None:
        publisher, message = self._publishers[topic]
        message.header.stamp, message.header.frame_id = to_stamp(stamp), FRAME
        fill(message)
        publisher.publish(message)

    def close(self) -> None:
        """Ends the node."""
        self.executor.shutdown()
        self._node.destroy_node()
        self._context.shutdown()


def _qos(plan: Plan) -> Any:
    from rclpy.duration import Duration
    from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

    profile = QoSProfile(
        history=HistoryPolicy.KEEP_ALL if plan.depth is None else HistoryPolicy.KEEP_LAST, depth=plan.depth or 0,
        reliability=ReliabilityPolicy.RELIABLE if plan.reliable else ReliabilityPolicy.BEST_EFFORT,
    )  # fmt: skip
    if plan.lifespan is not None:
        profile.lifespan = Duration(nanoseconds=round(plan.lifespan * 1e9))
    return profile
