"""Eclipse Cyclone DDS at one end of the links: a domain, a writer and a reader for each robot."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

from cyclonedds.core import InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from experiments.dds_testbed.link import ROBOT, address
from experiments.dds_testbed.messages import Command, State

__all__ = ["Endpoint", "Inbox"]

_LIBRARY = 0x7FFF0100  # DDS_CYCLONEDDS_HANDLE: what owns a waitset over several domains

# One interface, one peer, no multicast. The lease outlasts a run, so that nothing is discovered again within it.
_DOMAIN = """<CycloneDDS><Domain id="any">
  <General>
    <Interfaces><NetworkInterface name="radio{link}"/></Interfaces><AllowMulticast>false</AllowMulticast>
  </General>
  <Discovery>
    <ParticipantIndex>0</ParticipantIndex><LeaseDuration>600s</LeaseDuration>
    <Peers><Peer address="{peer}:{port}"/></Peers>
  </Discovery>
</Domain></CycloneDDS>"""


def _discovery_port(domain: int) -> int:
    """Unicast port for discovery of the first participant of a domain (OMG DDSI-RTPS 2.5, section 9.6.2)."""
    return 7400 + 250 * domain + 10


class Endpoint:
    """What one side writes to and reads from for one robot."""

    def __init__(self, link: int, side: int, reliable: bool, depth: int) -> None:
        peer = {"peer": address(link, 1 - side), "port": _discovery_port(link)}
        self._domain = Domain(link, _DOMAIN.format(link=link, **peer))
        self._participant = DomainParticipant(link)
        reliability = Policy.Reliability.Reliable(duration(seconds=1)) if reliable else Policy.Reliability.BestEffort
        qos = Qos(reliability, Policy.History.KeepLast(depth), Policy.Durability.Volatile)
        state = Topic(self._participant, "state", State)
        command = Topic(self._participant, "command", Command)
        sent, received = (state, command) if side == ROBOT else (command, state)
        self._writer = DataWriter(self._participant, sent, qos=qos)
        self._reader = DataReader(self._participant, received, qos=qos)
        self.unread = ReadCondition(self._reader, SampleState.Any | ViewState.Any | InstanceState.Any)

    def matched(self) -> bool:
        """Whether writer and reader have found the other side's."""
        return bool(self._writer.get_matched_subscriptions() and self._reader.get_matched_publications())

    def write(self, message: Any) -> None:
        """Sends a message."""
        self._writer.write(message)

    def take(self) -> list[Any]:
        """Takes the messages that have arrived, oldest first."""
        return [
            each for each in self._reader.take(N=64) if each.sample_info.valid_data
        ]  # others say that a writer ended


class Inbox:
    """Waits for messages at any endpoint, without a thread of Python in the middleware's way."""

    def __init__(self, endpoints: Sequence[Endpoint]) -> None:
        self._waitset = WaitSet(SimpleNamespace(_ref=_LIBRARY))
        for endpoint in endpoints:
            self._waitset.attach(endpoint.unread)

    def wait(self, nanoseconds: int) -> None:
        """Returns as soon as a message is there, or after a time."""
        self._waitset.wait(max(nanoseconds, 0))
