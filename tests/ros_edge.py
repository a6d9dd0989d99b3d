"""A controller as a process of its own, which stamps nothing: Odometry in, plain Twist out, to a goal at (1, 0.5)."""

from __future__ import annotations

import math
import time

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("edge")
    out = node.create_publisher(Twist, "cmd_vel_plain", 1)

    def answer(odometry: Odometry) -> None:
        place, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
        x, y = 1.0 - place.x, 0.5 - place.y
        error = math.remainder(math.atan2(y, x) - 2.0 * math.atan2(turn.z, turn.w), math.tau)
        time.sleep(0.005)
        command = Twist()
        command.linear.x = min(0.5, math.hypot(x, y)) * max(math.cos(error), 0.0)
        command.angular.z = max(-1.0, min(1.0, error))
        out.publish(command)

    node.create_subscription(Odometry, "odom", answer, 1)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
