"""Network namespaces that end with the processes in them, so that nothing is left behind however a run ends."""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import signal
import subprocess
import threading
from pathlib import Path

__all__ = ["Room", "UnavailableError", "die_with_parent", "enter_private", "ip", "run_ahead"]

_NEW_USER, _NEW_NET, _SET_DEATH_SIGNAL = 0x10000000, 0x40000000, 1  # linux/sched.h, linux/prctl.h


class UnavailableError(OSError):
    """What the testbed needs from the system, and does not get."""


def enter_private() -> None:
    """Moves this process into an empty network namespace of its own, with a user namespace around it if it must.

    From then on it reaches no other network. Call it while the process has one thread: a user namespace asks for that,
    and threads that run already stay where they are.

    Raises:
        UnavailableError: The system does not allow it, or lacks what sets a namespace up.
    """
    if not shutil.which("ip"):
        raise UnavailableError("needs the command `ip` (iproute2), found none")
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        unshare = libc.unshare
    except (OSError, AttributeError):
        raise UnavailableError("needs the network namespaces of Linux") from None
    user, group = os.getuid(), os.getgid()
    if unshare(_NEW_NET) != 0:
        if unshare(_NEW_USER | _NEW_NET) != 0:
            reason = os.strerror(ctypes.get_errno())
            raise UnavailableError(f"needs a network namespace: run as root, or allow user namespaces ({reason})")
        _map_to_root(user, group)
    _without_ipv6()


def _without_ipv6() -> None:
    """For interfaces that are still to come: router solicitations would count as traffic of the middleware."""
    disable = Path("/proc/sys/net/ipv6/conf/default/disable_ipv6")
    if disable.exists():
        disable.write_text("1")


def _map_to_root(user: int, group: int) -> None:
    """Makes the user root of the new user namespace."""
    Path("/proc/self/setgroups").write_text("deny")
    Path("/proc/self/uid_map").write_text(f"0 {user} 1")
    Path("/proc/self/gid_map").write_text(f"0 {group} 1")


class Room:
    """A further network namespace of this process, for what is made inside `with room:`.

    Sockets and threads stay in the namespace of the thread that made them.
    """

    def __init__(self) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._home = _namespace()
        if self._libc.unshare(_NEW_NET) != 0:
            raise UnavailableError(f"needs a network namespace ({os.strerror(ctypes.get_errno())})")
        _without_ipv6()
        self._room = _namespace()
        self._enter(self._home)

    def take_in(self, device: str) -> None:
        """Moves a network device of the process's namespace into the room."""
        ip(f"link set dev {device} netns /proc/{os.getpid()}/fd/{self._room}")

    def __enter__(self) -> None:
        self._enter(self._room)

    def __exit__(self, *_: object) -> None:
        self._enter(self._home)

    def _enter(self, namespace: int) -> None:
        if self._libc.setns(namespace, _NEW_NET) != 0:
            raise UnavailableError(f"setns: {os.strerror(ctypes.get_errno())}")


def _namespace() -> int:
    """That of this thread, as an open file."""
    return os.open(f"/proc/self/task/{threading.get_native_id()}/ns/net", os.O_RDONLY)


def die_with_parent() -> None:
    """Lets the kernel end this process when its parent ends, even by a crash, and leaves Ctrl-C to the parent."""
    ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_ahead(priority: int) -> None:
    """Lets this thread, and those that it starts from now on, run ahead of other processes where it may."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))


def ip(*commands: str) -> None:
    """Runs commands of `ip`, such as "link set dev lo up", in this process's namespace.

    Raises:
        UnavailableError: One fails.
    """
    done = subprocess.run(["ip", "-batch", "-"], input="\n".join(commands), text=True, capture_output=True)
    if done.returncode != 0:
        raise UnavailableError(f"ip: {' '.join(done.stderr.split())}")
