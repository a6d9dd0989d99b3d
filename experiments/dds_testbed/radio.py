"""The radio: what a qocjax network does to each frame, drawn beforehand from its own laws."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import numpy as np

from qocjax.network import Leg, LoopNetwork, Network, Trace

__all__ = ["Direction", "Radio", "compute_times", "draw_radio"]


@dataclass
class Direction:
    """What awaits the frames of one direction on each of N links; what runs out comes round again.

    Delays go by the frame, or by the time that it is sent. Losses are drawn by the frame, with a probability that goes
    by the time: a burst hits all that is sent while it lasts, data, heartbeats and acknowledgements alike.
    """

    delay: np.ndarray  # [M, N] s
    by_time: bool
    level: np.ndarray  # [M, N] in [0, 1)
    loss: np.ndarray  # [B, N] probability of a loss in each period

    def __post_init__(self) -> None:
        self._sent = [0] * self.delay.shape[1]

    def fate(self, link: int, period: int) -> float:
        """Delay (s) of the next frame on a link, infinite if it is lost."""
        row = self._sent[link]
        self._sent[link] += 1
        if self.level[row % len(self.level), link] < self.loss[period % len(self.loss), link]:
            return float("inf")
        return float(self.delay[(period if self.by_time else row) % len(self.delay), link])


class Radio:
    """Both directions, from robot and from edge, on a clock that starts with the impairment."""

    def __init__(self, directions: tuple[Direction, Direction], tau: float) -> None:
        self._directions, self._tau = directions, tau
        self._start: int | None = None
        self._silence = (0, 0)

    def silent(self, begin: int, end: int) -> None:
        """Loses every frame sent from `begin` on and before `end` (ns)."""
        self._silence = (begin, end)

    def fate(self, link: int, side: int, now: int) -> float:
        """Delay (s), infinite if lost, of a frame that a side sends at `now` (ns)."""
        self._start = now if self._start is None else self._start
        if self._silence[0] <= now < self._silence[1]:
            return float("inf")
        return self._directions[side].fate(link, int((now - self._start) * 1e-9 / self._tau))


def draw_radio(network: Network, key: jax.Array, frames: int, periods: int, num_links: int, tau: float) -> Radio:
    """Draws a radio from a network.

    Of a `LoopNetwork` each leg becomes a direction. A `Trace` knows whole loops only: the loop that starts in a period
    gives half its time to each direction, and if it is lost, what goes up in that period is lost.

    Args:
        network: Which delays and losses.
        key: Random key.
        frames: How many frames of each link and direction get draws of their own.
        periods: How many sampling periods do.
        num_links: Number of robots N.
        tau: Sampling period (s), which is also the step of a bursty channel.

    Raises:
        ValueError: A network of another kind, or with losses that know no chance over time.
    """
    level = [np.asarray(jax.random.uniform(each, (frames, num_links))) for each in jax.random.split(key)]
    if isinstance(network, Trace):
        half = np.asarray(network.draw(jax.random.fold_in(key, 2), periods, num_links, tau)) / 2
        lost = np.isinf(half)
        delay = np.where(lost, 0.0, half)
        up, down = (Direction(delay, True, level[k], np.where(lost, 1.0 - k, 0.0)) for k in (0, 1))
        return Radio((up, down), tau)
    if not isinstance(network, LoopNetwork):
        raise ValueError(f"network: got a {type(network).__name__}, expected a LoopNetwork or a Trace")
    legs = (network.uplink, network.downlink)
    for leg in legs:
        if not hasattr(leg.loss, "chance"):
            raise ValueError(f"network: got losses of kind {type(leg.loss).__name__}, expected a chance over time")
    keys = jax.random.split(jax.random.fold_in(key, 3))
    up, down = (_direction(legs[k], keys[k], level[k], periods) for k in (0, 1))
    return Radio((up, down), tau)


def _direction(leg: Leg, key: jax.Array, level: np.ndarray, periods: int) -> Direction:
    of_delay, of_loss = jax.random.split(key)
    delay = np.asarray(leg.delay.sample(of_delay, level.shape))
    return Direction(delay, False, level, np.asarray(leg.loss.chance(of_loss, periods, level.shape[1])))


def compute_times(network: Network, key: jax.Array, num_ticks: int, num_robots: int) -> np.ndarray:
    """Draws how long the edge takes over each loop, [P, N] s; a trace holds that time already."""
    if isinstance(network, LoopNetwork):
        return np.asarray(network.compute.sample(key, (num_ticks, num_robots)), np.float64)
    return np.zeros((1, num_robots))
