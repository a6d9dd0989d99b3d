"""What robots and edge are told of a run, as a file; and what they and the emulator say to each other meanwhile."""

from __future__ import annotations

import json
import socket
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from qocjax.network.schedule import Rules
from qocjax.scenario import Design, num_ticks

__all__ = ["Plan", "receive", "send"]


@dataclass(frozen=True)
class Plan:
    """One run, in plain values; SI units."""

    start: list[list[float]]
    goal: list[float] | list[list[float]]
    horizon: float
    design: dict[str, float]
    rules: dict[str, Any]  # of actuation and hold
    middleware: str
    options: dict[str, Any]  # of this middleware alone
    reliable: bool
    depth: int | None  # None for KEEP_ALL
    lifespan: float | None  # s, None for none
    warm_up: float  # s of loops before the robots' first sample
    cool_down: float  # s of loops after the last
    outage: tuple[float, float]  # s from the first sample: begin and end of a time without radio
    tap: bool  # whether a side opens its own interfaces
    folder: str  # where the records go, with the compute times

    @property
    def num_robots(self) -> int:
        """N."""
        return len(self.start)

    @property
    def tau(self) -> int:
        """Sampling period (ns)."""
        return round(self.design["tau"] * 1e9)

    @property
    def num_ticks(self) -> int:
        """Sampling instants P of the run itself."""
        return num_ticks(self.horizon, self.design["tau"])

    @property
    def padding(self) -> tuple[int, int]:
        """Loops before and after."""
        return num_ticks(self.warm_up, self.design["tau"]), num_ticks(self.cool_down, self.design["tau"])

    def as_rules(self) -> Rules:
        """The rules."""
        return Rules(**self.rules)

    def as_design(self) -> Design:
        """The design."""
        return Design(**self.design)

    def write(self) -> Path:
        """Writes the plan into its folder."""
        path = Path(self.folder) / "plan.json"
        path.write_text(json.dumps(asdict(self)), encoding="utf-8")
        return path

    @classmethod
    def read(cls, path: str) -> Plan:
        """Reads it there."""
        return cls(**json.loads(Path(path).read_text(encoding="utf-8")))


def send(channel: socket.socket, files: list[int] | None = None, **message: Any) -> None:
    """Sends a message between the emulator and a side, with open files if there are any."""
    socket.send_fds(channel, [json.dumps(message).encode()], files or [])


def receive(channel: socket.socket) -> tuple[dict[str, Any], list[int]]:
    """Receives one, with the open files that came with it.

    Raises:
        ConnectionError: The other end is gone.
    """
    text, files, _, _ = socket.recv_fds(channel, 4096, 16)
    if not text:
        raise ConnectionError("the other end is gone")
    return json.loads(text), files
