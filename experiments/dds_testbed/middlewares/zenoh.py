"""Eclipse Zenoh, as rmw_zenoh uses it: a session for each robot, one publisher and one subscriber in it.

rmw_zenoh sends KEEP_ALL with congestion control `block` and all else with `drop`, and asks for a transport of its
publisher's reliability. Its default transport is TCP, over which a best-effort message is repaired like any other; with
`udp` what is lost stays lost, whatever the QoS. The depth is that of a queue that here is emptied at once.
"""

from __future__ import annotations

import json
from typing import Any

import zenoh

from experiments.dds_testbed.link import EDGE, ROBOT, address, configure
from experiments.dds_testbed.messages import Message, Received
from experiments.dds_testbed.middlewares.arrivals import Arrivals
from experiments.dds_testbed.middlewares.packed import mark, pack, unpack
from experiments.dds_testbed.plan import Plan

__all__ = ["Ends"]

_PORT = 7447


def _config(plan: Plan, link: int, side: int) -> Any:
    """A peer that knows one other and looks for nobody: the edge listens, the robot connects."""
    place = [f"{plan.options['protocol']}/{address(link, EDGE)}:{_PORT}"]
    values = {
        "mode": "peer", "listen/endpoints": place if side == EDGE else [],
        "connect/endpoints": place if side == ROBOT else [], "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False, "transport/shared_memory/enabled": False,
    }  # fmt: skip
    config = zenoh.Config()
    for name, value in values.items():
        config.insert_json5(name, json.dumps(value))
    return config


class Ends:
    """The ends of one side."""

    def __init__(self, plan: Plan, side: int) -> None:
        self._of_states, self._arrivals = side == EDGE, Arrivals()
        self._sessions, self._publishers, self._subscribers = [], [], []
        for link in range(plan.num_robots):
            configure(link, side)
        for link in range(plan.num_robots):
            session = zenoh.open(_config(plan, link, side))
            names = (f"robot{link}/state", f"robot{link}/command")
            sent, received = names if side == ROBOT else reversed(names)
            self._publishers.append(session.declare_publisher(sent, **_qos(plan)))
            self._subscribers.append(session.declare_subscriber(received, self._listener(link)))
            self._sessions.append(session)

    def _listener(self, robot: int) -> Any:
        return lambda sample: self._arrivals.put(robot, sample.payload.to_bytes())

    def matched(self) -> bool:
        """Whether every publisher has found its subscriber."""
        return all(publisher.matching_status.matching for publisher in self._publishers)

    def begin(self, start: int) -> None:
        """Nothing depends on when the run begins."""

    def write(self, robot: int, message: Message) -> None:
        """Sends a message."""
        self._publishers[robot].put(pack(message))

    def take(self, nanoseconds: int) -> list[Received]:
        """Takes what has arrived, as soon as something has."""
        found = []
        for robot, content, stamp in self._arrivals.take(nanoseconds):
            message = unpack(content, self._of_states)
            found.append(Received(robot, message, stamp, mark(message)))
        return found

    def close(self) -> None:
        """Ends the sessions."""
        for session in self._sessions:
            session.close()


def _qos(plan: Plan) -> dict[str, Any]:
    block = plan.options["congestion"] == "block"
    return {
        "reliability": zenoh.Reliability.RELIABLE if plan.reliable else zenoh.Reliability.BEST_EFFORT,
        "congestion_control": zenoh.CongestionControl.BLOCK if block else zenoh.CongestionControl.DROP,
        "express": plan.options["express"],
    }
