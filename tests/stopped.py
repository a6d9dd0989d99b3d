"""Commands in sessions of their own that are stopped at some moment, and what is left of them."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

CODES = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}
LISTENS = Path("/proc/self/status").is_file()  # whether one can see that a process listens to signals


@dataclass(frozen=True)
class Stop:
    """How a command ended."""

    code: int
    took: float  # s from the signal on
    err: str
    left: list[int]  # its processes two seconds after the signal


def stop(
    command: Sequence[str], env: Mapping[str, str], after: float, number: signal.Signals, *, times: int = 1,
    group: bool = False,
) -> Stop | None:  # fmt: skip
    """Stops a command some seconds after it has begun to listen to signals; None where it is done before.

    Args:
        command: What to run.
        env: Its environment.
        after: s.
        number: What it is sent.
        times: How often, a twentieth of a second apart.
        group: Whether all processes get it, as from a terminal.
    """
    process = subprocess.Popen(
        command, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    with process:
        try:
            return _stopped(process, after, number, times, os.killpg if group else os.kill)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def _stopped(
    process: subprocess.Popen[str], after: float, number: signal.Signals, times: int, send: Callable[[int, int], None]
) -> Stop | None:
    assert process.stderr is not None
    while process.poll() is None and not _listens(process.pid):
        time.sleep(0.002)
    with suppress(subprocess.TimeoutExpired):
        process.wait(after)
        assert process.returncode == 0, process.stderr.read()
        return None
    begun = time.monotonic()
    for _ in range(times):
        with suppress(ProcessLookupError):
            send(process.pid, number)
        time.sleep(0.05 if times > 1 else 0)
    process.wait(60)
    took = time.monotonic() - begun
    while time.monotonic() < begun + 2 and session(process.pid):
        time.sleep(0.02)
    left = session(process.pid)
    for each in left:  # they may hold what is read next
        os.kill(each, signal.SIGKILL)
    return Stop(process.returncode, took, process.stderr.read(), left)


@pytest.fixture
def not_ignored() -> Iterator[None]:
    """What is started hears each signal, also where these tests run in the background, which ignores some."""
    ignored = [number for number in CODES if signal.getsignal(number) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, signal.SIG_DFL)
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


def session(leader: int) -> list[int]:
    """Processes that run in a session."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, _, where, *_ = status.read_text(encoding="utf-8").rpartition(")")[2].split()
            if int(where) == leader and state != "Z":
                found.append(int(status.parent.name))
    return found


def resident(process: int) -> float:
    """Memory of a process in MB."""
    with suppress(OSError):
        for line in Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1]) / 1e3
    return 0.0


def _listens(process: int) -> bool:
    """Whether a process has a way of its own to take SIGTERM."""
    with suppress(OSError):
        for line in Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines():
            if line.startswith("SigCgt:"):
                return bool(int(line.split()[1], 16) >> (signal.SIGTERM - 1) & 1)
    return False
