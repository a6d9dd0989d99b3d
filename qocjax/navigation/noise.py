"""Standard normal numbers from a counter: what a sampling controller needs by the hundred thousand each cycle.

Each pair is a function of its own counter alone, so that all are computed side by side in vector registers, without a
state and without a pass over memory per round, as a general generator makes them.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
from jax import Array, lax

from qocjax._math import POLYNOMIALS

__all__ = ["LARGEST", "ROUNDS", "normal_pairs", "normal_row", "seed_of"]

# Magnitude that no number passes: the radius of the smallest uniform number, 2^-24.
LARGEST = 5.8

# Threefry-2x32 (Salmon et al., 2011): the rotations of its rounds, in turn, and the constant of its key schedule. As
# many rounds as pass all tests of TestU01 there; jax.random makes 20, which takes half as long again.
_ROTATIONS = (13, 15, 26, 6, 17, 29, 16, 24)
_PARITY = 0x1BD11BDA
ROUNDS = 13

# Up to 1 rad, to rounding in float32.
_SINC_COS = POLYNOMIALS[-1][1].sinc_cos

# Minimax of (ln(1 + f) - f + f²/2) / f³ from √½ to √2, highest power first: the logarithm's error is below 4e-8 of it.
_LOG = (0.0870043453, -0.142674868, 0.149147682, -0.165775847, 0.199630638, -0.25001337, 0.333339107)
_ROOT_HALF = 0x3F3504F3  # the bits of √½


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
    seed = seed_of(key)
    column = jnp.arange(samples, dtype=jnp.uint32)
    return lax.map(lambda row: normal_row(seed, row, column, dtype), jnp.arange(steps, dtype=jnp.uint32))


def seed_of(key: Array) -> Array:
    """Two words [2], which all numbers of a random key follow from."""
    return jax.random.bits(key, (2,), jnp.uint32)


def normal_row(seed: Array, row: Array, column: Array, dtype: jnp.dtype) -> tuple[Array, Array]:
    """Numbers of one row of `normal_pairs`, each [K]: for whoever takes them while they are in cache.

    Args:
        seed: [2] from `seed_of`.
        row: Its index, [].
        column: [K] which ones of the row.
        dtype: Floating type of the numbers.
    """
    words = _threefry(seed[0], seed[1], jnp.full_like(column, row), column)
    # Both results of a stage as one complex number, and each stage by itself: what has two results is otherwise
    # computed once for each, and a long expression in fewer registers than it needs.
    first, second = _apart(lax.complex(*(lax.bitcast_convert_type(word, jnp.float32) for word in words)))
    first, second = (lax.bitcast_convert_type(each, jnp.uint32) for each in (first, second))
    return _apart(lax.complex(*_box_muller(first, second, dtype)))


def _apart(both: Array) -> tuple[Array, Array]:
    """Real and imaginary parts of numbers that are computed before either is used."""
    both = lax.optimization_barrier(both)
    return jnp.real(both), jnp.imag(both)


def _box_muller(first: Array, second: Array, dtype: jnp.dtype) -> tuple[Array, Array]:
    """A random radius and a random angle, within 45 degrees of one of four axes, from two random words."""
    radius = jnp.sqrt(-2.0 * _log(_uniform(first, dtype)))
    a = (_uniform(second, dtype) - 0.5) * (0.5 * jnp.pi)
    sinc, along = _SINC_COS(a)
    along = jnp.where(second & 1, along, -along) * radius
    across = sinc * a * radius
    swapped = (second & 2) != 0
    return jnp.where(swapped, across, along), jnp.where(swapped, along, across)


def _log(a: Array) -> Array:
    """Natural logarithm of normal numbers above 0: of float32 from exponent and mantissa, to rounding."""
    if a.dtype != jnp.float32:
        return jnp.log(a)
    bits = lax.bitcast_convert_type(a, jnp.int32) - _ROOT_HALF
    f = lax.bitcast_convert_type((bits & 0x7FFFFF) + _ROOT_HALF, jnp.float32) - 1.0
    terms = jnp.full_like(f, _LOG[0])
    for coefficient in _LOG[1:]:
        terms = terms * f + coefficient
    return (bits >> 23).astype(f.dtype) * math.log(2.0) + (f + f * f * (terms * f - 0.5))


def _uniform(bits: Array, dtype: jnp.dtype) -> Array:
    """Numbers inside (0, 1) from the upper 23 bits, exact in float32 and symmetric about 1/2."""
    return ((bits >> 9).astype(jnp.int32).astype(dtype) + 0.5) * 2.0**-23


def _threefry(key0: Array, key1: Array, counter0: Array, counter1: Array, rounds: int = ROUNDS) -> tuple[Array, Array]:
    """Threefry-2x32 of a key and counters, all uint32: the generator of jax.random, unrolled."""
    keys = (key0, key1, key0 ^ key1 ^ jnp.uint32(_PARITY))
    x, y = counter0 + keys[0], counter1 + keys[1]
    for i in range(rounds):
        turn = _ROTATIONS[i % 8]
        x = x + y
        y = ((y << turn) | (y >> (32 - turn))) ^ x
        if i % 4 == 3:
            n = i // 4 + 1
            x, y = x + keys[n % 3], y + keys[(n + 1) % 3] + jnp.uint32(n)
    return x, y
