"""How often a measured trace was measured: from a column of send times, or the stamps of a log (model, section 4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from qocjax.network.values import header_unit

__all__ = ["SEND_TIMES", "epoch_unit", "is_send_time", "period_of", "unlikely"]

SEND_TIMES = (
    "source_stamp", "uplink_send", "send_timestamp", "send_stamp", "send_time", "sent_time", "sent", "send", "t_send",
    "tx_time", "tx_timestamp", "pub_time", "client_send", "timestamp", "stamp", "__time",
)  # fmt: skip
"""Names of columns of send times, without their units, in the order in which they are preferred."""

_EPOCH = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}  # 2001; a time since 1970 lies within six times that
_LONG = 10.0  # times the interval that nine of ten keep within; a longer one is a gap
_QUICKEST = 1e-5  # s, of a loop through any network
_ENOUGH = 10  # loops to say something of their unit
_BURSTY = 1.5  # mean over median of the intervals, or its inverse; beyond, messages go out in bursts


def is_send_time(name: str) -> bool:
    """Whether a column is called as columns of send times are."""
    return header_unit(name)[0].lower() in SEND_TIMES


def epoch_unit(stamps: ArrayLike) -> str | None:
    """The unit in which numbers are times since 1970: s, ms, us or ns by their size; None where they are none."""
    values = np.asarray(stamps, np.float64)
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    usual = float(np.median(values))
    return next((unit for unit, least in _EPOCH.items() if least <= usual < 6.0 * least), None)


def period_of(stamps: NDArray[np.float64], numbers: Sequence[float] | None = None) -> float | None:
    """The usual time between two loops, in the unit of the stamps, rounded.

    It is the median of the intervals in the order of the rows, each divided by the numbers that it spans where there
    are numbers. Where messages go out in bursts, or stamps are coarser than intervals, it is their mean without gaps.

    Args:
        stamps: [n] send times, NaN where one is missing.
        numbers: [n] counts of loops; None where rows have none.

    Returns:
        None where fewer than two stamps increase.
    """
    known = np.flatnonzero(np.isfinite(stamps))
    interval = np.diff(stamps[known])
    if numbers is not None:
        passed = np.diff(np.asarray(numbers, np.float64)[known])
        interval = interval[passed > 0.0] / passed[passed > 0.0]
    interval = interval[interval >= 0.0]
    if not interval.size or not interval.max() > 0.0:
        return None
    median = float(np.median(interval))
    mean = float(interval[interval <= _LONG * max(np.quantile(interval, 0.9, method="lower"), median)].mean())
    usual = median if mean < _BURSTY * median and median < _BURSTY * mean else mean
    return _rounded(usual if usual > 0.0 else float(interval.mean()))


def unlikely(delays: ArrayLike, span: float | None) -> str | None:
    """What in loop times contradicts their unit; None where nothing does.

    Args:
        delays: [n] s, infinite where lost.
        span: How long the recording is (s); None where unknown.
    """
    values = np.asarray(delays, np.float64)
    usual = float(np.median(values[np.isfinite(values)])) if values.size >= _ENOUGH else np.nan
    if usual < _QUICKEST:
        return f"half of the loops take less than {1e6 * usual:.3g} us, which no network does: look at the unit"
    if span is not None and usual > span:
        return f"half of the loops take more than {usual:.4g} s in a recording of {span:.4g} s: look at the unit"
    return None


def _rounded(value: float) -> float:
    """To two digits where that is within half a percent (a nominal 50 ms is met with some jitter), else to three."""
    short = float(f"{value:.2g}")
    return short if abs(short - value) <= 0.005 * value else float(f"{value:.3g}")
