"""What records of MCAP say of the others: channels, how many messages each has, and which chunks hold them."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

from qocjax.recorded.records import CHANNEL, SCHEMA
from qocjax.recorded.storage import Channel

__all__ = ["Contents", "text_at"]

_STATISTICS, _CHUNK_INDEX = 0x0B, 0x08
_PROFILE = "offered_qos_profiles"


@dataclass
class Contents:
    """What a summary, or a walk through the file, says of it."""

    schemas: dict[int, str] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    promised: dict[int, int] | None = None
    chunks: dict[int, frozenset[int]] = field(default_factory=dict)  # channels of the chunk at a place
    complete: bool = False  # whether all channels are known

    def take(self, code: int, data: bytes) -> bool:
        """Takes up a record that says something of others; returns whether it is whole."""
        try:
            if code == SCHEMA:
                self.schemas[struct.unpack_from("<H", data)[0]] = text_at(data, 2)[0]
            elif code == CHANNEL:
                number, schema = struct.unpack_from("<HH", data)
                name, place = text_at(data, 4)
                encoding, place = text_at(data, place)
                self.channels[number] = Channel(name, self.schemas.get(schema, ""), encoding, _profile(data, place))
            elif code == _STATISTICS:
                self._statistics(data)
            elif code == _CHUNK_INDEX:
                (size,) = struct.unpack_from("<I", data, 32)
                self.chunks[struct.unpack_from("<Q", data, 16)[0]] = frozenset(
                    number for number, _ in struct.iter_unpack("<HQ", data[36 : 36 + size])
                )
        except (struct.error, IndexError):
            return False
        return True

    def _statistics(self, data: bytes) -> None:
        (channels,) = struct.unpack_from("<I", data, 10)
        (size,) = struct.unpack_from("<I", data, 42)
        self.promised = dict(struct.iter_unpack("<HQ", data[46 : 46 + size]))
        self.complete = channels == len(self.channels) and self.promised.keys() <= self.channels.keys()


def text_at(data: bytes, place: int) -> tuple[str, int]:
    """A text with its length before it, and the place behind it; an IndexError where it ends early."""
    (size,) = struct.unpack_from("<I", data, place)
    end = place + 4 + size
    if end > len(data):
        raise IndexError("text ends early")
    return data[place + 4 : end].decode("utf-8", "replace"), end


def _profile(data: bytes, place: int) -> str:
    """The offered QoS among a channel's remarks."""
    (size,) = struct.unpack_from("<I", data, place)
    end = place + 4 + size
    place += 4
    while place < end:
        key, place = text_at(data, place)
        value, place = text_at(data, place)
        if key == _PROFILE:
            return value
    return ""
