"""Fields of the frozen dataclasses of this package: checked when made, plain values when described."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from qocjax import _checks


def store_float(
    owner: object, name: str, *, above: float | None = None, least: float | None = None, most: float | None = None
) -> None:
    """Checks a number in a field of a frozen dataclass and stores it as a Python float, so that it hashes.

    Raises:
        TypeError: The field is no real number.
        ValueError: It is not finite, or outside its bounds.
    """
    label = f"{type(owner).__name__}.{name}"
    value = _checks.numbers(label, getattr(owner, name), ())
    object.__setattr__(owner, name, float(_checks.bounded(label, value, above=above, least=least, most=most)))


def delay_array(name: str, value: Any) -> np.ndarray:
    """Returns a read-only float64 copy of a list of delays, [n] s; infinity stands for a lost message.

    Raises:
        ValueError: The list is empty or not 1-D, has a negative delay or a NaN, or no finite delay at all.
    """
    delays = np.array(value, dtype=np.float64)
    if delays.ndim != 1 or delays.size == 0:
        raise ValueError(f"{name}: got shape {delays.shape}, expected a non-empty list of delays (s)")
    for row in np.flatnonzero(~(delays >= 0.0))[:1]:
        raise ValueError(f"{name}[{row}]: got {delays[row]}, expected a delay >= 0 s, inf for a lost message")
    if not np.isfinite(delays).any():
        raise ValueError(f"{name}: got {delays.size} lost messages and no delay, expected at least one finite delay")
    delays.setflags(write=False)
    return delays


def no_nan(name: str, value: Any) -> np.ndarray:
    """Returns times or probabilities as a float64 array.

    Raises:
        ValueError: One is NaN.
    """
    values = np.asarray(value, dtype=np.float64)
    if np.isnan(values).any():
        raise ValueError(f"{name}: got NaN, expected numbers")
    return values


def plain(owner: Any) -> dict[str, Any]:
    """Returns a dataclass of scalars as a dictionary of plain values, its class under `kind`; infinity is 'inf'."""
    values = {field.name: getattr(owner, field.name) for field in dataclasses.fields(owner)}
    return {"kind": type(owner).__name__} | {name: "inf" if v == math.inf else v for name, v in values.items()}
