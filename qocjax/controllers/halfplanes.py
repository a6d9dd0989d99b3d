"""The point of a set of half-planes that is nearest to a given one, in closed form."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

__all__ = ["HalfPlanes", "nearest"]

_PARALLEL = 1e-6  # sine of the angle below which two borders have no corner
_SLACK = {"float32": 2e-5, "float64": 1e-11}  # by which a candidate may miss a border, relative to the numbers at hand


class HalfPlanes(NamedTuple):
    """M of them, n_m · v >= b_m with |n_m| = 1."""

    x: Array  # [M, *B] of n
    y: Array  # [M, *B]
    bound: Array  # [M, *B] b


def nearest(x: Array, y: Array, planes: HalfPlanes) -> tuple[Array, Array, Array]:
    """The point nearest to (x, y) in all half-planes.

    A quadratic programme in two variables: at most two borders are active at its solution (Karush-Kuhn-Tucker), so that
    it is the nearest admissible one of the point itself, its feet on the borders and the borders' corners.

    Args:
        x: [*B] of the given point.
        y: [*B]
        planes: The half-planes.

    Returns:
        The two coordinates, [*B], and whether there is an admissible point. Where there is none, the candidate that
        violates the worst half-plane least.
    """
    at_x, at_y, real = (jnp.stack(each) for each in zip(*_candidates(x, y, planes), strict=True))
    violation = jnp.full_like(at_x, -jnp.inf)
    for n_x, n_y, bound in zip(*(each[:, None] for each in planes), strict=True):
        violation = jnp.maximum(violation, bound - n_x * at_x - n_y * at_y)
    slack = _SLACK[str(x.dtype)] * (1.0 + jnp.abs(x) + jnp.abs(y) + jnp.abs(planes.bound).max(axis=0, initial=0.0))
    distance = jnp.square(at_x - x[None]) + jnp.square(at_y - y[None])
    distance = jnp.where(real & (violation <= slack[None]), distance, jnp.inf)
    admissible = jnp.isfinite(distance).any(axis=0)
    least = jnp.argmin(jnp.where(real, violation, jnp.inf), axis=0)
    best = jnp.where(admissible, jnp.argmin(distance, axis=0), least)[None]
    found_x, found_y = (jnp.take_along_axis(each, best, axis=0, mode="promise_in_bounds")[0] for each in (at_x, at_y))
    return found_x, found_y, admissible


def _candidates(x: Array, y: Array, planes: HalfPlanes) -> Iterator[tuple[Array, Array, Array]]:
    """Where the solution can be, and whether that is there at all: parallel borders have no corner."""
    there = jnp.ones_like(x, bool)
    yield x, y, there
    for n_x, n_y, bound in zip(*planes, strict=True):
        missing = bound - n_x * x - n_y * y
        yield x + missing * n_x, y + missing * n_y, there
    for one, other in combinations(zip(*planes, strict=True), 2):
        sine = one[0] * other[1] - other[0] * one[1]
        crossing = jnp.abs(sine) >= _PARALLEL
        sine = jnp.where(crossing, sine, 1.0)
        corner_x = (one[2] * other[1] - other[2] * one[1]) / sine
        corner_y = (other[2] * one[0] - one[2] * other[0]) / sine
        yield corner_x, corner_y, crossing
