"""How kernels go through a batch: one after the other on a CPU, all at once on an accelerator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
from jax import Array, lax

__all__ = ["mapped", "over_maps"]


def mapped(kernel: Callable[[Any], Any], batch: Any) -> Any:
    """Applies a kernel to each entry of the leading axis of all arrays, and stacks what it returns.

    On a CPU one after the other, so that what a kernel needs stays in cache; elsewhere all at once.
    """
    return lax.map(kernel, batch) if jax.default_backend() == "cpu" else jax.vmap(kernel)(batch)


def over_maps(kernel: Callable[..., Array], *arrays: Array) -> Array:
    """Applies a kernel to arrays [*B, rows, cols].

    On a CPU map after map: what a kernel needs of one map stays in cache, and one that repeats until it is done stops
    at each map's own time (a third of the time of the whole batch at once, for 64 maps of 120 x 120). Elsewhere all
    maps at once, as an accelerator wants it.
    """
    batch, cells = arrays[0].shape[:-2], arrays[0].shape[-2:]
    if not batch:
        return kernel(*arrays)

    def one_by_one(*arrays: Array) -> Array:
        flat = tuple(each.reshape(-1, *cells) for each in arrays)
        return lax.map(lambda each: kernel(*each), flat).reshape(*batch, *cells)

    return lax.platform_dependent(*arrays, cpu=one_by_one, default=kernel)
