"""Estimators of the gradient of the mean QoC: pathwise, robust means of it, smoothed, and a blend of the two.

The derivative of a run is exact and its mean over seeds still useless where robots contest their goal: the tails are
heavy (Metz et al. 2021, "Gradients are not all you need"). Differences over a finite width have none, but a bias (Suh
et al. 2022, "Do differentiable simulators give better policy gradients?").
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from qocjax import _checks
from qocjax.statistics.estimates import standard_error
from qocjax.tuning.problem import Problem

__all__ = ["ESTIMATORS", "Blend", "Estimator", "Pathwise", "Slopes", "Smoothed", "clipped", "make_estimator", "mean"]

# Turns derivatives by seed [S, d] into a gradient [d] and the variance of each of its components [d].
Combine = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Slopes:
    """What an estimator says of G points."""

    qoc: np.ndarray  # [G] mean over seeds, and over the perturbed designs where there are any
    qoc_se: np.ndarray  # [G]
    gradient: np.ndarray  # [G, d] of the mean QoC in the free coordinates
    variance: np.ndarray  # [G, d] of the gradient, as measured over the seeds
    dropped: int  # derivatives of single runs that were not finite and left out


class Estimator(Protocol):
    """Estimates the gradient of the mean QoC at every point."""

    perturbs: ClassVar[bool]  # whether it reads the width

    def __call__(
        self, problem: Problem, free: np.ndarray, seeds: Sequence[int], rng: np.random.Generator, width: float
    ) -> Slopes:
        """Args: the problem, points [G, d], seeds common to all of them, randomness and width of perturbations."""
        ...


def mean(slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The plain mean over seeds."""
    return slopes.mean(axis=0), slopes.var(axis=0, ddof=1) / len(slopes)


def clipped(slopes: np.ndarray, limit: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """Mean of derivatives that are shortened to `limit` times their median length."""
    length = np.linalg.norm(slopes, axis=1, keepdims=True)
    most = limit * np.median(length)
    return mean(slopes * np.minimum(1.0, most / np.where(length > 0.0, length, 1.0)))


def median_of_means(slopes: np.ndarray, blocks: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Median over blocks of seeds of the means within them; its variance is that of a normal sample's median."""
    parts = np.stack([part.mean(axis=0) for part in np.array_split(slopes, min(blocks, len(slopes)))])
    return np.median(parts, axis=0), 0.5 * np.pi * parts.var(axis=0, ddof=1) / len(parts)


@dataclass(frozen=True)
class Pathwise:
    """Derivatives of single runs, combined over the seeds. Perturbs nothing, so reads neither `rng` nor `width`."""

    perturbs: ClassVar[bool] = False
    combine: Combine = mean

    def __call__(
        self, problem: Problem, free: np.ndarray, seeds: Sequence[int], rng: np.random.Generator, width: float
    ) -> Slopes:
        """See `Estimator`.

        Raises:
            ValueError: At some point fewer than two runs have finite derivatives.
        """
        scores, slopes = problem.pathwise(free, seeds)
        finite = np.isfinite(slopes).all(axis=-1)
        for point in np.flatnonzero(finite.sum(axis=1) < 2):
            values = zip(problem.bounds.names, problem.bounds.values(free[point]), strict=True)
            raise ValueError(
                f"gradient: got finite derivatives in {finite[point].sum()} of {len(seeds)} runs at "
                + ", ".join(f"{name}={value:.4g}" for name, value in values)
                + f", deadline={problem.deadlines[point]:g} s, expected 2 or more (more seeds, or `smoothed`)"
            )
        combined = [self.combine(of_point[kept]) for of_point, kept in zip(slopes, finite, strict=True)]
        gradient, variance = (np.stack(part) for part in zip(*combined, strict=True))
        return Slopes(scores.mean(axis=1), standard_error(scores), gradient, variance, int((~finite).sum()))


@dataclass(frozen=True)
class Smoothed:
    """Antithetic differences along random orthogonal directions: the gradient of QoC averaged over a width.

    At each point, d directions e_k of length sqrt(d) form a randomly turned cross; with common random numbers
    g = mean_k e_k (Q(u + width e_k) - Q(u - width e_k)) / (2 width). It costs 2 d simulations per seed.
    """

    perturbs: ClassVar[bool] = True

    def __call__(
        self, problem: Problem, free: np.ndarray, seeds: Sequence[int], rng: np.random.Generator, width: float
    ) -> Slopes:
        """See `Estimator`."""
        points, size = free.shape
        directions = np.sqrt(size) * np.stack([_turned(size, rng) for _ in range(points)])  # [G, d, d], a row each
        steps = width * np.concatenate([directions, -directions], axis=1)
        scores = problem.scores(free[:, None, :] + steps, seeds)  # [G, 2d, S]
        gaps = (scores[:, :size] - scores[:, size:]) / (2.0 * width)
        by_seed = np.einsum("gks,gkd->gsd", gaps, directions) / size
        found = [mean(of_point) for of_point in by_seed]
        gradient, variance = (np.stack(part) for part in zip(*found, strict=True))
        averages = scores.mean(axis=1)
        return Slopes(averages.mean(axis=1), standard_error(averages), gradient, variance, 0)


@dataclass(frozen=True)
class Blend:
    """Pathwise and smoothed, each component weighed by the other's measured variance."""

    perturbs: ClassVar[bool] = True
    pathwise: Estimator = Pathwise()
    smoothed: Estimator = Smoothed()

    def __call__(
        self, problem: Problem, free: np.ndarray, seeds: Sequence[int], rng: np.random.Generator, width: float
    ) -> Slopes:
        """See `Estimator`."""
        a = self.pathwise(problem, free, seeds, rng, width)
        b = self.smoothed(problem, free, seeds, rng, width)
        both = a.variance + b.variance
        weight = np.where(both > 0.0, b.variance / np.where(both > 0.0, both, 1.0), 0.5)
        gradient = weight * a.gradient + (1.0 - weight) * b.gradient
        variance = weight**2 * a.variance + (1.0 - weight) ** 2 * b.variance
        return Slopes(a.qoc, a.qoc_se, gradient, variance, a.dropped + b.dropped)


ESTIMATORS: dict[str, Estimator] = {
    "pathwise": Pathwise(),
    "clipped": Pathwise(clipped),
    "median_of_means": Pathwise(median_of_means),
    "smoothed": Smoothed(),
    "blend": Blend(),
}


def make_estimator(name: str) -> Estimator:
    """The estimator of that name.

    Raises:
        ValueError: There is none.
    """
    return ESTIMATORS[_checks.choice("estimator", name, ESTIMATORS)]


def _turned(size: int, rng: np.random.Generator) -> np.ndarray:
    """A random orthogonal matrix, uniform over all (QR of a normal matrix, signs fixed)."""
    q, r = np.linalg.qr(rng.standard_normal((size, size)))
    return q * np.sign(np.diag(r))
