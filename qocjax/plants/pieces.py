"""A linear plant between two changes of command, exactly: motion, covariance of the noise, and cost.

All of it comes from exponentials of block matrices (Van Loan, "Computing integrals involving the matrix exponential",
IEEE Transactions on Automatic Control 23(3), 1978), so that no step size is to be chosen.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array
from jax.scipy.linalg import block_diag, expm

__all__ = ["Piece", "over"]


class Piece(NamedTuple):
    """A piece of length h under a constant command u, of x' = Ax + Bu + w."""

    motion: Array  # [n, n+m], x(h) = motion [x; u] + noise
    noise: Array  # [n, n], factor G of the covariance G G' of the noise
    cost: Array  # [n+m, n+m], of the integral of x'Qx + u'Ru without noise
    drift: Array  # what the noise adds to that integral in the mean


def over(h: Array, a: Array, b: Array, w: Array, q: Array, r: Array) -> Piece:
    """Works out a piece.

    With z = [x; u], F its matrix and S the cost's: cost C(h) = ∫_0^h e^{F's} S e^{Fs} ds, drift tr(W ∫_0^h C_xx(s) ds),
    covariance ∫_0^h e^{As} W e^{A's} ds.

    Args:
        h: Length (s); 0 gives a piece that moves nothing.
        a: [n, n] A (1/s).
        b: [n, m] B.
        w: [n, n] intensity W of the white noise.
        q: [n, n] Q.
        r: [m, m] R.
    """
    n, m = b.shape
    f = jnp.block([[a, b], [jnp.zeros((m, n + m), a.dtype)]])
    s = jnp.block([[q, jnp.zeros((n, m), a.dtype)], [jnp.zeros((m, n), a.dtype), r]])
    none, one = jnp.zeros_like(f), jnp.eye(n + m, dtype=a.dtype)
    k = n + m
    integrals = jnp.block([[-f.T, one, none], [none, -f.T, s], [none, none, f]])
    spread = jnp.block([[-a, w], [jnp.zeros_like(a), a.T]])
    both = expm(h * block_diag(integrals, spread))  # one exponential compiles in half the time of two
    forward = both[2 * k : 3 * k, 2 * k : 3 * k]
    cost = forward.T @ both[k : 2 * k, 2 * k : 3 * k]
    of_noise = (forward.T @ both[:k, 2 * k : 3 * k])[:n, :n]
    covariance = both[3 * k + n :, 3 * k + n :].T @ both[3 * k : 3 * k + n, 3 * k + n :]
    # By eigenvalues and not by Cholesky's factor: it may be singular, and is zero where h is.
    values, vectors = jnp.linalg.eigh(0.5 * (covariance + covariance.T))
    factor = vectors * jnp.sqrt(jnp.maximum(values, 0.0))[None]
    return Piece(forward[:n], factor, 0.5 * (cost + cost.T), jnp.sum(w * of_noise))
