"""AUC over configured delays, several times at each: the curves that a validation compares (model, section 10).

A curve is S(phi), of the surrogate, or E(phi), of what it is held against.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from qocjax import _checks
from qocjax.statistics.estimates import estimate

__all__ = ["Curve", "common", "normalised"]

Array = NDArray[np.float64]

SAME_DELAY = 1e-9  # s; delays closer than that are one


@dataclass(frozen=True, eq=False)
class Curve:
    """AUC at ascending configured delays.

    Attributes:
        delays: [D] s.
        values: For each delay its repetitions: AUC (s), mean over the robots of a run.
        seeds: Monte Carlo seed of each repetition, the same ones at all delays; None where runs know of no seed.
        source: What it is, for people.
        units: Label of each seed, see `units_of`; None where each is an observation of its own.
    """

    delays: Array
    values: tuple[Array, ...]
    seeds: tuple[int, ...] | None = None
    source: str = ""
    units: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        delays = np.asarray(_checks.bounded("delays", self.delays, least=0, shape=(None,)), np.float64)
        object.__setattr__(self, "delays", delays)
        object.__setattr__(self, "values", tuple(np.asarray(each, np.float64) for each in self.values))
        if len(self.values) != delays.size or not np.all(np.diff(delays) > SAME_DELAY):
            raise ValueError(f"delays: got {delays.tolist()} for {len(self.values)} sets of AUC, expected ascending "
                             "ones, one for each set")  # fmt: skip
        for delay, each in zip(delays, self.values, strict=True):
            if each.ndim != 1 or not each.size or not np.isfinite(each).all():
                raise ValueError(f"AUC of {self.source or 'a curve'} at {1e3 * delay:g} ms: got {each.tolist()}, "
                                 "expected one finite number or more")  # fmt: skip
        if self.seeds is not None and {each.size for each in self.values} != {len(self.seeds)}:
            raise ValueError(f"seeds: got {len(self.seeds)}, expected one for each repetition at every delay")

    @classmethod
    def of_table(
        cls,
        delays: ArrayLike,
        auc: ArrayLike,
        seeds: Sequence[int] | None,
        source: str = "",
        units: Sequence[int] | None = None,
    ) -> Curve:
        """A curve from AUC [D, S]."""
        labels = None if units is None else tuple(units)
        return cls(np.asarray(delays, np.float64), tuple(np.asarray(auc, np.float64)),
                   None if seeds is None else tuple(seeds), source, labels)  # fmt: skip

    @property
    def mean(self) -> Array:
        """Mean AUC at each delay, [D]."""
        return np.array([each.mean() for each in self.values])

    @property
    def repetitions(self) -> NDArray[np.int64]:
        """Number of repetitions at each delay, [D]."""
        return np.array([each.size for each in self.values])

    def half_widths(self, confidence: float = 0.95) -> Array:
        """Half of the Student interval of each mean, [D]; NaN where there is one repetition alone."""
        units = None if self.units is None else np.array(self.units)
        found = [estimate(each, confidence, units) if each.size > 1 else None for each in self.values]
        return np.array([np.nan if one is None else one.high - one.mean for one in found])

    def at(self, rows: Sequence[int] | NDArray[np.intp]) -> Curve:
        """Some of the delays."""
        return replace(self, delays=self.delays[list(rows)], values=tuple(self.values[int(row)] for row in rows))

    def of_seeds(self, seeds: Sequence[int]) -> Curve:
        """The repetitions of some seeds, in that order.

        Raises:
            ValueError: The curve knows of no seeds, or not of these.
        """
        if self.seeds is None or not set(seeds) <= set(self.seeds):
            raise ValueError(f"seeds: got {sorted(seeds)}, expected some of those of {self.source or 'the curve'}")
        places = [self.seeds.index(seed) for seed in seeds]
        units = None if self.units is None else tuple(self.units[place] for place in places)
        return replace(self, values=tuple(each[places] for each in self.values), seeds=tuple(seeds), units=units)


def normalised(curve: ArrayLike) -> Array:
    """The curve on the paper's scale, 100 (S - min S) / (max S - min S), over the last axis [..., D].

    Raises:
        ValueError: A curve is the same at all delays: it has no scale.
    """
    array = np.asarray(curve, np.float64)
    low, high = array.min(axis=-1, keepdims=True), array.max(axis=-1, keepdims=True)
    if not np.all(high > low):
        raise ValueError(f"AUC: got {float(low.ravel()[0]):g} s at all {array.shape[-1]} delays, expected a curve that "
                         "varies: it cannot be normalised")  # fmt: skip
    return 100.0 * (array - low) / (high - low)


def common(first: Curve, second: Curve) -> tuple[Curve, Curve]:
    """Both curves at the delays that both have.

    Raises:
        ValueError: They are fewer than three: nothing can then be said of a shape.
    """
    apart = np.abs(first.delays[:, None] - second.delays[None, :])
    rows, columns = np.nonzero(apart <= 1e-6)
    if rows.size < 3:
        raise ValueError(
            f"delays: got {rows.size} common to {first.source or 'one curve'} "
            f"({_ms(first.delays)} ms) and {second.source or 'the other'} ({_ms(second.delays)} ms), expected 3 or more"
        )
    return first.at(rows), second.at(columns)


def _ms(delays: Array) -> str:
    return ", ".join(f"{1e3 * delay:g}" for delay in delays)
