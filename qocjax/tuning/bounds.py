"""Bounds of the tuned parameters, and the bijection that frees a search from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import expit, logit

from qocjax import _checks
from qocjax.tunables import CONTINUOUS

__all__ = ["DEFAULT_BOUNDS", "Bounds"]

# The paper's grids, rounded outwards; SI units (model, section 1).
DEFAULT_BOUNDS: dict[str, tuple[float, float]] = {
    "v_max": (0.1, 2.0),
    "omega_max": (0.2, 4.0),
    "eta": (0.0, 2.0),
    "kappa": (0.25, 8.0),
    "gamma": (0.25, 8.0),
    "c_miss": (0.0, 1.6),
    "d_safe": (0.1, 1.5),
}

_POSITIVE = ("v_max", "omega_max", "d_safe")  # what a design cannot have at zero


class Bounds:
    """Which parameters are tuned, between what, and their free coordinates.

    A free coordinate u is any real number; the value is low (high/low)^s(u) where the lower bound is positive, so that
    equal steps are equal ratios, and low + (high - low) s(u) where it is zero, with the logistic function s. So every
    step of a search stays within the bounds, and reaches neither of them.
    """

    def __init__(self, wrt: Sequence[str], given: Mapping[str, Sequence[float]] | None = None) -> None:
        """Takes the bounds that are given, and `DEFAULT_BOUNDS` for the others.

        Args:
            wrt: Names of the tuned parameters, of `CONTINUOUS` or of what is given.
            given: (low, high) by name.

        Raises:
            ValueError: An unknown name, one twice, or bounds that hold nothing.
        """
        known = (*CONTINUOUS, *(name for name in given or {} if "." in name))
        names = tuple(_checks.choice("wrt", name, known) for name in wrt)
        if not names or len(set(names)) != len(names):
            raise ValueError(f"wrt: got {list(wrt)}, expected at least one of {', '.join(known)}, each once")
        for name in given or {}:
            _checks.choice("bounds", name, known)
        self.names = names
        pairs = [_pair(name, (given or {}).get(name) or DEFAULT_BOUNDS[name]) for name in names]
        self.low, self.high = np.array(pairs, np.float64).T  # [d] each
        self._log = self.low > 0.0
        self._bottom = np.where(self._log, np.log(np.where(self._log, self.low, 1.0)), self.low)
        self._top = np.where(self._log, np.log(self.high), self.high)

    def __len__(self) -> int:
        return len(self.names)

    def values(self, free: np.ndarray) -> np.ndarray:
        """Values of free coordinates, [..., d] both."""
        inner = self._bottom + (self._top - self._bottom) * expit(np.asarray(free, np.float64))
        found = np.where(self._log, np.exp(np.where(self._log, inner, 0.0)), inner)
        return np.clip(found, self.low, self.high)  # rounding of exp and log

    def free(self, values: np.ndarray) -> np.ndarray:
        """Free coordinates of values strictly between their bounds, [..., d] both.

        Raises:
            ValueError: A value lies outside, or on a bound.
        """
        array = np.asarray(values, np.float64)
        inside = (array > self.low) & (array < self.high)
        for k in np.flatnonzero(~inside.reshape(-1, len(self)).all(axis=0)):
            worst = array[..., k][~inside[..., k]].ravel()[0]
            raise ValueError(
                f"{self.names[k]}: got {worst:g}, expected a value between its bounds {self.low[k]:g} and "
                f"{self.high[k]:g}"
            )
        inner = np.where(self._log, np.log(np.where(self._log, array, 1.0)), array)
        return logit((inner - self._bottom) / (self._top - self._bottom))

    def nearest(self, values: np.ndarray) -> np.ndarray:
        """Free coordinates of values, which are moved a hundredth of the scale within their bounds if need be."""
        edge = logit(0.01)
        return self.free(np.clip(values, self.values(np.full(len(self), edge)), self.values(np.full(len(self), -edge))))

    def slopes(self, free: np.ndarray) -> np.ndarray:
        """Derivative of each value in its free coordinate, [..., d]."""
        share = expit(np.asarray(free, np.float64))
        along = (self._top - self._bottom) * share * (1.0 - share)
        return along * np.where(self._log, self.values(free), 1.0)


def _pair(name: str, pair: Sequence[float]) -> tuple[float, float]:
    """Checks (low, high) of one parameter."""
    if np.shape(pair) != (2,):
        raise ValueError(f"bounds.{name}: got {pair!r}, expected [low, high]")
    low, high = (float(v) for v in np.asarray(_checks.numbers(f"bounds.{name}", pair), np.float64))
    if name in _POSITIVE and low <= 0.0:
        raise ValueError(f"bounds.{name}: got a lower bound of {low:g}, expected > 0")
    if low < 0.0:
        raise ValueError(f"bounds.{name}: got a lower bound of {low:g}, expected >= 0")
    if not low < high:
        raise ValueError(f"bounds.{name}: got [{low:g}, {high:g}], expected low < high")
    return low, high
