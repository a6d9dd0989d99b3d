"""Which RTPS submessages of user data a frame carries (OMG DDSI-RTPS 2.5, section 9.4)."""

from __future__ import annotations

import struct
from collections.abc import Iterator

__all__ = ["submessages"]

_ETHERNET, _UDP, _RTPS = 14, 8, 20  # bytes of the headers
_KINDS = {0x06: ("acknacks", 0), 0x07: ("heartbeats", 4), 0x08: ("gaps", 4), 0x15: ("data", 8), 0x16: ("data", 8)}
_BUILT_IN = 0xC0  # in the last byte of an entity's identifier


def submessages(frame: bytes) -> Iterator[str]:
    """Names `data`, `heartbeats`, `gaps` and `acknacks`, one for each submessage of an Ethernet frame.

    Discovery and liveliness are left out, as is all that is no RTPS over UDP. `_KINDS` says where in a submessage the
    identifier of the entity stands that tells the two apart: the reader of an ACKNACK, the writer of the others.
    """
    at = _ETHERNET + 4 * (frame[_ETHERNET] & 0x0F) + _UDP if len(frame) > _ETHERNET else 0
    if frame[at : at + 4] != b"RTPS":
        return
    at += _RTPS
    while at + 4 <= len(frame):
        kind, flags, length = frame[at], frame[at + 1], frame[at + 2 : at + 4]
        size = struct.unpack("<H" if flags & 1 else ">H", length)[0]
        name, offset = _KINDS.get(kind, ("", 0))
        if name and at + 8 + offset <= len(frame) and frame[at + 7 + offset] & _BUILT_IN != _BUILT_IN:
            yield name
        if size == 0:  # the last one may leave its length open
            return
        at += 4 + size
