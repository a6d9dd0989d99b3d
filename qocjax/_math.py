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

__all__ = ["EXACT", "POLYNOMIALS", "AngleMath", "angle_math", "at_least", "at_most"]

# Minimax for atan(a)/a in a² on [0, 1]: error below 4e-8 rad before rounding.
_ATAN = (
    -0.00405456047, 0.021862934, -0.0559122931, 0.0964219492, -0.139086286, 0.199465655, -0.333298608, 0.999999336,
)  # fmt: skip


def at_least(value: Array, floor: Array | float) -> Array:
    """The larger of the two, NaN where the value is: one instruction, where `jnp.maximum` guards against either NaN."""
    return jnp.where(floor > value, floor, value)


def at_most(value: Array, cap: Array | float) -> Array:
    """The smaller of the two, NaN where the value is."""
    return jnp.where(cap < value, cap, value)


class AngleMath(NamedTuple):
    """A way to compute angles: `sinc_cos(a) -> (sin(a)/a, cos(a))` and `atan2(y, x)`, zero at the origin."""

    name: str
    sinc_cos: Callable[[Array], tuple[Array, Array]]
    atan2: Callable[[Array, Array], Array]

    def told_by(self) -> tuple:
        """What tells these functions from others, to programs that are kept: functions that are made have no names."""
        return next(((self.name, limit) for limit, math in POLYNOMIALS if math is self), tuple(self))


def _exact_sinc_cos(a: Array) -> tuple[Array, Array]:
    small = jnp.abs(a) < 1e-4  # there 1 - a²/6 is exact to rounding, and its gradient finite
    safe = jnp.where(small, 1.0, a)
    return jnp.where(small, 1.0 - a * a / 6.0, jnp.sin(safe) / safe), jnp.cos(a)


def _exact_atan2(y: Array, x: Array) -> Array:
    at_origin = (x == 0) & (y == 0)  # the gradient of atan2 is undefined there
    return jnp.arctan2(jnp.where(at_origin, 0.0, y), jnp.where(at_origin, 1.0, x))


def _polynomial_sinc_cos(terms: int) -> Callable[[Array], tuple[Array, Array]]:
    """Taylor series of sin(a)/a to a^(2 terms) and of cos(a) to a^(2 terms + 2).

    The cosine goes one term further so that the unit vector of a heading keeps its length to the order of the sine.
    """

    def nested(q: Array, last: int, first: int) -> Array:
        """1 - q/(n m) (1 - q/...) with n m = first (first + 1), ... up to `last` factors."""
        value = jnp.ones_like(q)
        for k in reversed(range(last)):
            value = 1.0 - q * (1 / ((2 * k + first) * (2 * k + first + 1))) * value
        return value

    @jax.custom_jvp
    def sinc_cos(a: Array) -> tuple[Array, Array]:
        q = a * a
        return nested(q, terms, 2), nested(q, terms + 1, 1)

    @sinc_cos.defjvp
    def _(primals: tuple[Array], tangents: tuple[Array]) -> tuple[tuple, tuple]:
        # By a short series of their own, so that differentiation does not unroll the others.
        (a,), (da,) = primals, tangents
        sinc, cos = sinc_cos(a)
        q, slope = a * a, jnp.ones_like(a)
        for k in reversed(range(1, terms)):
            slope = 1.0 - q * (1 / (2 * k * (2 * k + 3))) * slope
        return (sinc, cos), (-(a / 3) * slope * da, -a * sinc * da)

    return sinc_cos


@jax.custom_jvp
def _polynomial_atan2(y: Array, x: Array) -> Array:
    """Octant reduction and a minimax polynomial: error below 3e-7 rad in float32."""
    abs_x, abs_y = jnp.abs(x), jnp.abs(y)
    larger = at_least(abs_x, abs_y)
    a = at_most(abs_x, abs_y) / jnp.where(larger > 0, larger, 1.0)
    s = a * a
    r = jnp.full_like(s, _ATAN[0])
    for coefficient in _ATAN[1:]:
        r = r * s + coefficient
    r = r * a
    # Not the comparison that `at_least` makes: XLA would compute it once, for both, and keep it in memory.
    r = jnp.where(abs_x < abs_y, jnp.pi / 2 - r, r)
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

# By the largest half turn of an arc that each is made for, omega_max * tau / 2 (rad). Errors before rounding are below
# 2e-9 (sinc) and 1e-11 (cos) for the first two, 3e-8 and 3e-9 for the last. The shorter, the quicker the loop.
POLYNOMIALS = tuple(
    (limit, AngleMath("polynomial", _polynomial_sinc_cos(terms), _polynomial_atan2))
    for limit, terms in ((0.02, 1), (0.14, 2), (1.0, 4))
)


def angle_math(half_turn: float) -> AngleMath:
    """The shortest polynomials that hold up to a half turn (rad); exact functions beyond all of them."""
    return next((math for limit, math in POLYNOMIALS if half_turn <= limit), EXACT)
