"""Ticks of logarithmic axes as plain numbers."""

from __future__ import annotations

import numpy as np
from matplotlib.axis import Axis
from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter

__all__ = ["label_steps"]

_WIDE = 200.0  # ratio of the ends above which 2 and 5 are left out


def label_steps(axis: Axis, low: float, high: float) -> None:
    """Labels a logarithmic axis at 1, 2 and 5 times powers of ten between two values; where far apart, at powers."""
    steps = np.outer(10.0 ** np.arange(-9, 10), [1, 2, 5] if high < _WIDE * low else [1]).ravel()
    axis.set_major_locator(FixedLocator(list(steps[(steps >= low) & (steps <= high)])))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
