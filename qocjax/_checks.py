"""Checks of user input: one clear message that names the argument, what was got and what is expected."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from operator import attrgetter
from typing import Any

import numpy as np


def is_concrete(value: Any) -> bool:
    """Whether a value can be looked at: a tracer (under jit, grad, vmap) cannot."""
    return not _is_of_jax(value, "core.Tracer")


def array_of(value: Any, dtype: np.dtype) -> Any:
    """An array of a type: NumPy's where the value can be looked at, which needs no program of its own."""
    return np.asarray(value, dtype) if is_concrete(value) else value.astype(dtype)


def is_zero(value: Any) -> bool:
    """Whether a number is known to be 0."""
    return is_concrete(value) and bool(value == 0)


def numbers(name: str, value: Any, shape: tuple[int | None, ...] | None = None) -> Any:
    """Checks that a value holds finite real numbers, and its shape where one is given.

    Args:
        name: The argument's name, for the message.
        value: Number or array; tracers pass unseen.
        shape: Expected shape, None for a free length.

    Returns:
        The value; what is neither a number nor an array (a list, a pandas column) as a NumPy array of floats.

    Raises:
        TypeError: The value is no real number or array of them.
        ValueError: A number is NaN or infinite, or the shape is another.
    """
    if not is_concrete(value):
        return value
    array = None if isinstance(value, (str, bytes, bool)) else _as_array(value)
    if array is None or array.dtype.kind not in "iuf":
        text = " ".join(repr(value).split())
        text = text if len(text) <= 60 else text[:57] + "..."
        raise TypeError(f"{name}: got {text} ({type(value).__name__}), expected a real number or an array of them")
    if shape is not None and not _fits(array.shape, shape):
        wanted = ", ".join("any" if n is None else str(n) for n in shape) + ("," if len(shape) == 1 else "")
        raise ValueError(f"{name}: got shape {array.shape}, expected " + (f"({wanted})" if shape else "one number"))
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name}: got {_show(array)}, expected finite numbers")
    own = isinstance(value, (int, float, np.ndarray, np.generic)) or _is_of_jax(value, "Array")
    return value if own else array.astype(float)


def bounded(
    name: str,
    value: Any,
    *,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
    shape: tuple[int | None, ...] | None = None,
) -> Any:
    """Checks that every number of `value` lies above `above`, at or above `least`, at or below `most`.

    Raises:
        TypeError: The value is no real number or array of them.
        ValueError: A number lies outside, or is not finite, or the shape is not the one given.
    """
    value = numbers(name, value, shape)
    if not is_concrete(value):
        return value
    array = np.asarray(value)
    for bound, holds, words in (
        (above, np.greater, "> "),
        (least, np.greater_equal, ">= "),
        (most, np.less_equal, "<= "),
    ):
        if bound is not None and not np.all(inside := holds(array, bound)):
            raise ValueError(f"{name}: got {_show(array[~inside] if array.ndim else array)}, expected {words}{bound:g}")
    return value


def choice(name: str, value: Any, allowed: Iterable[str]) -> str:
    """Checks that `value` is one of the allowed words.

    Raises:
        ValueError: It is another; the message lists the words.
    """
    words = tuple(allowed)
    if not (isinstance(value, str) and value in words):
        raise ValueError(f"{name}: got {value!r}, expected one of {', '.join(words)}")
    return value


def count(name: str, value: Any, least: int = 1, most: int = 2**31 - 1) -> int:
    """Checks that `value` is a whole number from `least` to `most`, by default what 32 bits hold.

    Raises:
        TypeError: It is no whole number.
        ValueError: It is too small, or too large.
    """
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{name}: got {value!r} ({type(value).__name__}), expected a whole number")
    if value < least:
        raise ValueError(f"{name}: got {value}, expected at least {least}")
    if value > most:
        raise ValueError(f"{name}: got {_whole(int(value))}, expected at most {most}")
    return int(value)


def counts(name: str, values: Any, least: int = 0, most: int = 2**32 - 1) -> list[int]:
    """Checks that `values` are whole numbers from `least` to `most`; by default what a random key can tell apart.

    Raises:
        TypeError: They are no sequence, or one is no whole number.
        ValueError: One is out of range.
    """
    if isinstance(values, (str, bytes, dict)) or not (hasattr(values, "__len__") and _is_row(values)):
        raise TypeError(f"{name}: got {values!r} ({type(values).__name__}), expected a sequence of whole numbers")
    return [count(name, value, least, most) for value in values]


def _is_row(values: Any) -> bool:
    return isinstance(values, range) or np.ndim(values) == 1  # a range need not be made to be known


def _whole(value: int) -> str:
    return str(value) if abs(value) < 10**20 else f"a number of {int(abs(value).bit_length() * 0.30103) + 1} digits"


def _as_array(value: Any) -> np.ndarray | None:
    try:
        return np.asarray(value)
    except (ValueError, TypeError):  # ragged nesting, random keys
        return None


def _fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    return len(shape) == len(wanted) and all(n is None or n == m for m, n in zip(shape, wanted, strict=True))


def _show(array: np.ndarray) -> str:
    text = np.array2string(array.ravel()[:4], separator=", ")
    return str(array.item()) if array.size == 1 else text[:-1] + (", ...]" if array.size > 4 else "]")


def _is_of_jax(value: Any, kind: str) -> bool:
    """Whether a value is of a class of JAX, which figures do without: while it is not imported, none is."""
    jax = sys.modules.get("jax")
    return jax is not None and isinstance(value, attrgetter(kind)(jax))
