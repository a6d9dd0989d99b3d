"""What the nodes share: how they begin and end, parameters, QoS and stamps; ROS is imported on use."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from qocjax.ros.parameters import Parameter

__all__ = ["Served", "declared", "from_stamp", "reliable", "serve", "to_stamp"]

_ROS_OWN = ("use_sim_time", "start_type_description_service")  # parameters that every node has


class Served(Protocol):
    """A node at work."""

    def close(self) -> None:
        """Its last words, while it can still publish."""
        ...


def serve(name: str, usage: str, make: Callable[[Any], Served], table: Sequence[Parameter]) -> int:
    """Runs a node until it is interrupted (SIGINT) or terminated (SIGTERM).

    Args:
        name: Of the node, unless it is remapped.
        usage: First lines of the help.
        make: Sets a node of rclpy to work.
        table: Its parameters, for the help.

    Returns:
        Exit status: 0, or 2 after an error, which is one line on standard error.
    """
    if {"-h", "--help"} & set(sys.argv[1:]):
        print(f"{usage}\n\n" + "\n".join(_line(each) for each in table))
        return 0
    try:
        import rclpy
        from rclpy.exceptions import ParameterException
        from rclpy.signals import SignalHandlerOptions
        from rclpy.utilities import remove_ros_args
    except ImportError as error:
        return _fail(
            f"needs ROS 2 ({error}), expected it installed: pip install 'qocjax[ros2]', or source its setup.bash"
        )
    stop = threading.Event()
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, lambda *_: stop.set())
    node = None
    try:
        if rest := remove_ros_args(sys.argv)[1:]:
            raise ValueError(f"got {' '.join(rest)}, expected --ros-args with parameters and topics, or --help")
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node(name)
        served = make(node)
        _spin(node, stop)
        served.close()
    except (ValueError, TypeError, OSError, RuntimeError, ParameterException) as error:
        text = " ".join(str(error).split())
        return _fail(f"got unknown ROS arguments {text}" if text.startswith("[") else text)
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _spin(node: Any, stop: threading.Event) -> None:
    from rclpy.executors import SingleThreadedExecutor

    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop.is_set():
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()


def _fail(text: str) -> int:
    print(f"error: {text}", file=sys.stderr)
    return 2


def _line(each: Parameter) -> str:
    limits = f" ({each.range})" if each.range else ""
    return f"  {each.name}  {each.type}, {each.default!r}: {each.meaning}{limits}"


def declared(node: Any, table: Sequence[Parameter]) -> dict[str, Any]:
    """Declares the parameters of a node, and reads them.

    Raises:
        ValueError: One is given that the node does not have, or one of its own is out of range.
        ParameterException: One is of another type; from rclpy.
    """
    given = node._parameter_overrides  # rclpy says nothing of parameters that nobody declares: a slip would be silent
    known = {each.name for each in table}
    for name in given:
        if name not in known and name not in _ROS_OWN and not name.startswith("qos_overrides."):
            raise ValueError(f"{name}: got an unknown parameter, expected one of {', '.join(sorted(known))}")
    return {each.name: _declare(node, each) for each in table}


def _declare(node: Any, each: Parameter) -> Any:
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
    from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException

    limits: dict[str, Any] = {}
    if each.type == "double":
        limits["floating_point_range"] = [FloatingPointRange(from_value=each.least, to_value=each.most)]
    if each.type == "integer":
        limits["integer_range"] = [IntegerRange(from_value=int(each.least), to_value=int(each.most))]
    words = f"one of {each.range}" if each.choices else ""
    told = ParameterDescriptor(description=each.meaning, additional_constraints=words, read_only=True, **limits)
    given = node._parameter_overrides.get(each.name)
    got = None if given is None else given.value
    try:
        value = node.declare_parameter(each.name, each.default, told).value
    except InvalidParameterTypeException:
        raise ValueError(f"{each.name}: got {got!r}, expected a value of type {each.type}" + (
            f", {float(got)}" if each.type == "double" and isinstance(got, int) else "")) from None  # fmt: skip
    except InvalidParameterValueException:
        raise ValueError(f"{each.name}: got {got!r}, expected {each.range}") from None
    if each.choices and value not in each.choices:
        raise ValueError(f"{each.name}: got {value!r}, expected one of {each.range}")
    return value


def reliable(depth: int) -> dict[str, Any]:
    """Arguments of a publisher or subscription: RELIABLE, KEEP_LAST(depth), and qos_overrides count."""
    from rclpy.qos import QoSProfile
    from rclpy.qos_overriding_options import QoSOverridingOptions

    return {
        "qos_profile": QoSProfile(depth=depth),
        "qos_overriding_options": QoSOverridingOptions.with_default_policies(),
    }


def from_stamp(stamp: Any) -> int:
    """A message's time in ns."""
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def to_stamp(nanoseconds: int) -> Any:
    """A time in ns as a message's."""
    from builtin_interfaces.msg import Time

    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)
