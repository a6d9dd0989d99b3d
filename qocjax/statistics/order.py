"""The exact median of more numbers than fit into memory: counted digit by digit, in a few passes."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from qocjax.quality import QocScale

__all__ = ["scale_of"]

_DIGIT = 16  # bits that one pass settles


def scale_of(parts: Callable[[], Iterable[np.ndarray]]) -> QocScale:
    """What `QocScale.of` makes of all AUC values together, bit for bit, holding one part at a time.

    The bits of floating-point numbers, as whole numbers, have the order of the numbers. A pass counts how many have
    which next 16 bits; so two passes find the middle values of float32 numbers, four those of float64.

    Args:
        parts: Gives the AUC values, in arrays of one type; called once for each pass, with the same result.

    Raises:
        ValueError: None is finite.
    """
    counts = np.zeros(1 << _DIGIT, np.int64)
    largest, number, width = -np.inf, 0, 0
    for part in parts():
        values = part[np.isfinite(part)]
        width = 8 * part.dtype.itemsize
        if values.size:
            number += values.size
            largest = max(largest, float(values.max()))
            counts += _count(_in_order(values) >> (width - _DIGIT))
    if number == 0:
        raise ValueError("auc: got no finite value, expected the AUC of at least one run")
    middle = [_descend(counts, 0, rank) for rank in ((number - 1) // 2, number // 2)]
    for shift in range(width - 2 * _DIGIT, -1, -_DIGIT):
        tables = {prefix: np.zeros(1 << _DIGIT, np.int64) for prefix, _ in middle}
        for part in parts():
            bits = _in_order(part[np.isfinite(part)])
            for prefix, table in tables.items():
                table += _count((bits[bits >> (shift + _DIGIT) == prefix] >> shift) & ((1 << _DIGIT) - 1))
        middle = [_descend(tables[prefix], prefix, rank) for prefix, rank in middle]
    low, high = (_number(bits, width) for bits, _ in middle)
    return QocScale((low + high) / 2, largest)


def _in_order(values: np.ndarray) -> np.ndarray:
    """Whole numbers with the order of the numbers: negative ones reversed, below the others."""
    kind = np.dtype(f"u{values.dtype.itemsize}")
    bits, top = np.ascontiguousarray(values).view(kind), kind.type(1 << (8 * values.dtype.itemsize - 1))
    return np.where(bits & top, ~bits, bits | top)


def _number(bits: int, width: int) -> float:
    top = 1 << (width - 1)
    plain = bits ^ top if bits & top else ~bits & (2 * top - 1)
    return float(np.array(plain, f"u{width // 8}").view(f"f{width // 8}"))


def _count(digits: np.ndarray) -> np.ndarray:
    return np.bincount(digits.astype(np.int64), minlength=1 << _DIGIT)


def _descend(counts: np.ndarray, prefix: int, rank: int) -> tuple[int, int]:
    """The digit of the number of that rank, put behind the prefix, and its rank among those with the same digits."""
    ends = np.cumsum(counts)
    digit = int(np.searchsorted(ends, rank, side="right"))
    return prefix << _DIGIT | digit, rank - int(ends[digit] - counts[digit])
