"""The links between robots and edge: for each robot one interface on either side, whose frames the emulator carries.

With a TAP device the kernel hands the frames of an interface to whoever opened it. Where a user may not open
/dev/net/tun, a pair of virtual Ethernet devices takes its place: one end is the interface, and the emulator reads and
writes the other through a packet socket.
"""

from __future__ import annotations

import fcntl
import os
import socket
import struct
from dataclasses import dataclass

from experiments.dds_testbed.namespaces import UnavailableError, ip

__all__ = ["EDGE", "ROBOT", "SIDES", "Port", "address", "configure", "open_tap", "open_veth", "tap_usable"]

ROBOT, EDGE = SIDES = (0, 1)

_TUN, _TUNSETIFF, _TAP, _NO_PACKET_INFO = "/dev/net/tun", 0x400454CA, 0x0002, 0x1000  # linux/if_tun.h
_SOL_PACKET, _VNET_HEADER, _IPV4 = 263, 15, 0x0800  # linux/if_packet.h, linux/if_ether.h
_VNET_HEADER_SIZE = 10  # bytes; says which checksums the kernel has left open


@dataclass(frozen=True)
class Port:
    """Where the emulator reads and writes the frames of one interface."""

    fd: int
    link: int
    side: int
    header: int  # bytes before each frame


def address(link: int, side: int) -> str:
    """IPv4 address of one end."""
    return f"10.77.{link}.{side + 1}"


def _hardware(link: int, side: int) -> str:
    return f"02:00:00:77:{link:02x}:{side + 1:02x}"


def configure(link: int, side: int, subnet: int | None = None) -> None:
    """Brings up `radio<link>` of one side; the peer's hardware address is given, so none is asked for.

    Args:
        link: Which.
        side: Which end of it.
        subnet: Whose addresses it gets; None for its own.
    """
    subnet = link if subnet is None else subnet
    ip(
        "link set dev lo up",
        f"link set dev radio{link} address {_hardware(link, side)}",
        f"address add {address(subnet, side)}/24 dev radio{link}",
        f"link set dev radio{link} up",
        f"neighbour add {address(subnet, 1 - side)} lladdr {_hardware(link, 1 - side)} dev radio{link} nud permanent",
    )


def tap_usable() -> bool:
    """Whether this process may open TAP devices."""
    return os.access(_TUN, os.R_OK | os.W_OK)


def open_tap(link: int) -> int:
    """Makes the interface `radio<link>` in this namespace and returns the file descriptor of its frames."""
    try:
        fd = os.open(_TUN, os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(fd, _TUNSETIFF, struct.pack("16sH22x", f"radio{link}".encode(), _TAP | _NO_PACKET_INFO))
    except OSError as error:
        raise UnavailableError(f"needs a TAP device: {_TUN}: {error.strerror}") from None
    return fd


def open_veth(link: int, side: int, process: int) -> Port:
    """Makes `radio<link>` in the namespace of another process, and a port at its peer in this one."""
    name = f"hub{link}{'re'[side]}"
    ip(f"link add {name} type veth peer name radio{link} netns {process}", f"link set dev {name} up")
    end = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_IPV4))
    end.bind((name, _IPV4))
    end.setsockopt(_SOL_PACKET, _VNET_HEADER, 1)
    end.setblocking(False)
    return Port(end.detach(), link, side, _VNET_HEADER_SIZE)
