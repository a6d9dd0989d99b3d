"""One-at-a-time sweeps: which designs a study simulates (model, section 6)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace

import numpy as np

from qocjax import _checks
from qocjax.scenario import Design

__all__ = ["SWEPT", "Grid", "one_at_a_time"]

SWEPT = ("v_max", "eta", "tau", "kappa", "gamma", "c_miss")


@dataclass(frozen=True)
class Grid:
    """The rows of a study and the distinct designs behind them: sweeps share their baseline, simulated once."""

    designs: Design  # each value [G]
    sweep: np.ndarray  # [R] name of the parameter that is swept
    value: np.ndarray  # [R] its value
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
        grids: Values by parameter name, of `SWEPT` or any other value of a design but the deadline.
        deadlines: The deadline axis (s).

    Raises:
        ValueError: An unknown parameter, an empty grid or axis, a repeated or bad value.
    """
    for item in fields(Design):
        _checks.numbers(f"baseline.{item.name}", getattr(baseline, item.name), ())
    axis = _axis("deadline", deadlines, least=0.0)
    names = tuple(item.name for item in fields(Design) if item.name != "deadline")
    if not grids:
        raise ValueError(f"grids: got none, expected at least one of {', '.join(names)}")
    rows: list[tuple[str, float, float, int]] = []
    index: dict[tuple[float, ...], int] = {}
    for name, values in grids.items():
        _checks.choice("grids", name, names)
        for value in _axis(name, values):
            for deadline in axis:
                point = replace(baseline, **{name: float(value), "deadline": float(deadline)})
                place = index.setdefault(tuple(float(v) for v in asdict(point).values()), len(index))
                rows.append((name, value, deadline, place))
    columns = np.array(list(index), np.float64).T
    designs = Design(**{item.name: column for item, column in zip(fields(Design), columns, strict=True)})
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
