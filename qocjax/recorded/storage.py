"""What the storage formats of rosbag2 have in common: channels, messages, and an account of what a file promises."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Protocol

__all__ = ["Channel", "Message", "StorageFile"]

Message = tuple[int, int, bytes]
"""Number of the channel, record time (ns), data."""


@dataclass(frozen=True)
class Channel:
    """What one writer put into a file under a topic's name; a topic may have several, also of different types."""

    name: str
    kind: str  # message type, such as geometry_msgs/msg/Twist
    encoding: str  # of the data; cdr is ROS 2's
    profile: str  # offered QoS as YAML; empty where it does not say


class StorageFile(Protocol):
    """One file of a bag."""

    name: str  # how the file is called in findings
    channels: dict[int, Channel]
    promised: dict[int, int] | None  # messages by channel; None where the file does not say
    total: int | None  # messages of all channels, as an index or statistics say
    lost: int  # messages of any channel that are there and could not be read, as far as is known after reading

    def messages(self, numbers: Collection[int]) -> Iterator[Message]:
        """Yields the messages of some channels in the order in which they were written."""
        ...

    def close(self) -> None:
        """Removes what was written to read the file."""
        ...
