"""What Nav2 does to the averaged sequence of commands: smoothing, and the shift to the next cycle."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike

__all__ = ["HISTORY", "shifted", "smoothed"]

# Commands on either side of the one that the filter replaces (Nav2's window of 9).
HISTORY = 4

_SHORT = 20  # commands, which Nav2 leaves as they are
_ROUNDING = 1e-6  # of a step


def smoothed(sequence: Array, past: Array, order: int) -> Array:
    """Savitzky-Golay filter over 9 commands (nav2_mppi_controller, `savitskyGolayFilter` in utils.hpp).

    Each command becomes the value, at its own place, of the least-squares polynomial through it and the four on either
    side: before the first, those of the cycles before; after the last, the last one again. The last one stays, and a
    sequence of 20 commands or fewer.

    Args:
        sequence: [H].
        past: [4] the latest one last.
        order: Of the polynomial; 0 for no filter.
    """
    if order == 0 or len(sequence) <= _SHORT:
        return sequence
    offsets = np.arange(-HISTORY, HISTORY + 1)
    kernel = np.linalg.pinv(np.vander(offsets, order + 1, increasing=True))[0]  # value of the fit at offset 0
    padded = jnp.concatenate([past, sequence, jnp.broadcast_to(sequence[-1:], (HISTORY,))])
    # A sum of slices, since convolutions are slow to start.
    smooth: Array = sum(float(kernel[i]) * padded[i : i + len(sequence)] for i in range(len(kernel)))  # type: ignore
    return smooth.at[-1].set(sequence[-1])


def shifted(sequence: Array, steps: ArrayLike) -> Array:
    """The sequence from `steps` steps on, linear between its values, its last one held; [H]."""
    length = len(sequence)
    steps = jnp.minimum(jnp.asarray(steps, sequence.dtype), length)
    whole = jnp.floor(steps + _ROUNDING)
    rest = jnp.where(steps - whole > _ROUNDING, steps - whole, 0.0)
    padded = jnp.concatenate([sequence, jnp.broadcast_to(sequence[-1:], (length + 1,))])
    ahead = lax.dynamic_slice_in_dim(padded, whole.astype(jnp.int32), length + 1)
    return (1.0 - rest) * ahead[:-1] + rest * ahead[1:]
