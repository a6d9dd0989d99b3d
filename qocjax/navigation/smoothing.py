"""What Nav2 does to the averaged sequence of commands: smoothing, and the shift to the next cycle."""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
from jax import Array

__all__ = ["HISTORY", "shifted", "smoothed"]

# Commands on either side of the one that the filter replaces (Nav2's window of 9).
HISTORY = 4


def smoothed(sequence: Array, sent: Array, order: int) -> Array:
    """Savitzky-Golay filter over 9 commands (nav2_mppi_controller, `savitskyGolayFilter` in utils.hpp).

    Each command becomes the value, at its own place, of the least-squares polynomial through it and the four on either
    side: before the first, those sent last; after the last, the last one again.

    Args:
        sequence: [H].
        sent: [4] the latest one last.
        order: Of the polynomial; 0 for no filter.
    """
    if order == 0:
        return sequence
    offsets = np.arange(-HISTORY, HISTORY + 1)
    kernel = np.linalg.pinv(np.vander(offsets, order + 1, increasing=True))[0]  # value of the fit at offset 0
    padded = jnp.concatenate([sent, sequence, jnp.broadcast_to(sequence[-1:], (HISTORY,))])
    # A sum of slices, since convolutions are slow to start.
    return sum(float(kernel[i]) * padded[i : i + len(sequence)] for i in range(len(kernel)))  # type: ignore[return-value]


def shifted(sequence: Array, steps: float) -> Array:
    """The sequence from `steps` steps on, linear between its values, its last one held; [H]."""
    whole = min(math.floor(steps + 1e-6), len(sequence))
    rest = max(steps - whole, 0.0) if abs(steps - whole) > 1e-6 else 0.0
    padded = jnp.concatenate([sequence[whole:], jnp.broadcast_to(sequence[-1:], (whole + 1,))])
    return padded[:-1] if rest == 0 else (1.0 - rest) * padded[:-1] + rest * padded[1:]
