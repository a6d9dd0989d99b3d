"""Delay laws given by a formula: constant, truncated normal, shifted gamma, shifted log-normal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax import _draws
from qocjax._lazy import special
from qocjax.network._fields import plain, store_float

__all__ = ["Constant", "ShiftedGamma", "ShiftedLogNormal", "TruncatedNormal"]

_LEAST_MASS = 1e-3  # below it, float32 draws of a truncated normal would be visibly grained


@dataclass(frozen=True)
class Constant:
    """The same delay for every message."""

    value: float = 0.0  # s

    def __post_init__(self) -> None:
        store_float(self, "value", least=0.0)

    def sample(self, key: Array, shape: tuple[int, ...]) -> Array:
        """Returns `value` in the given shape; the key is not used."""
        return jnp.full(shape, self.value, jnp.result_type(float))

    def cdf(self, delay: Any) -> np.ndarray:
        """Returns 1 where `delay` reaches `value`, else 0."""
        return np.where(np.asarray(delay, dtype=np.float64) >= self.value, 1.0, 0.0)

    def quantile(self, probability: Any) -> np.ndarray:
        """Returns `value` for every probability."""
        return np.full(np.shape(probability), self.value)

    def describe(self) -> dict[str, Any]:
        """Returns the law as plain values."""
        return plain(self)


@dataclass(frozen=True)
class TruncatedNormal:
    """Normal law restricted to [low, high]: the paper's compute time (model, section 1).

    `mean` and `std` are those of the normal before it is cut.
    """

    mean: float  # s
    std: float  # s
    low: float = 0.0  # s
    high: float = math.inf  # s

    def __post_init__(self) -> None:
        store_float(self, "mean")
        store_float(self, "std", above=0.0)
        store_float(self, "low", least=0.0)
        if self.high != math.inf:
            store_float(self, "high", above=self.low)
        if (mass := self._mass) < _LEAST_MASS:
            raise ValueError(
                f"TruncatedNormal: got [low, high] = [{self.low:g}, {self.high:g}] s, which holds {mass:.2g} of a "
                f"normal law of mean {self.mean:g} s and std {self.std:g} s, expected at least {_LEAST_MASS:g}"
            )

    @property
    def _bounds(self) -> tuple[float, float]:
        return (self.low - self.mean) / self.std, (self.high - self.mean) / self.std

    @property
    def _mass(self) -> float:
        below, above = special().ndtr(self._bounds)
        return float(above - below)

    def sample(self, key: Array, shape: tuple[int, ...]) -> Array:
        """Draws independent delays in s."""
        unit = _draws.truncated_normal(key, *self._bounds, shape)
        return jnp.clip(self.mean + self.std * unit, self.low, self.high)  # rounding may step over a bound

    def cdf(self, delay: Any) -> np.ndarray:
        """Returns the CDF at `delay` (s)."""
        unit = (np.asarray(delay, dtype=np.float64) - self.mean) / self.std
        return np.clip((special().ndtr(unit) - special().ndtr(self._bounds[0])) / self._mass, 0.0, 1.0)

    def quantile(self, probability: Any) -> np.ndarray:
        """Returns the delay in s at each probability."""
        level = special().ndtr(self._bounds[0]) + np.asarray(probability, dtype=np.float64) * self._mass
        return np.clip(self.mean + self.std * special().ndtri(level), self.low, self.high)

    def describe(self) -> dict[str, Any]:
        """Returns the law as plain values."""
        return plain(self)


@dataclass(frozen=True)
class ShiftedGamma:
    """A least delay plus a gamma law: mean `shift + shape * scale`, variance `shape * scale**2`."""

    shift: float  # s
    shape: float
    scale: float  # s

    def __post_init__(self) -> None:
        store_float(self, "shift", least=0.0)
        store_float(self, "shape", above=0.0)
        store_float(self, "scale", above=0.0)

    def sample(self, key: Array, shape: tuple[int, ...]) -> Array:
        """Draws independent delays in s."""
        return self.shift + self.scale * _draws.gamma(key, self.shape, shape)

    def cdf(self, delay: Any) -> np.ndarray:
        """Returns the CDF at `delay` (s)."""
        excess = np.maximum(np.asarray(delay, dtype=np.float64) - self.shift, 0.0)
        return special().gammainc(self.shape, excess / self.scale)

    def quantile(self, probability: Any) -> np.ndarray:
        """Returns the delay in s at each probability."""
        return self.shift + self.scale * special().gammaincinv(self.shape, np.asarray(probability, dtype=np.float64))

    def describe(self) -> dict[str, Any]:
        """Returns the law as plain values."""
        return plain(self)


@dataclass(frozen=True)
class ShiftedLogNormal:
    """A least delay plus a log-normal law: `shift + median * exp(sigma * z)` with z standard normal."""

    shift: float  # s
    median: float  # s, of the excess over `shift`
    sigma: float  # standard deviation of the logarithm of the excess

    def __post_init__(self) -> None:
        store_float(self, "shift", least=0.0)
        store_float(self, "median", above=0.0)
        store_float(self, "sigma", above=0.0, most=10.0)  # above, draws overflow float32

    def sample(self, key: Array, shape: tuple[int, ...]) -> Array:
        """Draws independent delays in s."""
        return self.shift + self.median * jnp.exp(self.sigma * _draws.normal(key, shape))

    def cdf(self, delay: Any) -> np.ndarray:
        """Returns the CDF at `delay` (s)."""
        excess = np.maximum(np.asarray(delay, dtype=np.float64) - self.shift, 0.0)
        with np.errstate(divide="ignore"):  # log 0 = -inf, of CDF 0
            return special().ndtr(np.log(excess / self.median) / self.sigma)

    def quantile(self, probability: Any) -> np.ndarray:
        """Returns the delay in s at each probability."""
        return self.shift + self.median * np.exp(
            self.sigma * special().ndtri(np.asarray(probability, dtype=np.float64))
        )

    def describe(self) -> dict[str, Any]:
        """Returns the law as plain values."""
        return plain(self)
