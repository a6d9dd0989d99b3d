"""A linear plant with linear feedback, x' = Ax + Bu + w and u = -Kx, ready for the loop that robots have."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from qocjax import _checks, _draws
from qocjax.plants import pieces
from qocjax.plants.driven import Instant, Move, Plant

__all__ = ["LinearPlant", "LinearState", "begin", "in_pieces", "prepared"]


class LinearState(NamedTuple):
    """N plants at one instant."""

    x: Array  # [n, N]
    cost: Array  # [N], since the first tick that counts


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LinearPlant:
    """x' = Ax + Bu + w with u = -Kx from sampled states, judged by the integral of x'Qx + u'Ru.

    Attributes:
        a: [n, n] A (1/s).
        b: [n, m] B.
        k: [m, n] K.
        q: [n, n] Q, weighs the state.
        r: [m, m] R, weighs the command.
        w: [n, n] intensity W of the white noise w, of covariance W δ(t - s); zeros for none.
    """

    a: ArrayLike
    b: ArrayLike
    k: ArrayLike
    q: ArrayLike
    r: ArrayLike
    w: ArrayLike

    @property
    def inputs(self) -> int:
        """Number m of components of a command."""
        return np.shape(self.b)[1]

    def check(self) -> None:
        """Checks shapes and signs.

        Raises:
            TypeError: A matrix holds no real numbers.
            ValueError: One has the wrong shape, or Q, R or W is not symmetric or not positive semidefinite.
        """
        n = np.shape(_checks.numbers("a", self.a, (None, None)))[0]
        m = np.shape(_checks.numbers("b", self.b, (n, None)))[1]
        for name, shape in (("a", (n, n)), ("k", (m, n)), ("q", (n, n)), ("r", (m, m)), ("w", (n, n))):
            value = _checks.numbers(name, getattr(self, name), shape)
            if name not in "qrw" or not _checks.is_concrete(value):
                continue
            matrix = np.asarray(value, np.float64)
            if not np.allclose(matrix, matrix.T):
                raise ValueError(f"{name}: got a matrix that is not symmetric, expected a symmetric one")
            if (least := np.linalg.eigvalsh(matrix).min()) < -1e-9 * max(1.0, np.abs(matrix).max()):
                raise ValueError(f"{name}: got the eigenvalue {least:.3g}, expected all >= 0")


def begin(plant: LinearPlant, start: ArrayLike | None, loops: int) -> tuple[LinearPlant, LinearState]:
    """The plant with its matrices as arrays, and N states at rest or at `start`."""
    if not isinstance(plant, LinearPlant):
        raise TypeError(f"plant: got {type(plant).__name__}, expected a LinearPlant")
    plant.check()
    kind, n = jnp.result_type(float), np.shape(plant.a)[0]
    begin = np.zeros(n) if start is None else _checks.numbers("start", start)
    if np.shape(begin) not in {(n,), (loops, n)}:
        raise ValueError(f"start: got shape {np.shape(begin)}, expected ({n},) or ({loops}, {n})")
    x = jnp.broadcast_to(jnp.asarray(begin, kind), (loops, n)).T
    arrays = LinearPlant(**{item.name: jnp.asarray(getattr(plant, item.name), kind) for item in fields(plant)})
    return arrays, LinearState(x, jnp.zeros(loops, kind))


@jax.jit
def in_pieces(plant: LinearPlant, lengths: Array) -> pieces.Piece:
    """Pieces [D, L] of these lengths; a program of its own, which all rules share."""
    matrices = [jnp.asarray(each) for each in (plant.a, plant.b, plant.w, plant.q, plant.r)]
    return jax.vmap(jax.vmap(lambda h: pieces.over(h, *matrices)))(lengths)


def prepared(k: Array, found: pieces.Piece, warm_up: int | Array) -> Plant[LinearState]:
    """The plant in pieces [L], with costs that count from the tick `warm_up` on."""
    count = found.motion.shape[0]

    def over(at: int) -> Move[LinearState]:
        piece = jax.tree.map(lambda leaf: leaf[at], found)

        def move(state: LinearState, command: Array, when: Instant) -> LinearState:
            z = jnp.concatenate([state.x, command])
            added = jnp.sum(z * (piece.cost @ z), axis=0) + piece.drift
            # Each piece asks for the draws of the whole period and takes its own: equal calls compile to one.
            noise = _draws.normal(when.key, (count, *state.x.shape)).astype(state.x.dtype)[at]
            cost = state.cost + jnp.where(when.tick >= warm_up, added, 0.0)
            return LinearState(piece.motion @ z + piece.noise @ noise, cost)

        return move

    return Plant(lambda state: -k @ state.x, tuple(over(at) for at in range(count)), k.shape[0])
