"""Compiled programs that work out the loops of networks; networks that differ in numbers share them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax._kept import program as kept_program
from qocjax._once import Once
from qocjax._xla import compiled
from qocjax.network.interface import Contended, Network, SharedNetwork

__all__ = ["contend", "contended_times", "draw_length", "source_of"]

_programs: Once[Callable[..., Any]] = Once()  # of this process, each for one device


def source_of(network: Network) -> Network:
    """A network with the same draws, equal for all that differ in what only `contend` reads."""
    return getattr(network, "drawn_as", network)


def draw_length(network: Network, ticks: int, tau: float, length: int) -> tuple[int, float]:
    """For how many ticks, at what sampling period, a run is drawn: one program serves many where rows stand alone.

    Args:
        network: Where loop times come from.
        ticks: P of the run.
        tau: Its sampling period (s).
        length: Ticks of the program to be shared.
    """
    stable = getattr(network, "prefix_stable", False) and getattr(jax.config, "jax_threefry_partitionable", True)
    return (length, 1.0) if stable else (ticks, tau)


def contend(network: SharedNetwork, drawn: Any, num_ticks: int, tau: float, deadline: Any) -> Contended:
    """Works out the loops of all seeds at all deadlines, compiled; arguments as for `SharedNetwork.contend`."""
    return _run(_contended, network, drawn, num_ticks, tau, deadline)


def contended_times(network: SharedNetwork, drawn: Any, num_ticks: int, tau: float, deadline: Any) -> Array:
    """As `contend`, the loop times [D, S, P, N] s alone, which is less to write."""
    return _run(_times, network, drawn, num_ticks, tau, deadline)


def _run(program: Any, network: SharedNetwork, drawn: Any, num_ticks: int, tau: float, deadline: Any) -> Any:
    kind, numbers = _split(network)
    width = jnp.result_type(float)
    args = (numbers, drawn, np.int32(num_ticks), np.asarray(tau, width), np.asarray(deadline, width))
    leaves, structure = jax.tree.flatten(args)
    shapes = tuple((np.shape(leaf), leaf.dtype) for leaf in leaves)
    key = (program, kind, structure, shapes, getattr(jax.config, "jax_default_device", None))
    return _programs.get(key, lambda: kept_program(program, args, (kind,), compiled))(*args)


def _split(network: SharedNetwork) -> tuple[Any, list[np.ndarray]]:
    """What a program is compiled for, and the numbers that it takes: those of a network that is a pytree of numbers."""
    leaves, structure = jax.tree.flatten(network)
    if all(isinstance(leaf, (int, float)) and not isinstance(leaf, bool) for leaf in leaves):
        width = jnp.result_type(float)
        return structure, [np.asarray(leaf, np.int32 if isinstance(leaf, int) else width) for leaf in leaves]
    return network, []


def _contended(numbers: list[Array], drawn: Any, num_ticks: Array, tau: Array, deadline: Array, kind: Any) -> Contended:
    network = jax.tree.unflatten(kind, numbers) if isinstance(kind, jax.tree_util.PyTreeDef) else kind
    return network.contend(drawn, num_ticks, tau, deadline)


def _times(*args: Any) -> Array:
    return _contended(*args).loop_times
