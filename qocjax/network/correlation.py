"""How long the loops of a measurement hang together, and how many independent stretches of it there are."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["correlation_rows", "independent_rows"]

_LEVELS = (0.5, 0.9, 0.99)  # shares of the loops below the thresholds that are looked at
_WINDOW = 5.0  # correlation times over which the autocorrelation is summed (Sokal 1997, section 3)


def correlation_rows(delays: ArrayLike, threshold: float | None = None) -> float:
    """Rows that count as one: 1 for independent loops, twice the integrated autocorrelation time in general.

    The mean of L rows varies as that of L divided by this many independent ones.

    Args:
        delays: [L] s, infinite where lost.
        threshold: Of which delays are looked at (s); by default several, and the longest correlation of these counts.
            Whether a loop passes a threshold is all that a deadline asks, and a lost loop passes none.
    """
    values = np.asarray(delays, np.float64)
    if threshold is None:
        longest = values[np.isfinite(values)].max()  # beyond it are the lost loops
        levels = np.unique(np.minimum(np.quantile(values, _LEVELS, method="inverted_cdf"), longest))
        return max(_of_events(values > level) for level in levels)
    return _of_events(values > threshold)


def independent_rows(delays: ArrayLike, threshold: float) -> float:
    """How many independent loops say as much of the share beyond a threshold (s) as all of these."""
    return np.size(delays) / correlation_rows(delays, threshold)


def _of_events(events: np.ndarray) -> float:
    """1 + 2 times the sum of the autocorrelations, over a window that is long against that sum."""
    deviations = events - events.mean()
    variance = float((deviations**2).mean())
    if variance == 0.0:
        return 1.0
    size = 1 << (2 * events.size - 1).bit_length()
    power = np.abs(np.fft.rfft(deviations, size)) ** 2
    correlation = np.fft.irfft(power, size)[: events.size] / (events.size * variance)
    sums = 2.0 * np.cumsum(correlation) - 1.0
    enough = np.arange(events.size) >= _WINDOW * sums / 2.0
    return max(float(sums[int(np.argmax(enough)) if enough.any() else -1]), 1.0)
