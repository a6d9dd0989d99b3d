"""Messages as bytes, little-endian as in CDR; what tells one from all others on the wire is a part of them."""

from __future__ import annotations

import struct

from experiments.dds_testbed.messages import Command, Message, State

__all__ = ["mark", "pack", "unpack"]

_STATE, _COMMAND = struct.Struct("<qq"), struct.Struct("<qdd")


def mark(message: Message) -> bytes:
    """Sequence number and stamp of a state; the whole of a command."""
    if isinstance(message, State):
        return _STATE.pack(message.sequence, message.uplink_send)
    return _COMMAND.pack(*message)


def pack(message: Message) -> bytes:
    """The bytes of a message."""
    if isinstance(message, Command):
        return mark(message)
    values = [*message.poses, *message.ages]
    return mark(message) + struct.pack(f"<{len(values)}d", *values)


def unpack(data: bytes, state: bool) -> Message:
    """The message of bytes."""
    if not state:
        return Command(*_COMMAND.unpack(data))
    rest = data[_STATE.size :]
    values = struct.unpack(f"<{len(rest) // 8}d", rest)
    robots = len(values) // 4
    return State(*_STATE.unpack_from(data), list(values[: 3 * robots]), list(values[3 * robots :]))
