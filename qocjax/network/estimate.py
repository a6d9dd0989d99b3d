"""F(deadline) of networks whose loops compete, by simulating the network alone (model, section 12)."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import jax
import numpy as np
from jax import Array

from qocjax._kept import called
from qocjax._room import check_runs
from qocjax.network._fields import no_nan
from qocjax.network.completion import completes, latest
from qocjax.network.contention import contend, draw_length, source_of
from qocjax.network.interface import Load, Network, Reliability, SharedNetwork, general_length

__all__ = ["SEEDS", "draw_parts", "simulated", "usage"]

SEEDS = 16
"""Runs behind each estimate; common to all networks and loads, so that their differences are paired."""


def simulated(network: Network, deadline: Any, load: Load) -> Reliability:
    """Share of the sampling instants whose loop completes, over `SEEDS` runs, with its standard error over them.

    Args:
        network: Where loops come from.
        deadline: Deadlines (s), any shape.
        load: What the network carries; a run is as long as it says.

    Raises:
        ValueError: A deadline is NaN.
    """
    at = no_nan("deadline", deadline)
    each, place = np.unique(at, return_inverse=True)
    shares = _shares(network, tuple(each.tolist()), load)
    share, error = shares.mean(axis=1), shares.std(axis=1, ddof=1) / np.sqrt(SEEDS)
    return Reliability(share[place].reshape(at.shape), error[place].reshape(at.shape))


def usage(network: Network, deadline: float, load: Load) -> dict[str, tuple[float, float]]:
    """Share in use of each thing that is scarce, with its standard error; nothing where nothing is.

    Args:
        network: Where loops come from.
        deadline: Delta (s).
        load: What the network carries.
    """
    if not isinstance(network, SharedNetwork):
        return {}
    _, used = _contended(network, (float(deadline),), load)
    return {name: (float(s.mean()), float(s.std(ddof=1) / np.sqrt(SEEDS))) for name, s in used.items()}


@lru_cache(maxsize=256)
def _shares(network: Network, deadlines: tuple[float, ...], load: Load) -> np.ndarray:
    """Share of completed loops, [D, S]."""
    if getattr(network, "uses_deadline", False):
        return _contended(network, deadlines, load)[0]
    times = _sorted_times(network, load)
    allowed = latest(np.asarray(deadlines, times.dtype))
    return np.stack([np.searchsorted(row, allowed, side="right") for row in times], axis=1) / times.shape[1]


@lru_cache(maxsize=16)
def _sorted_times(network: Network, load: Load) -> np.ndarray:
    """Loop times that do not depend on the deadline, [S, P * N], ascending."""
    drawn = times = draw_parts(network, load)
    if isinstance(network, SharedNetwork):
        times = contend(network, drawn, load.num_ticks, load.tau, [0.0]).loop_times[0]
    return np.sort(np.asarray(times)[:, : load.num_ticks].reshape(SEEDS, -1), axis=1)


@lru_cache(maxsize=64)
def _contended(
    network: SharedNetwork, deadlines: tuple[float, ...], load: Load
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Share of completed loops [D, S], and what is in use [D, S], of a network that competes."""
    drawn = draw_parts(network, load)
    shares: list[np.ndarray] = []
    used: list[dict[str, np.ndarray]] = []
    for deadline in deadlines:
        found = contend(network, drawn, load.num_ticks, load.tau, [deadline])
        done = completes(np.asarray(found.loop_times), deadline).sum(axis=(2, 3))
        shares.append(np.asarray(done, np.float64) / (load.num_ticks * load.num_robots))
        used.append({name: np.asarray(values, np.float64) for name, values in found.usage.items()})
    return np.concatenate(shares), {name: np.concatenate([each[name] for each in used]) for name in used[0]}


def draw_parts(network: Network, load: Load) -> Any:
    """What chance decides of the runs behind an estimate, each leaf [S, ...]; it may hold more ticks than the load."""
    check_runs(load.num_ticks, load.num_robots, SEEDS)
    ticks, tau = draw_length(network, load.num_ticks, load.tau, general_length(load.num_ticks))
    return called(_draw, (np.int32(0),), (source_of(network), ticks, load.num_robots, tau))


def _draw(root: Array, network: Network, num_ticks: int, num_robots: int, tau: float) -> Any:
    keys = jax.random.split(jax.random.key(root), SEEDS)
    return jax.vmap(lambda key: network.draw(key, num_ticks, num_robots, tau))(keys)
