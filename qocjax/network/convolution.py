"""The law of a sum of independent delays, such as uplink + compute + downlink.

One law keeps its own CDF, the sum of the others becomes points b_k of weight w_k: F(x) = sum_k w_k F_kept(x - b_k).
A law that takes few values (`Constant`, `Empirical`) has exactly those points. Any other is cut into cells of equal
probability, finer in the tails, and a cell becomes its median. Putting a cell of probability m in one place moves F by
at most m times the change of F_kept over the cell, and these changes add up to 1: whatever the laws, the error stays
below one cell's probability per law that was cut. If F_kept has a density, the error is of second order in the cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qocjax.network.empirical import Empirical
from qocjax.network.interface import DelayLaw
from qocjax.network.parametric import Constant

__all__ = ["DelaySum", "add"]

_FINE = 10_000  # cells at most
_PRODUCT = 1_000_000  # points of a sum before neighbours are merged, about
_BLOCK = 1 << 21  # values of F_kept held at a time
_SAME = 1e-12  # s, delays closer than this are one


@dataclass(frozen=True, eq=False)
class DelaySum:
    """A kept law plus independent points; made by `add`."""

    kept: DelayLaw
    delay: np.ndarray  # [K] s
    weight: np.ndarray  # [K], their sum is 1 less the probability of a lost message

    def cdf(self, delay: np.ndarray) -> np.ndarray:
        """Returns the CDF of the sum at `delay` (s), float64, same shape."""
        at = np.asarray(delay, dtype=np.float64)
        parts = np.array_split(at.ravel(), max(1, at.size * self.delay.size // _BLOCK))
        shares = [self.kept.cdf(part[:, None] - self.delay) @ self.weight for part in parts]
        return np.clip(np.concatenate(shares).reshape(at.shape), 0.0, 1.0)


def add(laws: Sequence[DelayLaw]) -> DelaySum:
    """Returns the law of the sum of independent delays.

    Args:
        laws: At least one law.

    Returns:
        The sum. Its CDF is exact where at most one law is of another kind than `Constant` or an `Empirical` of a few
        hundred values. Else its error is at worst 1e-4 with two other laws, 2e-3 with three, and 2e-5 with three smooth
        densities.
    """
    keep = max(range(len(laws)), key=lambda k: _rank(laws[k]))
    rest = [law for k, law in enumerate(laws) if k != keep]
    shift = sum(law.value for law in rest if isinstance(law, Constant))
    others = [law for law in rest if not isinstance(law, Constant)]
    delay, weight = np.array([shift]), np.ones(1)
    cells = _FINE if len(others) <= 1 else int(_PRODUCT ** (1.0 / len(others)))
    for law in sorted(others, key=_rank):  # those of few values first: what they leave of the budget goes to the rest
        delays, weights = _points(law, cells)
        cells = min(_FINE, max(cells, _PRODUCT // (delay.size * delays.size)))
        delay, weight = _merged(np.add.outer(delay, delays).ravel(), np.multiply.outer(weight, weights).ravel())
    return DelaySum(laws[keep], delay, weight)


def _rank(law: DelayLaw) -> tuple[int, float]:
    """Which law to keep: the widest of those with a density, else the one of most values."""
    if isinstance(law, Constant):
        return 0, 0.0
    if isinstance(law, Empirical):
        return 1, float(law.points()[0].size)
    return 2, float(law.quantile(0.75) - law.quantile(0.25))


def _points(law: DelayLaw, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Delays (s) and weights that stand for a law."""
    if isinstance(law, Empirical) and law.points()[0].size <= cells:
        return law.points()
    edge = _edges(cells)
    delay, weight = law.quantile(0.5 * (edge[1:] + edge[:-1])), np.diff(edge)
    arrives = np.isfinite(delay)
    return delay[arrives], weight[arrives]


def _merged(delay: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merges equal points, then, if more than `_FINE` are left, each cell of neighbours into their mean."""
    order = np.argsort(delay, kind="stable")
    delay, weight = delay[order], weight[order]
    cell = np.cumsum(np.diff(delay, prepend=delay[0]) > _SAME, dtype=np.intp)
    if cell[-1] >= _FINE:
        middle = (np.cumsum(weight) - 0.5 * weight) / weight.sum()
        cell = np.unique(np.searchsorted(_edges(_FINE), middle), return_inverse=True)[1]
    mass = np.bincount(cell, weight)
    return np.bincount(cell, weight * delay) / mass, mass


def _edges(cells: int) -> np.ndarray:
    """Probabilities that bound the cells: evenly spaced, and ten a decade in the tails, down to 1e-7."""
    inner = np.linspace(0.0, 1.0, cells + 1)[1:-1]
    tail = np.geomspace(1e-7, inner[0], int(10 * np.log10(inner[0] / 1e-7)), endpoint=False)
    return np.concatenate(([0.0], tail, inner, 1.0 - tail[::-1], [1.0]))
