"""The few functions of an angle that a tick needs: exact, or as polynomials for the speed path.

The polynomial forms use no division by a transcendental and no branch, so that a compiler can vectorise a whole tick.
Their errors, in float32 and over the stated range, are tested.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

__all__ = ["EXACT", "MAX_HALF_ANGLE", "POLYNOMIAL", "AngleMath"]

# The polynomial sinc and cos hold up to this half turn per arc (rad): omega_max * tau / 2.
MAX_HALF_ANGLE = 1.0

# Minimax for atan(a)/a in a² on [0, 1]: error below 4e-8 rad before rounding.
_ATAN = (
    -0.00405456047, 0.021862934, -0.0559122931, 0.0964219492, -0.139086286, 0.199465655, -0.333298608, 0.999999336,
)  # fmt: skip


class AngleMath(NamedTuple):
    """A way to compute angles: `sinc_cos(a) -> (sin(a)/a, cos(a))` and `atan2(y, x)`, zero at the origin."""

    name: str
    sinc_cos: Callable[[Array], tuple[Array, Array]]
    atan2: Callable[[Array, Array], Array]


def _exact_sinc_cos(a: Array) -> tuple[Array, Array]:
    small = jnp.abs(a) < 1e-4  # there 1 - a²/6 is exact to rounding, and its gradient finite
    safe = jnp.where(small, 1.0, a)
    return jnp.where(small, 1.0 - a * a / 6.0, jnp.sin(safe) / safe), jnp.cos(a)


def _exact_atan2(y: Array, x: Array) -> Array:
    at_origin = (x == 0) & (y == 0)  # the gradient of atan2 is undefined there
    return jnp.arctan2(jnp.where(at_origin, 0.0, y), jnp.where(at_origin, 1.0, x))


@jax.custom_jvp
def _polynomial_sinc_cos(a: Array) -> tuple[Array, Array]:
    """Taylor to a¹⁰: error below 3e-8 (sinc) and 3e-9 (cos) for |a| <= MAX_HALF_ANGLE, before rounding."""
    q = a * a
    sinc = 1.0 - q * (1 / 6) * (1.0 - q * (1 / 20) * (1.0 - q * (1 / 42) * (1.0 - q * (1 / 72))))
    cos = 1.0 - q * (1 / 2) * (1.0 - q * (1 / 12) * (1.0 - q * (1 / 30) * (1.0 - q * (1 / 56) * (1.0 - q * (1 / 90)))))
    return sinc, cos


@_polynomial_sinc_cos.defjvp
def _polynomial_sinc_cos_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[tuple, tuple]:
    """Derivatives by their own short series, so that differentiation does not unroll the polynomials."""
    (a,), (da,) = primals, tangents
    sinc, cos = _polynomial_sinc_cos(a)
    q = a * a
    slope = -(a / 3) * (1.0 - q * (1 / 10) * (1.0 - q * (1 / 28) * (1.0 - q * (1 / 54))))
    return (sinc, cos), (slope * da, -a * sinc * da)


@jax.custom_jvp
def _polynomial_atan2(y: Array, x: Array) -> Array:
    """Octant reduction and a minimax polynomial: error below 3e-7 rad in float32."""
    abs_x, abs_y = jnp.abs(x), jnp.abs(y)
    larger = jnp.maximum(abs_x, abs_y)
    a = jnp.minimum(abs_x, abs_y) / jnp.where(larger > 0, larger, 1.0)
    s = a * a
    r = jnp.full_like(s, _ATAN[0])
    for coefficient in _ATAN[1:]:
        r = r * s + coefficient
    r = r * a
    r = jnp.where(abs_y > abs_x, jnp.pi / 2 - r, r)
    r = jnp.where(x < 0, jnp.pi - r, r)
    return jnp.where(y < 0, -r, r)


@_polynomial_atan2.defjvp
def _polynomial_atan2_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
    """The exact derivative (x dy - y dx) / (x² + y²); 0 at the origin."""
    (y, x), (dy, dx) = primals, tangents
    squared = x * x + y * y
    inverse = jnp.where(squared > 0, 1.0, 0.0) / jnp.where(squared > 0, squared, 1.0)
    return _polynomial_atan2(y, x), (x * dy - y * dx) * inverse


EXACT = AngleMath("exact", _exact_sinc_cos, _exact_atan2)
POLYNOMIAL = AngleMath("polynomial", _polynomial_sinc_cos, _polynomial_atan2)
