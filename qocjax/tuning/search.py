"""Gradient ascent from every start at every deadline at once, on new seeds in each step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np
import optax
import pandas as pd

from qocjax import _checks
from qocjax.tuning.estimators import Estimator, Slopes, Smoothed
from qocjax.tuning.problem import Problem

__all__ = ["Search", "Trail", "search"]

_FARTHEST = 4.0  # of a free coordinate from the middle: 1.8 % of the scale off a bound; beyond, QoC is flat in it


@dataclass(frozen=True)
class Search:
    """How to search.

    Attributes:
        rule: Optax rule, with its schedule; it minimises, and is given the negative gradient.
        estimator: Of the gradient.
        steps: At most so many.
        seeds: Monte Carlo seeds of one step; each step has new ones, so that no design is fitted to a few seeds.
        width: Width of the perturbations in the first step, in free coordinates.
        last_width: In the last; in between it shrinks by equal ratios, so that a search first sees the large shape.
        average: Share of the steps, the last ones, over whose points the result is averaged.
        patience: QoC has settled where its mean over so many steps gained less over as many before than `tolerance` or
            two standard errors of that gain, at every point. The width is then halved, and the search stops where it is
            `last_width` already. 0 never stops early.
        tolerance: See there.
        random: Seed of the perturbations' directions.
    """

    rule: optax.GradientTransformation
    estimator: Estimator = field(default_factory=Smoothed)
    steps: int = 56
    seeds: int = 16
    width: float = 2.0
    last_width: float = 0.2
    average: float = 0.3
    patience: int = 10
    tolerance: float = 1e-4
    random: int = 0

    def __post_init__(self) -> None:
        _checks.count("steps", self.steps)
        _checks.count("seeds", self.seeds, least=2)
        _checks.count("patience", self.patience, least=0)
        _checks.bounded("width", self.width, above=0)
        _checks.bounded("last_width", self.last_width, above=0)
        _checks.bounded("tolerance", self.tolerance, least=0)
        _checks.bounded("average", self.average, above=0, most=1)

    def width_at(self, step: int) -> float:
        """Width of the perturbations in a step."""
        return float(self.width * (self.last_width / self.width) ** (step / max(self.steps - 1, 1)))


@dataclass(frozen=True)
class Trail:
    """Where a search went."""

    result: np.ndarray  # [G, d] free coordinates, mean over the last steps
    table: pd.DataFrame  # one row per step and point
    dropped: int  # derivatives of single runs that were not finite
    stopped_early: bool


def search(
    problem: Problem,
    start: np.ndarray,
    settings: Search,
    first_seed: int,
    progress: Callable[[Slopes], None] | None = None,
) -> Trail:
    """Ascends the mean QoC from all points at once.

    Args:
        problem: What is maximised.
        start: [G, d] free coordinates.
        settings: How.
        first_seed: Step k takes the seeds first_seed + k S ... of S each.
        progress: Called after each step.

    Raises:
        ValueError: At some point too few runs have finite derivatives.
    """
    rng = np.random.default_rng(settings.random)
    free = jnp.asarray(np.clip(start, -_FARTHEST, _FARTHEST))
    state = settings.rule.init(free)
    points, found, spent = [np.asarray(free, np.float64)], [], []
    early, since = False, 0
    widest = settings.width if settings.estimator.perturbs else settings.last_width
    for step in range(settings.steps):
        width = min(settings.width_at(step), widest)
        seeds = range(first_seed + step * settings.seeds, first_seed + (step + 1) * settings.seeds)
        slopes = settings.estimator(problem, points[-1], seeds, rng, width)
        found.append(slopes)
        spent.append(problem.objective.simulations)
        updates, state = settings.rule.update(-jnp.asarray(slopes.gradient, free.dtype), state, free)
        free = jnp.clip(optax.apply_updates(free, updates), -_FARTHEST, _FARTHEST)
        points.append(np.asarray(free, np.float64))
        if progress is not None:
            progress(slopes)
        if _settled(found[since:], settings):
            if early := width <= settings.last_width and step + 1 < settings.steps:
                break
            widest, since = max(width / 2.0, settings.last_width), step + 1
    last = max(1, round(settings.average * len(found)))
    table = _table(problem, points, found, spent)
    return Trail(np.mean(points[-last:], axis=0), table, sum(s.dropped for s in found), early)


def _settled(found: list[Slopes], settings: Search) -> bool:
    """Whether QoC has stopped growing at every point, as far as the seeds can tell."""
    span = settings.patience
    if span == 0 or len(found) < 2 * span:
        return False
    scores = np.stack([s.qoc for s in found[-2 * span :]])
    gain = scores[span:].mean(axis=0) - scores[:span].mean(axis=0)
    error = np.sqrt(np.sum([s.qoc_se**2 for s in found[-2 * span :]], axis=0)) / span
    return bool(np.all(gain <= np.maximum(settings.tolerance, 2.0 * error)))


def _table(problem: Problem, points: list[np.ndarray], found: list[Slopes], spent: list[int]) -> pd.DataFrame:
    """One row per step and point: values, QoC, gradient in the free coordinates, simulations so far."""
    names, size = problem.bounds.names, len(problem.deadlines)
    steps = len(found)
    columns: dict[str, np.ndarray] = {
        "step": np.repeat(np.arange(steps), size),
        "point": np.tile(np.arange(size), steps),
        "deadline": np.tile(problem.deadlines, steps),
    }
    values = problem.bounds.values(np.concatenate(points[:-1]))
    gradient, variance = (np.concatenate([getattr(s, name) for s in found]) for name in ("gradient", "variance"))
    columns |= {name: values[:, k] for k, name in enumerate(names)}
    columns |= {name: np.concatenate([getattr(s, name) for s in found]) for name in ("qoc", "qoc_se")}
    columns |= {f"slope_{name}": gradient[:, k] for k, name in enumerate(names)}
    columns |= {f"slope_{name}_se": np.sqrt(variance[:, k]) for k, name in enumerate(names)}
    return pd.DataFrame(columns | {"simulations": np.repeat(spent, size)})
