"""The emulator with the two processes that it serves, from their start to their end."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from experiments.dds_testbed.crossing import Crossed
from experiments.dds_testbed.link import EDGE, ROBOT, SIDES, Port, open_veth
from experiments.dds_testbed.plan import Plan, receive, send
from experiments.dds_testbed.radio import Radio
from experiments.dds_testbed.relay import Relay, raise_priority

__all__ = ["Hub", "Traffic"]

_ROOT = Path(__file__).resolve().parents[2]
_NAMES = ("robot", "edge")
_PATIENCE = 60.0  # s, for a side to start, to match or to end
_HEAD_START = 0.1  # s, between the match and the first loop of the warm-up


@dataclass(frozen=True)
class Traffic:
    """What the emulator saw of a run."""

    start: int  # ns, first sampling instant
    lateness: list[int]  # ns, of each frame
    sent: list[Counter[str]]  # by each side, in frames, bytes and submessages
    crossed: list[Crossed]  # every frame that was delivered while there was a radio


class Hub:
    """Starts the two sides, carries their frames, and ends them in any case: `with Hub(plan) as hub`."""

    def __init__(self, plan: Plan) -> None:
        self._plan, path = plan, plan.write()
        self._channels: list[socket.socket] = []
        self._processes: list[subprocess.Popen[bytes]] = []
        self._ports: list[Port] = []
        self._said: set[tuple[int, str]] = set()
        for name in _NAMES:
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            command = [sys.executable, "-m", f"experiments.dds_testbed.{name}", str(path), str(theirs.fileno())]
            self._channels.append(ours)
            self._processes.append(subprocess.Popen(command, pass_fds=[theirs.fileno()], cwd=_ROOT, env=_environment()))
            theirs.close()

    def __enter__(self) -> Hub:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes:
            process.kill()
            process.wait()
        for port in self._ports:
            os.close(port.fd)
        for channel in self._channels:
            channel.close()

    def run(self, radio: Radio, in_order: bool, say: Callable[[str], None]) -> Traffic:
        """Carries one run: unimpaired until both sides have found each other, under the radio from then on.

        Raises:
            OSError: A side ended early, or did not answer in time.
        """
        relay = Relay(self._open_ports(), in_order)
        begin = time.monotonic()
        self._carry(relay, "matched", SIDES)
        say(f"both sides have found each other after {time.monotonic() - begin:.1f} s")
        raise_priority()
        relay.radio = radio
        padding, tau = self._plan.padding, self._plan.tau
        start = time.monotonic_ns() + round(_HEAD_START * 1e9) + padding[0] * tau
        radio.silent(*(start + round(time * 1e9) for time in self._plan.outage))
        for channel in self._channels:
            send(channel, start=start)
        relay.run(start, self._watched())
        before, relay.lateness = relay.snapshot(), []
        relay.run(start + round(self._plan.horizon * 1e9), self._watched())
        sent = [Counter(now) - then for now, then in zip(relay.snapshot(), before, strict=True)]
        lateness = relay.lateness
        self._carry(relay, "done", [ROBOT], extra=(padding[1] + 1) * tau * 1e-9)
        send(self._channels[EDGE], stop=True)
        self._carry(relay, "done", [EDGE])
        for channel in self._channels:
            send(channel, end=True)
        return Traffic(start, lateness, sent, relay.crossed)

    def _open_ports(self) -> list[Port]:
        """Waits for the two sides and opens the ports of their links."""
        for side, channel in enumerate(self._channels):
            channel.settimeout(_PATIENCE)
            try:
                _, files = receive(channel)
            except (TimeoutError, ConnectionError):
                raise OSError(f"the process of the {_NAMES[side]} did not come up") from None
            self._ports += [Port(fd, link, side, 0) for link, fd in enumerate(files)]
            if not self._plan.tap:
                process = self._processes[side].pid
                self._ports += [open_veth(link, side, process) for link in range(self._plan.num_robots)]
        for channel in self._channels:
            send(channel, connected=True)
        return self._ports

    def _carry(self, relay: Relay, word: str, sides: list[int] | tuple[int, ...], extra: float = 0.0) -> None:
        """Carries frames until each of the sides has said a word."""
        latest = time.monotonic() + _PATIENCE + extra

        def heard() -> bool:
            if time.monotonic() > latest:
                raise OSError(f"{' or '.join(_NAMES[side] for side in sides)}: not {word} within {_PATIENCE:g} s")
            return all((side, word) in self._said for side in sides)

        relay.run(heard, self._watched())

    def _watched(self) -> list[tuple[int, Callable[[], None]]]:
        return [(self._channels[side].fileno(), partial(self._hear, side)) for side in SIDES]

    def _hear(self, side: int) -> None:
        try:
            message, _ = receive(self._channels[side])
        except ConnectionError:
            status = self._processes[side].wait(_PATIENCE)
            raise OSError(f"the process of the {_NAMES[side]} ended early, with exit status {status}") from None
        self._said |= {(side, word) for word in message}


def _environment() -> dict[str, str]:
    """One thread for each process's arithmetic: there is little of it, and cores are few."""
    return os.environ | {
        "JAX_PLATFORMS": "cpu", "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false", "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }  # fmt: skip
