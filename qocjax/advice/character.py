"""How a network behaves: quantiles of its loop times, deadlines worth a try, losses and bursts (model, section 4)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
import pandas as pd

from qocjax import _checks
from qocjax.network import Load, Network, Trace, completes, loop_times
from qocjax.network.trace import replayed_trace
from qocjax.study.policies import MIN_RELIABILITY

__all__ = ["NEVER", "candidate_deadlines", "characterise", "lost_share", "quantiles"]

NEVER = 1e4  # s; a loop that takes longer is lost

_LEVELS = (0.02, 0.1, 0.3, 0.5, 0.7, 0.85, 0.95, 0.98, 0.99, 0.995)  # of the loops that ever complete
_PERCENTILES = (0.01, 0.05, 0.5, 0.95, 0.99)


def lost_share(network: Network, load: Load) -> float:
    """Share of the loops that never complete; below 1e-9 it is the rounding of F."""
    share = 1.0 - float(network.reliability(np.float64(NEVER), load).share)
    return share if share > 1e-9 else 0.0


def quantiles(network: Network, load: Load, levels: Sequence[float], most: float = NEVER) -> np.ndarray:
    """Smallest deadlines (s) at which F reaches levels, infinite where it does not by `most`; by bisection.

    Of a network that gives up what is late, F need not rise with the deadline: then it is one of those deadlines.
    """
    wanted = np.asarray(levels, float)
    low, high = np.zeros(wanted.shape), np.full(wanted.shape, most)
    for _ in range(60 if not getattr(network, "uses_deadline", False) else 24):
        middle = 0.5 * (low + high)
        enough = network.reliability(middle, load).share >= wanted
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    return np.where(network.reliability(np.full(wanted.shape, most), load).share >= wanted, high, np.inf)


def candidate_deadlines(network: Network, load: Load, longest: float) -> np.ndarray:
    """Ascending deadlines (s) worth a try: quantiles of the loop times that complete by the longest, and beyond.

    Raises:
        ValueError: Fewer loops complete by the longest deadline than the policies ask for.
    """
    _checks.bounded("longest_deadline", longest, above=0)
    reached = float(network.reliability(np.float64(longest), load).share)
    if reached < MIN_RELIABILITY:
        raise ValueError(
            f"longest_deadline: got {1e3 * longest:g} ms, by which {reached:.2g} of the loops of {network.name!r} "
            f"complete, expected at least {MIN_RELIABILITY:g}"
        )
    found = quantiles(network, load, [reached * level for level in _LEVELS], longest)
    found = np.append(found, [1.5 * found[-1], 3 * found[-1], longest])
    step = np.where(found < 0.01, 2e-4, np.where(found < 0.05, 1e-3, 5e-3))  # numbers that one would set
    rounded = np.round(np.ceil(found / step - 1e-6) * step, 6)
    return np.unique(np.minimum(rounded[rounded > 0], longest))


def characterise(network: Network, load: Load, deadline: float, key: int = 0) -> dict[str, Any]:
    """How the loop times are distributed, and how they hang together from one loop to the next.

    A measured trace is read in its own order, row by row; of any other network 16 runs of 2048 loops are drawn, or of
    as many as the trace within it has. The Gilbert-Elliott fit is that of the misses at `deadline` as a two-state
    Markov chain whose bad state misses every loop: the maximum-likelihood estimates are shares of the observed
    transitions.

    Returns:
        Plain values; None where nothing can be said (no miss to measure the length of). Delays in s, lengths in loops.
    """
    lost = lost_share(network, load)
    percentiles = quantiles(network, load, [level * (1.0 - lost) for level in _PERCENTILES])
    series, reached = _series(network, load, deadline, key), network.reliability(np.float64(deadline), load)
    missed = ~completes(series, deadline)
    before, after = missed[:-1], missed[1:]
    runs = _run_lengths(missed)
    return {
        "lost_share": lost,
        "percentiles_ms": {f"p{100 * p:02g}": 1e3 * float(d) for p, d in zip(_PERCENTILES, percentiles, strict=True)},
        "reliability": float(reached.share),
        "reliability_se": float(reached.error),
        "delay_correlation": _correlation(series),
        "miss_correlation": _pearson(before.ravel(), after.ravel()),
        "mean_miss_run": float(runs.mean()) if runs.size else None,
        "independent_miss_run": 1.0 / max(1.0 - float(missed.mean()), 1.0 / missed.size),
        "p99_miss_run": int(np.quantile(runs, 0.99, method="higher")) if runs.size else 0,
        "gilbert_elliott": {
            "p_good_to_bad": float(after[~before].mean()) if (~before).any() else None,
            "p_bad_to_good": float((~after[before]).mean()) if before.any() else None,
        },
        "loops_seen": int(series.size),
    }


def _series(network: Network, load: Load, deadline: float, key: int) -> np.ndarray:
    """Loop times in order, [ticks, sequences]."""
    if isinstance(network, Trace):
        return np.asarray(network.delays)[:, None]
    keys, trace = jax.random.split(jax.random.key(key), 16), replayed_trace(network)
    ticks = 2048 if trace is None else min(2048, trace.ticks_within(load.tau))
    return np.asarray(loop_times(network, keys, ticks, load.num_robots, load.tau, deadline)[:, :, 0]).T


def _correlation(series: np.ndarray) -> float | None:
    """Lag-1 correlation of the ranks of delays that arrived: a few huge ones would rule that of the delays."""
    before, after = series[:-1].ravel(), series[1:].ravel()
    both = np.isfinite(before) & np.isfinite(after)
    ranks = pd.Series(before[both]).rank().to_numpy(), pd.Series(after[both]).rank().to_numpy()
    return _pearson(*ranks)


def _pearson(a: np.ndarray, b: np.ndarray) -> float | None:
    if a.size < 3 or np.ptp(a.astype(float)) == 0 or np.ptp(b.astype(float)) == 0:
        return None
    return float(np.corrcoef(a, b)[0, 1])


def _run_lengths(missed: np.ndarray) -> np.ndarray:
    """Lengths of all runs of misses, each sequence by itself."""
    lengths = []
    for column in missed.T:
        edges = np.flatnonzero(np.diff(np.concatenate([[False], column, [False]]).astype(int)))
        lengths.append(edges[1::2] - edges[::2])
    return np.concatenate(lengths)
