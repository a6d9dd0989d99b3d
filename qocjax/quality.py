"""Quality of control: the AUC of the tracking disagreement, QoC, and further metrics of a run (model, section 5)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from qocjax import _checks
from qocjax._math import at_most
from qocjax.pairs import closest_squared
from qocjax.robots import Command, Piece, Pose
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


class Yardstick(NamedTuple):
    """What the disagreement is measured by: a reference on a line, at `goal + left * way`, and the weights."""

    goal: tuple[Array, Array]  # where it ends (m), each broadcastable to [N, *B]
    way: tuple[Array, Array]  # from there to where it starts (m)
    weights: ArrayLike  # [2] W


class Side(NamedTuple):
    """A piece of motion, seen from the instant at one of its ends."""

    duration: Array  # h (s), broadcastable to [N, *B]
    speed: Command  # there, in the robots' own frames
    drawn: Array | None = None  # `qocjax.timeline.Stretch`; None where what reads it is known beforehand


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
            at_most(closest_squared(pose.x, pose.y), self.closest),
            jnp.where(away, jnp.asarray(tick, self.last_away.dtype), self.last_away),
        )

    def at_kink(
        self, yardstick: Yardstick, pose: Pose, before: Side, after: Side, left: Array, bend: Array | None = None
    ) -> Tally:
        """Takes in the share that an instant between two pieces of motion has in the squared disagreement.

        This is integrated over each piece by the trapezoid corrected with its slopes at both ends, h/2 (f + f') +
        h²/12 (df - df'), which is exact for cubics; the reference counts as straight. Both pieces' terms at the instant
        are one product: with e the disagreement and v the velocity relative to the reference, before and after,
        e · ((h + h')/2 e + (h'² v' - h² v)/6).

        Args:
            yardstick: What is measured by.
            pose: At the instant.
            before: The piece that ends.
            after: The piece that begins.
            left: Share of the reference's way that is left.
            bend: What is drawn after less before, if the sides do not have it.
        """
        if bend is None:
            assert before.drawn is not None and after.drawn is not None  # for the type checker
            bend = after.drawn - before.drawn
        squares = [(1 / 6) * side.duration * side.duration for side in (before, after)]
        half = 0.5 * (before.duration + after.duration)
        turn = jax.tree.map(lambda v, w: squares[1] * w - squares[0] * v, before.speed, after.speed)
        change_x, change_y = turn.nu * pose.cos, turn.nu * pose.sin
        if turn.nu_y is not None:
            change_x, change_y = change_x - turn.nu_y * pose.sin, change_y + turn.nu_y * pose.cos
        (goal_x, goal_y), (way_x, way_y), weights = yardstick
        e_x, e_y = pose.x - goal_x - left * way_x, pose.y - goal_y - left * way_y
        share_x, share_y = e_x * (half * e_x + change_x - bend * way_x), e_y * (half * e_y + change_y - bend * way_y)
        weights = jnp.asarray(weights)
        return replace(self, integral=self.integral + (weights[0] * share_x + weights[1] * share_y))

    def over_piece(self, piece: Piece) -> Tally:
        """Takes in what a piece of motion adds."""
        return replace(self, path_length=self.path_length + piece.length, effort=self.effort + piece.effort)
