"""How QoC changes with the design, nearby and over a whole box."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from qocjax import _checks
from qocjax._lazy import stats
from qocjax.scenario import Design
from qocjax.search.objective import Objective
from qocjax.statistics.estimates import relative
from qocjax.tunables import CONTINUOUS

__all__ = ["Box", "elasticities", "sobol"]

_RESAMPLES = 999


@dataclass(frozen=True)
class Box:
    """Bounds of continuous parameters, in log scale where both are positive; others stay at a baseline."""

    baseline: Design
    bounds: Mapping[str, tuple[float, float]]

    def __post_init__(self) -> None:
        if not self.bounds:
            raise ValueError(f"bounds: got none, expected at least one of {', '.join(CONTINUOUS)}")
        for name, ends in self.bounds.items():
            _checks.choice("bounds", name, (*CONTINUOUS, *self.baseline.others))
            low, high = _checks.bounded(f"bounds.{name}", np.asarray(ends, float), least=0, shape=(2,))
            if not low < high:
                raise ValueError(f"bounds.{name}: got [{low:g}, {high:g}], expected the first below the second")

    def values(self, unit: np.ndarray) -> dict[str, np.ndarray]:
        """Parameters [P] by name, of points [P, K] of the unit cube."""
        found = {}
        for u, (name, (low, high)) in zip(unit.T, self.bounds.items(), strict=True):
            found[name] = low * (high / low) ** u if low > 0 else low + (high - low) * u
        return found

    def designs(self, unit: np.ndarray, deadlines: np.ndarray) -> Design:
        """Designs [P] with a deadline (s) each."""
        rest = {name: np.full(len(unit), value) for name, value in self.baseline.values().items()}
        return Design.of(rest | self.values(unit) | {"deadline": np.asarray(deadlines, float)})

    def points(self, count: int, rng: np.random.Generator, extra: int = 0) -> np.ndarray:
        """Scrambled Sobol points [count, K + extra] of the unit cube; count a power of two."""
        size = _checks.count("points", count)
        if size & (size - 1):
            raise ValueError(f"points: got {size}, expected a power of two, at which Sobol points are balanced")
        return stats().qmc.Sobol(len(self.bounds) + extra, rng=rng).random(size)


def elasticities(
    objective: Objective, design: Design, seeds: Sequence[int], names: Sequence[str], step: float = 0.1
) -> pd.DataFrame:
    """Relative change of QoC per relative change of each parameter: d log Q / d log theta.

    Central differences over exp(-step) and exp(+step) times the value, paired over common seeds. Such a step averages
    over the kinks that contacts between robots make; a derivative at a point does not exist for a measured F.

    Args:
        objective: The setting.
        design: Numbers, where to look.
        seeds: [S] at least two.
        names: Parameters of the design, each above 0 there.
        step: In the logarithm.

    Returns:
        One row per parameter: parameter, value, elasticity with se, low, high (95 % Student interval), seeds.

    Raises:
        ValueError: An unknown parameter, or one at 0.
    """
    _checks.bounded("step", step, above=0)
    known = design.values()
    values = {}
    for name in names:
        _checks.choice("names", name, known)
        values[name] = float(_checks.bounded(name, known[name], above=0, shape=()))
    columns = {name: [float(np.asarray(value))] for name, value in known.items()}
    for name in values:
        for sign in (-1, 1):
            for other, column in columns.items():
                column.append(column[0] * (np.exp(sign * step) if other == name else 1.0))
    scores = objective.scores(Design.of({name: np.array(column) for name, column in columns.items()}), seeds)
    units = objective.units(seeds, design.tau)
    rows = []
    for k, (name, value) in enumerate(values.items()):
        slope = (scores[2 * k + 2] - scores[2 * k + 1]) / (2 * step)
        found = relative(slope, scores[0], units)
        rows.append({"parameter": name, "value": value, "elasticity": found.mean, "se": found.se, "low": found.low,
                     "high": found.high, "seeds": scores.shape[1]})  # fmt: skip
    return pd.DataFrame(rows)


def sobol(
    objective: Objective, box: Box, deadlines: Sequence[float], seeds: Sequence[int], points: int = 64, key: int = 0
) -> pd.DataFrame:
    """Global sensitivity: which share of the variance of QoC over a box each parameter and the deadline explain.

    Args:
        objective: The setting.
        box: Parameters, uniform in the box's scale.
        deadlines: Values of the deadline (s), equally likely.
        seeds: Over which QoC is averaged; common to all points.
        points: Power of two; (K + 3) times as many designs are simulated.
        key: Of the points and the bootstrap.

    Returns:
        One row per parameter: parameter, first and total with their 95 % bootstrap intervals `_low`, `_high`.

    Raises:
        ValueError: A number of points that is no power of two, no deadline, or a QoC that does not vary.
    """
    axis = np.sort(np.atleast_1d(np.asarray(_checks.bounded("deadlines", deadlines, least=0), float)))
    rng = np.random.default_rng(_checks.count("key", key, least=0))
    names = [*box.bounds, "deadline"]
    unit = box.points(points, rng, extra=len(names) + 1)
    a, b = unit[:, : len(names)], unit[:, len(names) :]

    def mean_qoc(x: np.ndarray) -> np.ndarray:
        chosen = axis[np.minimum((x[:, -1] * axis.size).astype(int), axis.size - 1)]
        return objective.scores(box.designs(x[:, :-1], chosen), seeds).mean(axis=1)

    mixed = [np.where(np.arange(len(names)) == k, b, a) for k in range(len(names))]
    scores = mean_qoc(np.concatenate([a, b, *mixed])).reshape(len(names) + 2, points)
    if np.ptp(scores[:2]) <= 0:
        raise ValueError("bounds: QoC is the same all over the box, expected one that varies")
    found = stats().sobol_indices(func={"f_A": scores[:1], "f_B": scores[1:2], "f_AB": scores[2:, None]}, n=points)
    # SciPy's own bootstrap divides by zero for a parameter without any effect; the percentile one does not.
    spread = _indices(scores[:, rng.integers(points, size=(_RESAMPLES, points))])
    table: dict[str, Any] = {"parameter": names}
    for name, estimates in zip(("first", "total"), spread, strict=True):
        low, high = np.quantile(estimates, [0.025, 0.975], axis=1)
        table |= {name: np.ravel(getattr(found, f"{name}_order")), f"{name}_low": low, f"{name}_high": high}
    return pd.DataFrame(table)


def _indices(scores: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First-order and total indices [K, B] from outputs [K + 2, B, P] of A, B and A with one column of B.

    The estimators that `scipy.stats.sobol_indices` uses (Saltelli et al. 2010, table 2, b and f).
    """
    centred = scores - scores[:2].mean(axis=(0, 2))[None, :, None]
    a, b, mixed = centred[0], centred[1], centred[2:]
    variance = centred[:2].var(axis=(0, 2))
    return (b * (mixed - a)).mean(axis=-1) / variance, 0.5 * ((a - mixed) ** 2).mean(axis=-1) / variance
