"""Random numbers of one width: a key draws the same ones whether 64 bits are on or not.

JAX draws other numbers altogether in float64, so that a run in float64 would not check one in float32. What is drawn
here is drawn in 32 bits, and then takes the default float type, in which all that follows is computed.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import Array

__all__ = ["bernoulli", "exponential", "gamma", "normal", "truncated_normal", "uniform", "whole"]

Shape = tuple[int, ...]


def _widened(drawn: Array) -> Array:
    return drawn.astype(jnp.result_type(float))


def uniform(key: Array, shape: Shape = (), least: float = 0.0) -> Array:
    """Between `least` and 1."""
    return _widened(jax.random.uniform(key, shape, jnp.float32, minval=least))


def normal(key: Array, shape: Shape = ()) -> Array:
    """Standard normal."""
    return _widened(jax.random.normal(key, shape, jnp.float32))


def truncated_normal(key: Array, low: float, high: float, shape: Shape = ()) -> Array:
    """Standard normal between two bounds."""
    return _widened(jax.random.truncated_normal(key, low, high, shape, jnp.float32))


def gamma(key: Array, order: float, shape: Shape = ()) -> Array:
    """Gamma of that order and scale 1."""
    return _widened(jax.random.gamma(key, jnp.float32(order), shape, jnp.float32))


def exponential(key: Array, shape: Shape = ()) -> Array:
    """Of mean 1."""
    return _widened(jax.random.exponential(key, shape, jnp.float32))


def bernoulli(key: Array, probability: float | Array, shape: Shape | None = None) -> Array:
    """True with that probability."""
    return jax.random.bernoulli(key, jnp.asarray(probability, jnp.float32), shape)


def whole(key: Array, below: int | Array, shape: Shape = ()) -> Array:
    """Whole numbers from 0."""
    return jax.random.randint(key, shape, 0, below, jnp.int32)
