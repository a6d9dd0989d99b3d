"""Quality of control: the AUC of the tracking disagreement, QoC, and further metrics of a run (model, section 5)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from qocjax import _checks
from qocjax.pairs import closest_squared
from qocjax.robots import Piece, Pose
from qocjax.scenario import Design, Scenario

__all__ = ["QocScale", "Tally", "initial_norm", "qoc", "qoc_slope"]


@dataclass(frozen=True)
class QocScale:
    """What turns an AUC into a QoC: the median and the largest AUC over all runs of a study (model, section 5)."""

    median: float  # J_med, s
    largest: float  # J_max, s
    median_se: float = 0.0  # s, standard error of J_med where it was estimated; 0 where it is given

    def __post_init__(self) -> None:
        _checks.bounded("J_med", self.median, above=0)
        _checks.bounded("J_max", self.largest, least=0)
        _checks.bounded("J_med's error", self.median_se, least=0)

    @classmethod
    def of(cls, auc: ArrayLike) -> QocScale:
        """Scale from all AUC values of a study, non-finite ones (diverged runs) left out.

        Raises:
            ValueError: None is finite.
        """
        values = np.asarray(auc, np.float64)
        values = values[np.isfinite(values)]
        if values.size == 0:
            raise ValueError("auc: got no finite value, expected the AUC of at least one run")
        return cls(float(np.median(values)), float(np.max(values)))


def qoc(auc: ArrayLike, scale: QocScale) -> Array | np.ndarray:
    """Q = 1 / (1 + min(J_max, J) / J_med), elementwise (paper, Eq. 18); NumPy in, NumPy out."""
    xp = jnp if isinstance(auc, jax.Array) else np
    return 1.0 / (1.0 + xp.minimum(xp.asarray(auc), scale.largest) / scale.median)


def qoc_slope(auc: ArrayLike, scale: QocScale) -> np.ndarray:
    """dQ/dJ (1/s), elementwise; 0 from J_max on, where Q is flat."""
    score = qoc(np.asarray(auc), scale)
    return np.where(np.asarray(auc) < scale.largest, -(score**2) / scale.median, 0.0)


def initial_norm(scenario: Scenario, start: Array, goal: Array, origin: tuple[Array, Array]) -> Array:
    """What |delta_i|²_W is divided by, [N, *B]: its initial value, or the initial distance to the goal (m²).

    Args:
        scenario: The normaliser and the weights.
        start: [N, 3, *B] start poses.
        goal: [N, 2, *1] goals.
        origin: Start of the reference, each coordinate [1 or N, *B].
    """
    from_x, from_y = origin if scenario.normaliser == "initial_disagreement" else (goal[:, 0], goal[:, 1])
    return _weighted(scenario, start[:, 0] - from_x, start[:, 1] - from_y)


def _weighted(scenario: Scenario, x: Array, y: Array) -> Array:
    weights = jnp.asarray(scenario.weights)
    return weights[0] * x * x + weights[1] * y * y


Ends = tuple[tuple[Array, Array], tuple[Array, Array]]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Tally:
    """Running totals of a run: what the loop carries of the metrics."""

    integral: Array  # [N, *B] ∫ |delta|²_W dt, m² s
    path_length: Array  # [N, *B] ∫ |velocity| dt, m
    effort: Array  # [N, *B] ∫ of the squares of all speeds dt, mixed units as in the paper's "control effort"
    closest: Array  # [*B] smallest squared distance between robots at the sampling instants, m²
    last_away: Array  # [N, *B] last sampling instant (tick) farther than 2 d_safe from the goal, -1 for none

    @classmethod
    def zero(cls, pose: Pose) -> Tally:
        """Before the first tick."""
        zero = jnp.zeros_like(pose.x)
        return cls(zero, zero, zero, jnp.full(pose.x.shape[1:], jnp.inf, pose.x.dtype), zero - 1.0)

    def at_instant(self, tick: Array | int, pose: Pose, goal: tuple[Array, Array], design: Design) -> Tally:
        """Takes in what is read at a sampling instant."""
        away = (pose.x - goal[0]) ** 2 + (pose.y - goal[1]) ** 2 > (2.0 * design.d_safe) ** 2
        return Tally(
            self.integral,
            self.path_length,
            self.effort,
            jnp.minimum(self.closest, closest_squared(pose.x, pose.y)),
            jnp.where(away, jnp.asarray(tick, self.last_away.dtype), self.last_away),
        )

    def over_piece(self, scenario: Scenario, error: Ends, pose: Pose, piece: Piece) -> Tally:
        """Takes in a piece of motion.

        The squared disagreement is integrated by the trapezoid corrected with its slopes at both ends, h/2 (f + f') +
        h²/12 (df - df'), which is exact for cubics; over a piece the reference counts as straight.

        Args:
            scenario: The weights W.
            error: delta at the beginning and at the end, each a pair of coordinates [N, *B].
            pose: At the beginning.
            piece: What is moved.
        """
        return replace(
            self,
            integral=self.integral + self._area(scenario, error, pose, piece),
            path_length=self.path_length + piece.length,
            effort=self.effort + piece.effort,
        )

    def _area(self, scenario: Scenario, error: Ends, pose: Pose, piece: Piece) -> Array:
        """∫ |delta|²_W dt of a piece."""
        weights = jnp.asarray(scenario.weights)
        (x, y), (next_x, next_y) = error
        begin, end, last = piece.slope_begin, piece.slope_end, piece.pose
        along_x = self._axis(x, next_x, last.x - pose.x, begin[0], end[0])
        along_y = self._axis(y, next_y, last.y - pose.y, begin[1], end[1])
        return (1 / 6) * piece.duration * (weights[0] * along_x + weights[1] * along_y)

    @staticmethod
    def _axis(a: Array, b: Array, moved: Array, heads: Array, next_heads: Array) -> Array:
        """Six times the mean squared disagreement along an axis, from a to b; `heads` are the slopes of motion times h.

        3 (a² + b²) + a (heads - r) - b (next_heads - r), where the reference moves by r, in the fewest operations.
        """
        change = b - a
        return a * (3.0 * a + heads) + b * (3.0 * b - next_heads) + (moved - change) * change
