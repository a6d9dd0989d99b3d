"""Sweeps: which designs a study simulates, one parameter at a time or several at once (model, section 6)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from qocjax import _checks
from qocjax._room import check_room
from qocjax.scenario import Design

__all__ = ["SWEPT", "Grid", "full_grid", "one_at_a_time"]

_ROW_BYTES = 500  # in memory, of a row and its design

SWEPT = ("v_max", "eta", "tau", "kappa", "gamma", "c_miss")


@dataclass(frozen=True)
class Grid:
    """The rows of a study and the distinct designs behind them: sweeps share their baseline, simulated once."""

    designs: Design  # each value [G]
    sweep: np.ndarray  # [R] name of the parameter that is swept
    value: np.ndarray  # [R] its value; of several parameters the place among all their combinations
    deadline: np.ndarray  # [R] s
    design: np.ndarray  # [R] index into the designs

    def rows(self, sweep: str) -> np.ndarray:
        """Row numbers of one sweep, [values, deadlines]."""
        members = np.flatnonzero(self.sweep == sweep)
        return members.reshape(len(np.unique(self.value[members])), -1)


def one_at_a_time(baseline: Design, grids: Mapping[str, Sequence[float]], deadlines: Sequence[float]) -> Grid:
    """Each parameter over its grid and every deadline, the others at their baseline.

    Args:
        baseline: Numbers; its deadline is not read.
        grids: Values by parameter name, of `SWEPT` or any other value of the baseline but the deadline.
        deadlines: The deadline axis (s).

    Raises:
        ValueError: An unknown parameter, an empty grid or axis, a repeated or bad value.
    """
    axes = _checked(baseline, grids)
    _check_points(sum(map(len, axes.values())), np.size(deadlines))
    points = [(name, value, {name: value}) for name, values in axes.items() for value in values]
    return _grid(baseline, points, _axis("deadline", deadlines, least=0.0))


def full_grid(baseline: Design, grids: Mapping[str, Sequence[float]], deadlines: Sequence[float]) -> Grid:
    """Every combination of the values of several parameters with every deadline: one sweep, named after all of them.

    Args:
        baseline: Numbers; its deadline is not read.
        grids: Values by parameter name, the last one running fastest.
        deadlines: The deadline axis (s).

    Raises:
        ValueError: What `one_at_a_time` raises.
    """
    axes = _checked(baseline, grids)
    _check_points(math.prod(map(len, axes.values())), np.size(deadlines))
    name = ",".join(axes)
    combined = [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]
    points = [(name, float(at), values) for at, values in enumerate(combined)]
    if len(axes) == 1:
        points = [(name, values[name], values) for values in combined]
    return _grid(baseline, points, _axis("deadline", deadlines, least=0.0))


def _check_points(values: int, deadlines: int) -> None:
    """Refuses more rows than memory has room for."""
    check_room("grids", f"{values} values with {deadlines} deadlines", _ROW_BYTES * values * deadlines, "fewer of them")


def _checked(baseline: Design, grids: Mapping[str, Sequence[float]]) -> dict[str, list[float]]:
    """The sorted values of each parameter."""
    for name, value in baseline.values().items():
        _checks.numbers(f"baseline.{name}", value, ())
    names = tuple(name for name in baseline.names if name != "deadline")
    if not grids:
        raise ValueError(f"grids: got none, expected at least one of {', '.join(names)}")
    for name in grids:
        _checks.choice("grids", name, names)
    return {name: _axis(name, values).tolist() for name, values in grids.items()}


def _grid(baseline: Design, points: Iterable[tuple[str, float, dict[str, float]]], axis: np.ndarray) -> Grid:
    """Rows of points with every deadline: the sweep, its value, and what differs from the baseline."""
    own = {name: float(np.asarray(value)) for name, value in baseline.values().items()}
    rows: list[tuple[str, float, float, int]] = []
    index: dict[tuple[float, ...], int] = {}
    for name, value, changed in points:
        for deadline in axis.tolist():
            place = index.setdefault(tuple((own | changed | {"deadline": deadline}).values()), len(index))
            rows.append((name, value, deadline, place))
    columns = np.array(list(index), np.float64).T
    designs = Design.of(dict(zip(own, columns, strict=True)))  # raises where a value is none of a design
    return Grid(designs, *(np.array(column) for column in zip(*rows, strict=True)))


def _axis(name: str, values: Sequence[float], least: float | None = None) -> np.ndarray:
    """Sorted values of one axis.

    Raises:
        ValueError: None, one twice, or one out of range.
    """
    array = np.atleast_1d(np.asarray(_checks.bounded(name, values, least=least), np.float64))
    if array.size == 0:
        raise ValueError(f"{name}: got an empty grid, expected at least one value")
    if np.unique(array).size != array.size:
        raise ValueError(f"{name}: got {array.tolist()}, expected each value once")
    return np.sort(array)
