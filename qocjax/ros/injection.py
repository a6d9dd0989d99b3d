"""Delay put on commands as a network of qocjax would, for experiments with real robots (the paper's D_cfg)."""

from __future__ import annotations

import heapq
import shlex
from collections.abc import Iterator

import jax
import numpy as np
from numpy.typing import NDArray

from qocjax import _checks
from qocjax.network.interface import Network, loop_times
from qocjax.ros.gate import Command, nanoseconds

__all__ = ["Injection", "drawn_loop_times"]


def drawn_loop_times(options: str, period: float, deadline: float, seed: int = 0, length: int = 2**14) -> NDArray:
    """Loop times of a network for one robot.

    Args:
        options: As on a command line of qocjax: `network=kth_5g network.uplink_loss=0.1`.
        period: Sampling period tau (s).
        deadline: Delta (s), for networks whose loop times depend on it.
        seed: Of the draw.
        length: Number P of loops.

    Returns:
        T_net (s), [P], infinite where lost.

    Raises:
        ValueError: There is no such option, or a value is out of range.
    """
    tau, count = float(_checks.bounded("period", period, above=0.0)), _checks.count("length", length)
    network = _network(options)
    keys = jax.random.split(jax.random.key(_checks.count("seed", seed, least=0)), 1)
    return np.asarray(loop_times(network, keys, count, 1, tau, deadline), np.float64)[0, :, 0]


def _network(options: str) -> Network:
    from hydra import compose, initialize_config_dir  # a robot without delays put on begins sooner
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    from qocjax._conf import conf_dir, hydra_base
    from qocjax.config import load
    from qocjax.config.show import ShowConfig

    try:
        with initialize_config_dir(str(conf_dir().resolve()), **hydra_base()):
            return load(ShowConfig, compose("show", shlex.split(options))).build_network()
    except (HydraException, OmegaConfBaseException) as error:
        text = " ".join(str(error).partition("Config search path")[0].split())  # Hydra lists folders there
        raise ValueError(f"network: got {options!r}: {text}") from None


class Injection:
    """Keeps commands back until the loop times given have passed since their stamps; times in ns.

    A command that has really taken longer is not kept. Loops are numbered by their stamps from the first one on; after
    the last loop time the first comes again.

    Args:
        loop_times: T_net (s), [P], infinite where lost.
        period: Between two stamps (s).
        origin: Stamp of the first loop (ns); None for that of the first command.

    Raises:
        TypeError: `loop_times` are no numbers.
        ValueError: They are none, negative or NaN, or `period` is not positive.
    """

    def __init__(self, loop_times: NDArray, period: float, origin: int | None = None) -> None:
        times = np.asarray(loop_times)
        if times.dtype.kind not in "iuf":
            raise TypeError(f"loop_times: got values of type {times.dtype}, expected seconds (inf where lost)")
        if times.ndim != 1 or times.size == 0 or np.isnan(times).any() or (times < 0).any():
            raise ValueError("loop_times: expected a row of times >= 0 s (inf where lost)")
        _checks.bounded("period", period, above=0.0, shape=())
        self._times, self._period, self._origin = times, nanoseconds("period", period), origin
        self._kept: list[tuple[int, int, int, Command]] = []
        self.lost = 0

    def put(self, stamp: int, command: Command, now: int) -> None:
        """Takes a command that really comes now."""
        self._origin = stamp if self._origin is None else self._origin
        loop = (2 * (stamp - self._origin) + self._period) // (2 * self._period)
        time = float(self._times[loop % self._times.size])
        if np.isinf(time):
            self.lost += 1
            return
        heapq.heappush(self._kept, (max(now, stamp + round(1e9 * time)), len(self._kept), stamp, command))

    def next_arrival(self) -> int | None:
        """When the next command comes out; None where none is kept."""
        return self._kept[0][0] if self._kept else None

    def take(self, now: int) -> Iterator[tuple[int, Command, int]]:
        """Stamp, command and arrival of those that have come until now, in order."""
        while self._kept and self._kept[0][0] <= now:
            arrival, _, stamp, command = heapq.heappop(self._kept)
            yield stamp, command, arrival

    def clear(self) -> None:
        """Forgets the commands that are kept, as where the clock was set back."""
        self._kept.clear()
