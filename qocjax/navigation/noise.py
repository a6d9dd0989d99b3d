"""Standard normal numbers from a counter: what a sampling controller needs by the hundred thousand each cycle.

Each pair is a function of its own counter alone, so that all are computed side by side in vector registers, without a
state and without a pass over memory per round, as a general generator makes them.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax._math import POLYNOMIALS

__all__ = ["LARGEST", "normal_pairs"]

# Magnitude that no number passes: the radius of the smallest uniform number, 2^-24.
LARGEST = 5.8

# Threefry-2x32 (Salmon et al., 2011): the rotations of its rounds, in turn, and the constant of its key schedule.
_ROTATIONS = (13, 15, 26, 6, 17, 29, 16, 24)
_PARITY = 0x1BD11BDA
_ROUNDS = 20

# Up to 1 rad, to rounding in float32.
_SINC_COS = POLYNOMIALS[-1][1].sinc_cos


def normal_pairs(key: Array, steps: int, samples: int, dtype: jnp.dtype) -> tuple[Array, Array]:
    """Two independent arrays of independent standard normal numbers.

    By the transform of Box and Muller, which turns one random radius and one random angle into two numbers. The
    largest magnitude is LARGEST.

    Args:
        key: Random key.
        steps: Rows H.
        samples: Columns K.
        dtype: Floating type of the numbers.

    Returns:
        Two arrays [H, K].
    """
    seed = jax.random.bits(key, (2,), jnp.uint32)
    column = jnp.arange(samples, dtype=jnp.uint32)

    # As complex numbers, and a row at a time: an expression with two results is otherwise computed once for each.
    def row(index: Array) -> Array:
        return lax.complex(*_box_muller(*_threefry(seed[0], seed[1], jnp.full_like(column, index), column), dtype))

    pairs = lax.map(row, jnp.arange(steps, dtype=jnp.uint32))
    return jnp.real(pairs), jnp.imag(pairs)


def _box_muller(first: Array, second: Array, dtype: jnp.dtype) -> tuple[Array, Array]:
    """A random radius and a random angle, within 45 degrees of one of four axes, from two random words."""
    radius = jnp.sqrt(-2.0 * jnp.log(_uniform(first, dtype)))
    a = (_uniform(second, dtype) - 0.5) * (0.5 * jnp.pi)
    sinc, along = _SINC_COS(a)
    along = jnp.where(second & 1, along, -along) * radius
    across = sinc * a * radius
    swapped = (second & 2) != 0
    return jnp.where(swapped, across, along), jnp.where(swapped, along, across)


def _uniform(bits: Array, dtype: jnp.dtype) -> Array:
    """Numbers inside (0, 1) from the upper 23 bits, exact in float32 and symmetric about 1/2."""
    return ((bits >> 9).astype(jnp.int32).astype(dtype) + 0.5) * 2.0**-23


def _threefry(key0: Array, key1: Array, counter0: Array, counter1: Array) -> tuple[Array, Array]:
    """Threefry-2x32 of a key and counters, all uint32: the generator of jax.random, unrolled."""
    keys = (key0, key1, key0 ^ key1 ^ jnp.uint32(_PARITY))
    x, y = counter0 + keys[0], counter1 + keys[1]
    for i in range(_ROUNDS):
        turn = _ROTATIONS[i % 8]
        x = x + y
        y = ((y << turn) | (y >> (32 - turn))) ^ x
        if i % 4 == 3:
            n = i // 4 + 1
            x, y = x + keys[n % 3], y + keys[(n + 1) % 3] + jnp.uint32(n)
    return x, y
