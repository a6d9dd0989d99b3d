"""Ascent by gradients, from the best points of another method."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from qocjax.search.trial import BudgetSpentError, Trial

__all__ = ["ascent_from", "clipped_mean"]

_SHARE = 0.5  # of the budget, for the method that finds the starts
_STARTS = 2
_RATE, _DECAY, _SMALLEST = 0.05, 0.93, 0.003  # length of a step in the unit cube: at first, per step, at last
_BETA_1, _BETA_2, _EPSILON = 0.8, 0.95, 1e-8  # Adam (Kingma and Ba, 2015), with short memories for few steps
_PROBE = 0.01  # half the distance of the deadline's central difference, in the unit cube


def ascent_from(first: Callable[[Trial], None]) -> Callable[[Trial], None]:
    """A method that spends half its budget on another one and climbs from its two best points with the rest.

    The continuous values climb by the pathwise gradient, clipped per seed; a continuous deadline by a central
    difference under common random numbers; tau and a deadline from a list stay. A step that breaks the limits is taken
    back and halved, since the gradient does not see them.
    """

    def method(trial: Trial) -> None:
        trial.stop = trial.spent + int(_SHARE * trial.left)
        try:
            first(trial)
        except BudgetSpentError:
            pass
        trial.stop = trial.budget
        climbs = [_Climb(known.unit.copy()) for known in trial.finalists(_STARTS)]
        if not climbs:
            raise BudgetSpentError
        while True:
            for climb in climbs:
                climb.step(trial)

    return method


class _Climb:
    """One start with its Adam state."""

    def __init__(self, unit: np.ndarray) -> None:
        self.unit = unit
        self.before = unit.copy()
        self.first = np.zeros_like(unit)
        self.second = np.zeros_like(unit)
        self.count = 0
        self.rate = _RATE

    def step(self, trial: Trial) -> None:
        seeds = trial.fresh_seeds()
        if trial.evaluate(self.unit[None], seeds)[0] < 0 and not np.array_equal(self.unit, self.before):
            self.unit = self.before + 0.5 * (self.unit - self.before)
            self.rate = max(0.5 * self.rate, _SMALLEST)
            return
        slope = self._slope(trial, seeds)
        self.count += 1
        self.first = _BETA_1 * self.first + (1 - _BETA_1) * slope
        self.second = _BETA_2 * self.second + (1 - _BETA_2) * slope**2
        ahead = self.first / (1 - _BETA_1**self.count)
        size = np.sqrt(self.second / (1 - _BETA_2**self.count)) + _EPSILON
        self.before = self.unit.copy()
        self.unit = np.clip(self.unit + self.rate * ahead / size, 0.0, 1.0)
        self.rate = max(self.rate * _DECAY, _SMALLEST)

    def _slope(self, trial: Trial, seeds: range) -> np.ndarray:
        """Direction of ascent, [D]; zero where nothing is known."""
        space = trial.problem.space
        slope = np.zeros_like(self.unit)
        slope[: len(space.bounds)] = clipped_mean(trial.slopes(self.unit[None], seeds)[0])
        if not space.deadline_axis:
            ends = np.tile(self.unit, (2, 1))
            ends[:, -2] = np.clip(self.unit[-2], 1.5 * _PROBE, 1 - 1.5 * _PROBE) + np.array([-_PROBE, _PROBE])
            low, high = trial.evaluate(ends, seeds)
            if min(low, high) >= 0:  # an end that breaks the limits has no score to compare
                slope[-2] = (high - low) / (ends[1, -2] - ends[0, -2])
        return slope


def clipped_mean(slopes: np.ndarray) -> np.ndarray:
    """Mean over seeds of gradients [S, K], each no longer than the median one: the tails are heavy.

    Raises:
        ValueError: No gradient is finite.
    """
    finite = slopes[np.isfinite(slopes).all(axis=1)]
    if len(finite) == 0:
        raise ValueError(f"gradient: got no finite one on {len(slopes)} seeds, expected at least one; narrower bounds "
                         "or another method avoid the designs that diverge")  # fmt: skip
    length = np.linalg.norm(finite, axis=1)
    limit = np.median(length)
    return (finite * np.where(length > limit, limit / np.maximum(length, 1e-300), 1.0)[:, None]).mean(axis=0)
