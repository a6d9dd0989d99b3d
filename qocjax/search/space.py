"""The space that a search moves in: continuous values of a design, the sampling period from a list, the deadline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from qocjax import _checks
from qocjax.scenario import Design
from qocjax.study.edges import at_bounds
from qocjax.tunables import CONTINUOUS

__all__ = ["Space"]


@dataclass(frozen=True)
class Space:
    """Designs as points of the unit cube [0, 1]^D: the continuous values, then the deadline, then tau.

    A continuous value with a positive lower bound moves in log scale, one that may be zero in linear scale.

    Attributes:
        bounds: Lower and upper bound by name, of `CONTINUOUS` or of what the baseline holds beside.
        tau: Sampling periods to choose from (s).
        deadline: Lower and upper bound (s), or with `deadline_axis` the values to choose from.
        deadline_axis: Whether the deadline comes from a list.
        baseline: Numbers; holds what the search leaves alone.
    """

    bounds: Mapping[str, tuple[float, float]]
    tau: Sequence[float]
    deadline: Sequence[float]
    deadline_axis: bool = False
    baseline: Design = Design()

    def __post_init__(self) -> None:
        if not self.bounds:
            raise ValueError(f"bounds: got none, expected at least one of {', '.join(CONTINUOUS)}")
        for name, pair in self.bounds.items():
            _checks.choice("bounds", name, (*CONTINUOUS, *self.baseline.others))
            _check_pair(f"bounds.{name}", pair)
            self.baseline.having({name: np.asarray(pair, float)})  # raises where a bound is no value of a design
        object.__setattr__(self, "tau", _distinct("tau", self.tau, above=0.0))
        if self.deadline_axis:
            object.__setattr__(self, "deadline", _distinct("deadline", self.deadline, least=0.0))
        else:
            _check_pair("deadline", self.deadline)
            _checks.bounded("deadline", np.asarray(self.deadline, float), least=0)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return (*self.bounds, "deadline", "tau")

    @property
    def dim(self) -> int:
        """D."""
        return len(self.names)

    def at_bounds(self, design: Mapping[str, float]) -> str:
        """At which ends of the space a design lies, see `edges.at_bounds`."""
        lists = {"tau": self.tau} | ({"deadline": self.deadline} if self.deadline_axis else {})
        bounds = dict(self.bounds) | ({} if self.deadline_axis else {"deadline": tuple(self.deadline)})
        return at_bounds(design, bounds, lists)

    def choices(self) -> list[int]:
        """For each coordinate the number of values to choose from, 0 for a continuous one."""
        return [*[0] * len(self.bounds), len(self.deadline) if self.deadline_axis else 0, len(self.tau)]

    def snapped(self, units: np.ndarray) -> np.ndarray:
        """Points [G, D] inside the cube, coordinates with a list in the middle of their value's cell."""
        points = np.clip(np.atleast_2d(np.asarray(units, np.float64)), 0.0, 1.0)
        for axis, count in enumerate(self.choices()):
            if count:
                points[:, axis] = (np.minimum(np.floor(points[:, axis] * count), count - 1) + 0.5) / count
        return points

    def designs(self, units: np.ndarray) -> Design:
        """The designs [G] of points [G, D]."""
        points = np.clip(np.atleast_2d(np.asarray(units, np.float64)), 0.0, 1.0)
        values = {
            name: np.full(len(points), float(np.asarray(value))) for name, value in self.baseline.values().items()
        }
        for axis, name in enumerate(self.bounds):
            values[name] = _between(points[:, axis], self.bounds[name])
        values["deadline"] = (
            _pick(points[:, -2], self.deadline) if self.deadline_axis else _between(points[:, -2], self.deadline)
        )
        values["tau"] = _pick(points[:, -1], self.tau)
        return Design.of(values)

    def slopes(self, units: np.ndarray) -> np.ndarray:
        """Derivative of each continuous value in its coordinate, [G, number of bounds]."""
        columns = []
        for axis, pair in enumerate(self.bounds.values()):
            low, high = pair
            value = _between(np.atleast_2d(units)[:, axis], pair)
            columns.append(value * np.log(high / low) if low > 0 else np.full(len(value), high - low))
        return np.stack(columns, axis=1)


def _between(unit: np.ndarray, pair: Sequence[float]) -> np.ndarray:
    low, high = pair
    between = low * (high / low) ** unit if low > 0 else low + (high - low) * unit
    return np.clip(between, low, high)  # rounding may pass a bound


def _pick(unit: np.ndarray, values: Sequence[float]) -> np.ndarray:
    places = np.minimum(np.floor(unit * len(values)), len(values) - 1).astype(int)
    return np.asarray(values, np.float64)[places]


def _check_pair(name: str, pair: Sequence[float]) -> None:
    ends = _checks.numbers(name, np.asarray(pair, float), (2,))
    if not ends[0] < ends[1]:
        raise ValueError(f"{name}: got {list(pair)}, expected [low, high] with low < high")


def _distinct(
    name: str, values: Sequence[float], *, above: float | None = None, least: float | None = None
) -> tuple[float, ...]:
    array = np.atleast_1d(np.asarray(values, float))
    if array.size == 0 or np.unique(array).size != array.size:
        raise ValueError(f"{name}: got {array.tolist()}, expected at least one value, each once")
    _checks.bounded(name, array, above=above, least=least)
    return tuple(float(v) for v in np.sort(array))
