"""Delay laws from measurements: a list of samples, and a table of quantiles (a histogram is one)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike

from qocjax import _draws
from qocjax.network._fields import delay_array, no_nan

__all__ = ["Empirical", "QuantileTable"]


@dataclass(frozen=True, eq=False)
class Empirical:
    """Measured delays: every draw is one of them, each as likely as the next.

    A lost message is an infinite sample; it counts, and is drawn, like any other. The order of the samples does not
    matter: `Trace` keeps it.
    """

    samples: ArrayLike  # [n] s, inf for a lost message; kept as a read-only float64 array
    source: str = ""  # where they come from, for the record

    def __post_init__(self) -> None:
        object.__setattr__(self, "samples", delay_array("Empirical.samples", self.samples))

    @cached_property
    def _ordered(self) -> np.ndarray:
        return np.sort(np.asarray(self.samples))

    def sample(self, key: Array, shape: tuple[int, ...]) -> Array:
        """Draws independent delays (s), inf for a lost message."""
        pool = jnp.asarray(self.samples, jnp.result_type(float))
        return pool[_draws.whole(key, pool.size, shape)]

    def cdf(self, delay: Any) -> np.ndarray:
        """Returns the share of the samples that are at most `delay` (s); lost messages never are."""
        arrived = self._ordered[np.isfinite(self._ordered)]
        return np.searchsorted(arrived, no_nan("delay", delay), side="right") / self._ordered.size

    def quantile(self, probability: Any) -> np.ndarray:
        """Returns the smallest sample (s) whose share reaches each probability."""
        rank = np.ceil(no_nan("probability", probability) * self._ordered.size).astype(int) - 1
        return self._ordered[np.clip(rank, 0, self._ordered.size - 1)]

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the distinct finite delays (s) and their probabilities, which add up to the share not lost."""
        delays, counts = np.unique(self._ordered[np.isfinite(self._ordered)], return_counts=True)
        return delays, counts / self._ordered.size

    def describe(self) -> dict[str, Any]:
        """Returns size, source and quartiles, not the samples."""
        return _summary(self, samples=int(self._ordered.size), lost_share=1.0 - float(self.cdf(np.inf)))


@dataclass(frozen=True, eq=False)
class QuantileTable:
    """A law given by some of its quantiles, linear in between; so is its CDF.

    Delays repeated at different probabilities are an atom, probabilities repeated at different delays a gap.
    """

    probability: ArrayLike  # [n] nondecreasing, from 0 to 1; kept as a read-only float64 array
    delay: ArrayLike  # [n] s, nondecreasing, finite; kept likewise
    source: str = ""  # where they come from, for the record

    def __post_init__(self) -> None:
        probability = np.array(self.probability, dtype=np.float64)
        delay = delay_array("QuantileTable.delay", self.delay)
        if probability.shape != delay.shape or delay.size < 2:
            raise ValueError(
                f"QuantileTable: got {probability.shape} probabilities and {delay.shape} delays, expected as many of "
                "one as of the other, and two or more"
            )
        if probability[0] != 0.0 or probability[-1] != 1.0 or not np.all(np.diff(probability) >= 0.0):
            raise ValueError("QuantileTable.probability: expected nondecreasing numbers from 0 to 1")
        if not np.isfinite(delay[-1]) or not np.all(np.diff(delay) >= 0.0):
            raise ValueError("QuantileTable.delay: expected nondecreasing, finite delays (s)")
        probability.setflags(write=False)
        object.__setattr__(self, "probability", probability)
        object.__setattr__(self, "delay", delay)

    def sample(self, key: Array, shape: tuple[int, ...]) -> Array:
        """Draws independent delays (s), by the inverse of the CDF."""
        dtype = jnp.result_type(float)
        level = _draws.uniform(key, shape)
        return jnp.interp(level, jnp.asarray(self.probability, dtype), jnp.asarray(self.delay, dtype))

    def cdf(self, delay: Any) -> np.ndarray:
        """Returns the CDF at `delay` (s)."""
        known, probability = np.asarray(self.delay), np.asarray(self.probability)
        at = no_nan("delay", delay)
        right = np.searchsorted(known, at, side="right")  # of an atom, the upper end counts
        left = np.clip(right - 1, 0, known.size - 2)
        width = np.maximum(known[left + 1] - known[left], np.finfo(float).tiny)
        share = np.clip((at - known[left]) / width, 0.0, 1.0)
        inside = probability[left] + share * (probability[left + 1] - probability[left])
        return np.where(right == 0, 0.0, np.where(right == known.size, 1.0, inside))

    def quantile(self, probability: Any) -> np.ndarray:
        """Returns the delay (s) at each probability."""
        return np.interp(no_nan("probability", probability), np.asarray(self.probability), np.asarray(self.delay))

    def describe(self) -> dict[str, Any]:
        """Returns size, source and quartiles, not the table."""
        return _summary(self, rows=int(np.size(self.delay)))


def _summary(law: Empirical | QuantileTable, **size: float) -> dict[str, Any]:
    """Plain values that tell one table from another."""
    levels = {"p01": 0.01, "p25": 0.25, "p50": 0.5, "p75": 0.75, "p99": 0.99}
    quantiles = {name: float(law.quantile(level)) for name, level in levels.items()}
    return {"kind": type(law).__name__, "source": law.source} | size | _finite_or_text(quantiles)


def _finite_or_text(values: dict[str, float]) -> dict[str, Any]:
    return {name: value if np.isfinite(value) else "inf" for name, value in values.items()}
