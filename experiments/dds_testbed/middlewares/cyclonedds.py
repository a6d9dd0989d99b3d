"""Eclipse Cyclone DDS: a domain for each robot, one writer and one reader in it."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

from cyclonedds.core import DDSException, InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from experiments.dds_testbed.link import ROBOT, address, configure
from experiments.dds_testbed.messages import Command, Message, Received, State
from experiments.dds_testbed.middlewares.cyclone_types import IdlCommand, IdlState
from experiments.dds_testbed.middlewares.packed import mark
from experiments.dds_testbed.plan import Plan

__all__ = ["Ends"]

_LIBRARY = 0x7FFF0100  # DDS_CYCLONEDDS_HANDLE: what owns a waitset over several domains

# One interface, one peer, no multicast.
_DOMAIN = """<CycloneDDS><Domain id="any">
  <General>
    <Interfaces><NetworkInterface name="radio{link}"/></Interfaces><AllowMulticast>false</AllowMulticast>
  </General>
  <Discovery>
    <ParticipantIndex>0</ParticipantIndex>{lease}
    <Peers><Peer address="{peer}:{port}"/></Peers>
  </Discovery>
</Domain></CycloneDDS>"""


def _discovery_port(domain: int) -> int:
    """Unicast port for discovery of the first participant of a domain (OMG DDSI-RTPS 2.5, section 9.6.2)."""
    return 7400 + 250 * domain + 10


class Endpoint:
    """What one side writes to and reads from for one robot."""

    def __init__(self, plan: Plan, link: int, side: int) -> None:
        given = plan.options["lease"]
        lease = "" if given is None else f"<LeaseDuration>{given:g}s</LeaseDuration>"
        peer = {"peer": address(link, 1 - side), "port": _discovery_port(link)}
        self._domain = Domain(link, _DOMAIN.format(link=link, lease=lease, **peer))
        self._participant = DomainParticipant(link)
        state = Topic(self._participant, "state", IdlState)
        command = Topic(self._participant, "command", IdlCommand)
        sent, received = (state, command) if side == ROBOT else (command, state)
        self._writer = DataWriter(self._participant, sent, qos=_qos(plan))
        self._reader = DataReader(self._participant, received, qos=_qos(plan))
        self.unread = ReadCondition(self._reader, SampleState.Any | ViewState.Any | InstanceState.Any)

    def matched(self) -> bool:
        """Whether writer and reader have found the other side's."""
        return bool(self._writer.get_matched_subscriptions() and self._reader.get_matched_publications())

    def write(self, message: Message) -> None:
        """Sends a message, unless the writer would have to wait for room: robots and edge wait for nothing."""
        try:
            self._writer.write(IdlState(*message[:4]) if isinstance(message, State) else IdlCommand(*message))
        except DDSException as error:
            if error.code != DDSException.DDS_RETCODE_TIMEOUT:  # KEEP_ALL, and too much is not acknowledged
                raise

    def take(self) -> list[Message]:
        """Takes the messages that have arrived, oldest first; samples without data say that a writer ended."""
        return [_plain(each) for each in self._reader.take(N=64) if each.sample_info.valid_data]


def _qos(plan: Plan) -> Qos:
    reliable, best_effort = Policy.Reliability.Reliable(duration(seconds=0)), Policy.Reliability.BestEffort
    history = Policy.History.KeepAll if plan.depth is None else Policy.History.KeepLast(plan.depth)
    policies = [reliable if plan.reliable else best_effort, history, Policy.Durability.Volatile]
    if plan.lifespan is not None:
        policies.append(Policy.Lifespan(duration(nanoseconds=round(plan.lifespan * 1e9))))
    return Qos(*policies)


def _plain(sample: Any) -> Message:
    if isinstance(sample, IdlState):
        return State(sample.sequence, sample.uplink_send, list(sample.poses), list(sample.ages))
    return Command(sample.sequence, sample.nu, sample.omega)


class Ends:
    """The ends of one side, which wait for messages without a thread of Python in the middleware's way."""

    def __init__(self, plan: Plan, side: int) -> None:
        for link in range(plan.num_robots):
            configure(link, side)
        self._endpoints = [Endpoint(plan, link, side) for link in range(plan.num_robots)]
        self._waitset = WaitSet(SimpleNamespace(_ref=_LIBRARY))
        for endpoint in self._endpoints:
            self._waitset.attach(endpoint.unread)

    def matched(self) -> bool:
        """Whether every endpoint has found the other side's."""
        return all(endpoint.matched() for endpoint in self._endpoints)

    def begin(self, start: int) -> None:
        """Nothing depends on when the run begins."""

    def write(self, robot: int, message: Message) -> None:
        """Sends a message."""
        self._endpoints[robot].write(message)

    def take(self, nanoseconds: int) -> list[Received]:
        """Takes what has arrived, as soon as something has."""
        self._waitset.wait(max(nanoseconds, 0))
        found = []
        for robot, endpoint in enumerate(self._endpoints):
            stamp = time.monotonic_ns()
            found += [Received(robot, message, stamp, mark(message)) for message in endpoint.take()]
        return found

    def close(self) -> None:
        """The threads end with the process."""
