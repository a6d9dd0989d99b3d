"""How many computations a network has under way at once: what it takes of an edge (model, sections 4 and 12)."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from qocjax.network.contention import contend
from qocjax.network.edge import Edge
from qocjax.network.edge_network import EdgeNetwork, Path
from qocjax.network.estimate import draw_parts
from qocjax.network.interface import Load, Network, SharedNetwork

__all__ = ["AtOnce", "computations_at_once"]

_SAME = 1e-5  # s


class AtOnce(NamedTuple):
    """Computations under way at once, of all robots together."""

    mean: float  # over the run
    peak: float  # the largest number within a run, its mean over runs


def computations_at_once(network: Network, load: Load, deadline: float = 0.0) -> AtOnce | None:
    """Simulates the network alone, and counts.

    Args:
        network: Where loop times come from.
        load: What it carries.
        deadline: Delta (s), for an edge that gives up what is late.

    Returns:
        None for a network that does not tell its computations apart, such as a trace.
    """
    if not isinstance(network, (SharedNetwork, Path)):
        return None
    shared = network if isinstance(network, SharedNetwork) else EdgeNetwork(network, Edge())
    return _counted(shared, load, deadline if shared.uses_deadline else 0.0)


@lru_cache(maxsize=128)
def _counted(network: SharedNetwork, load: Load, deadline: float) -> AtOnce:
    drawn = draw_parts(network, load)
    found = contend(network, drawn, load.num_ticks, load.tau, jnp.asarray([deadline]))
    began, busy = (np.asarray(values, np.float64)[0] for values in (found.began, found.busy))
    horizon = load.num_ticks * load.tau
    mean, peaks = [], []
    for start, length in zip(began, busy, strict=True):
        start = start + np.arange(start.shape[0])[:, None] * load.tau
        served = np.isfinite(start) & (start < horizon) & (length > 0)
        begins, ends = start[served], np.minimum(start[served] + length[served], horizon)
        mean.append((ends - begins).sum() / horizon)
        # What follows at once on the same worker is none beside it, whatever rounding says.
        instants = np.concatenate([begins, np.maximum(ends - _SAME, begins)])
        order = np.lexsort((np.repeat([1, 0], begins.size), instants))
        peaks.append(np.cumsum(np.repeat([1, -1], begins.size)[order]).max(initial=0))
    return AtOnce(float(np.mean(mean)), float(np.mean(peaks)))
