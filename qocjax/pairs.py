"""Sums and minima over pairs of robots, each pair visited once, in any batch."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax.numpy as jnp
from jax import Array, lax

from qocjax._math import at_most

__all__ = ["closest_squared", "pair_forces"]

# Up to this many robots the pairs are written out (one fusion); above it they are a loop, to keep the program small.
_UNROLLED = 8

PairLaw = Callable[[Array, Array, Array], Array]
T = TypeVar("T")


def pair_forces(x: Array, y: Array, other: Array, law: PairLaw) -> tuple[Array, Array]:
    """Sums a central pair force over all partners.

    Robot i is paired with i + k (mod N) for each shift k up to N/2, and what it gets the partner gets with the other
    sign; so each pair is computed once, on whole arrays.

    Args:
        x: [N, *B] positions (m).
        y: [N, *B] positions (m).
        other: [N, *B'] a further quantity per robot (the age), broadcastable to the positions.
        law: (squared distance, other_i, other_j) -> factor; the force on i is the factor times (p_i - p_j).

    Returns:
        The two components of the force, each [N, *B].
    """

    def add(k: int | Array, half: bool, force: tuple[Array, Array]) -> tuple[Array, Array]:
        dx, dy, mine, theirs = (_gap(x, k, half), _gap(y, k, half), _first(other, k, half), _second(other, k, half))
        factor = law(dx * dx + dy * dy, mine, theirs)
        return force[0] + _both(factor * dx, k, half), force[1] + _both(factor * dy, k, half)

    return _over_shifts(x.shape[0], add, (jnp.zeros_like(x), jnp.zeros_like(y)))


def closest_squared(x: Array, y: Array) -> Array:
    """Smallest squared distance between two robots, [*B]; infinite for one robot."""

    def nearest(k: int | Array, half: bool, smallest: Array) -> Array:
        dx, dy = _gap(x, k, half), _gap(y, k, half)
        return at_most(jnp.min(dx * dx + dy * dy, axis=0), smallest)

    return _over_shifts(x.shape[0], nearest, jnp.full(x.shape[1:], jnp.inf, x.dtype))


def _over_shifts(num_robots: int, visit: Callable[..., T], total: T) -> T:
    """Visits the shifts 1 .. N/2; for even N the last has each pair twice, so only half of it is visited."""
    full = (num_robots - 1) // 2
    if num_robots <= _UNROLLED:
        for k in range(1, full + 1):
            total = visit(k, False, total)
    else:
        total = lax.fori_loop(1, full + 1, lambda k, part: visit(k, False, part), total)
    return visit(num_robots // 2, True, total) if num_robots % 2 == 0 else total


def _shifted(v: Array, k: int | Array) -> Array:
    """v[(i + k) mod N]."""
    if isinstance(k, int):
        return jnp.concatenate([v[k:], v[:k]])
    return lax.dynamic_slice_in_dim(jnp.concatenate([v, v]), k, v.shape[0])


def _first(v: Array, k: int | Array, half: bool) -> Array:
    return v[:k] if half else v


def _second(v: Array, k: int | Array, half: bool) -> Array:
    return v[k:] if half else _shifted(v, k)


def _gap(v: Array, k: int | Array, half: bool) -> Array:
    return _first(v, k, half) - _second(v, k, half)


def _both(force: Array, k: int | Array, half: bool) -> Array:
    """Action on the first robot of each pair and reaction on the second, at the robots' own places."""
    return jnp.concatenate([force, -force]) if half else force - _shifted(force, force.shape[0] - k)
