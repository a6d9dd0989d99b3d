"""Compiled programs that draw from networks and work out their loops; networks that differ in numbers share them."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import numpy as np
from jax import Array

from qocjax.network.interface import Contended, Network, SharedNetwork

__all__ = ["contend", "contended", "split", "source_of"]


def source_of(network: Network) -> Network:
    """A network with the same draws, equal for all that differ in what only `contend` reads."""
    return getattr(network, "source", network)


def split(network: SharedNetwork) -> tuple[Any, list[np.ndarray]]:
    """What a program is compiled for, and the numbers that it takes: those of a network that is a pytree of numbers."""
    leaves, structure = jax.tree.flatten(network)
    if all(isinstance(leaf, (int, float)) and not isinstance(leaf, bool) for leaf in leaves):
        return structure, [np.asarray(leaf, np.int32 if isinstance(leaf, int) else None) for leaf in leaves]
    return network, []


@partial(jax.jit, static_argnames="kind")
def contended(
    kind: Any, numbers: list[Array], drawn: Any, num_ticks: Array | int, tau: Array | float, deadline: Array
) -> Contended:
    """Works out loops as `SharedNetwork.contend` does, of the network that `split` took apart."""
    network = jax.tree.unflatten(kind, numbers) if isinstance(kind, jax.tree_util.PyTreeDef) else kind
    return network.contend(drawn, num_ticks, tau, deadline)


def contend(
    network: SharedNetwork, drawn: Any, num_ticks: Array | int, tau: Array | float, deadline: Array
) -> Contended:
    """Works out the loops of all seeds at all deadlines, compiled; arguments as for `SharedNetwork.contend`."""
    return contended(*split(network), drawn, num_ticks, tau, deadline)
