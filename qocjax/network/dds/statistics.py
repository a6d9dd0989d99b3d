"""How loops went: percentiles, losses, the age of the newest command (model, section 8)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["command_ages", "loop_statistics", "miss_runs"]

_LEVELS = {"p50": 0.5, "p95": 0.95, "p99": 0.99}


def loop_statistics(loop_times: ArrayLike, tau: float) -> dict[str, float]:
    """Says how loops went.

    Args:
        loop_times: [..., P] T_net (s) in the order in which loops start, inf where lost.
        tau: Time between two loops (s).

    Returns:
        `lost`: share of loops that never complete; `p50`, `p95`, `p99` of those that do (s); `age_mean`, `age_p99`: age
        of the newest command at the sampling instants, from the first command on (s).
    """
    times = np.asarray(loop_times, np.float64)
    rows = times.reshape(-1, times.shape[-1])
    arrived = rows[np.isfinite(rows)]
    found = {"lost": 1.0 - arrived.size / rows.size}
    found |= {name: float(np.quantile(arrived, q)) if arrived.size else np.inf for name, q in _LEVELS.items()}
    ages = command_ages(rows, tau)
    seen = ages[np.isfinite(ages)]
    found |= {"age_mean": float(seen.mean()) if seen.size else np.inf}
    found |= {"age_p99": float(np.quantile(seen, 0.99)) if seen.size else np.inf}
    return found


def command_ages(loop_times: np.ndarray, tau: float) -> np.ndarray:
    """Age (s) of the newest command that has arrived by each sampling instant, [R, P]; inf before the first.

    Args:
        loop_times: [R, P] T_net (s), inf where lost.
        tau: Time between two loops (s).
    """
    rows, ticks = loop_times.shape
    own = np.arange(ticks)
    landed = own + np.ceil(np.where(np.isfinite(loop_times), loop_times, ticks * tau) / tau - 1e-6)
    newest = np.full((rows, ticks + 1), -1)
    place = np.minimum(landed, ticks).astype(int)
    np.maximum.at(newest, (np.arange(rows)[:, None], place), np.broadcast_to(own, place.shape))
    newest = np.maximum.accumulate(newest[:, :ticks], axis=1)
    return np.where(newest >= 0, (own - newest) * tau, np.inf)


def miss_runs(missed: np.ndarray) -> float:
    """Mean number of misses in a row, [R, P] booleans; 0 where there is none."""
    begins = missed & ~np.pad(missed, ((0, 0), (1, 0)))[:, :-1]
    return float(missed.sum() / begins.sum()) if missed.any() else 0.0
