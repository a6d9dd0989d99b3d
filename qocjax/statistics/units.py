"""What counts as one observation: a Monte Carlo seed, or with a measured trace the stretch of it that a seed takes.

However many seeds replay a trace, they know no more of the network than was measured. So errors come from how stretches
of it differ, in which the luck of the seeds is contained.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from qocjax.network import ComputedTrace, Trace
from qocjax.network.correlation import correlation_rows, independent_rows
from qocjax.network.trace import replayed_trace
from qocjax.statistics.recorded import network_keys

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

__all__ = [
    "joined", "judged_apart", "rows_of_stretch", "seeds_apart", "seeds_in", "study_remark", "trace_remark",
    "units_in", "units_of", "with_units",
]  # fmt: skip

_HALVED = 8  # stretches from which half may choose and half judge
_BEYOND = 1 << 24  # seeds from here on
_SPELLS = 30  # independent spells of missed loops from which an interval of a mean is what it says


def units_of(network: Any, seeds: Sequence[int], key: int, horizon: float, tau: ArrayLike) -> np.ndarray:
    """Which seeds share an observation: a label for each, [S], the seed itself where it is one by itself.

    Args:
        network: Where loop times come from.
        seeds: Monte Carlo seeds.
        key: Root of all random numbers.
        horizon: Length of a run (s).
        tau: Sampling periods of what is compared (s); the one with the longest stretches counts.
    """
    trace = replayed_trace(network)
    rows = 0 if trace is None else _run_rows(trace, horizon, tau)
    if trace is None or trace.stretches(rows) == 1:
        return np.asarray(seeds, np.int64)
    return -1 - trace.stretch(network_keys(seeds, key), rows)  # apart from the numbers of seeds


def _run_rows(trace: Trace, horizon: float, tau: ArrayLike) -> int:
    return max(trace.run_rows(horizon, float(each)) for each in np.unique(np.asarray(tau, float)))


def judged_apart(network: Any, horizon: float, tau: ArrayLike) -> bool:
    """Whether a trace is so long that what some stretches of it chose is judged on others.

    Args:
        network: Where loop times come from.
        horizon: Length of a run (s).
        tau: Sampling periods (s).
    """
    trace = replayed_trace(network)
    return trace is not None and trace.stretches(_run_rows(trace, horizon, tau)) >= _HALVED


def seeds_in(network: Any, key: int, unit: int, count: int, horizon: float, tau: ArrayLike) -> list[int]:
    """The first seeds beyond those of any purpose that take the stretch of a label of `units_of`.

    Raises:
        ValueError: The network is no trace with such a stretch.
    """
    trace, found = replayed_trace(network), list[int]()
    if trace is None or not 0 <= -1 - unit < trace.stretches(_run_rows(trace, horizon, tau)):
        raise ValueError(f"unit: got {unit}, expected a stretch of trace {getattr(trace, 'name', None)!r}")
    first = _BEYOND
    while len(found) < count:
        some = range(first, first + 16 * count)
        found += (first + np.flatnonzero(units_of(network, some, key, horizon, tau) == unit)).tolist()
        first = some.stop
    return found[:count]


def rows_of_stretch(trace: Trace, unit: int, horizon: float, tau: ArrayLike) -> tuple[int, int]:
    """First row of the stretch that a label of `units_of` stands for, and the first one after it."""
    return trace.rows_of(-1 - unit, _run_rows(trace, horizon, tau))


def seeds_apart(network: Any, key: int, counts: Sequence[int], horizon: float, tau: ArrayLike) -> list[Sequence[int]]:
    """Sets of fresh seeds of these sizes; those of the last take other stretches of a trace than the rest.

    What was chosen on some stretches is so judged on others: the even ones choose, the odd ones judge. Of a trace that
    is too short for that, and of other networks, the sets are consecutive seeds.

    Args:
        network: Where loop times come from.
        key: Root of all random numbers.
        counts: Sizes of the sets.
        horizon: Length of a run (s).
        tau: Sampling periods (s).
    """
    trace = replayed_trace(network)
    if trace is None or not judged_apart(network, horizon, tau):
        ends = np.cumsum([0, *counts]).tolist()
        return [range(first, last) for first, last in pairwise(ends)]
    rows = _run_rows(trace, horizon, tau)
    odd = np.zeros(0, bool)
    while min((~odd).sum() - sum(counts[:-1]), odd.sum() - counts[-1]) < 0:
        more = range(odd.size, odd.size + 2 * sum(counts))
        odd = np.append(odd, trace.stretch(network_keys(more, key), rows) % 2 == 1)
    even = np.flatnonzero(~odd)
    ends = np.cumsum([0, *counts[:-1]]).tolist()
    return [*(even[a:b].tolist() for a, b in pairwise(ends)), np.flatnonzero(odd)[: counts[-1]].tolist()]


def joined(labels: Sequence[np.ndarray]) -> np.ndarray:
    """One observation where any of several labellings [S] of the same seeds has one: labels of their finest cover."""
    if all(np.array_equal(each, labels[0]) for each in labels):
        return labels[0]
    found, seeds = np.arange(labels[0].size), np.arange(labels[0].size)
    for _ in seeds:
        before = found
        for each in labels:
            _, place = np.unique(each, return_inverse=True)
            least = np.full(place.max() + 1, seeds.size)
            np.minimum.at(least, place, found)
            found = least[place]
        if np.array_equal(before, found):
            break
    return -1 - found


def with_units(runs: xr.Dataset, units: np.ndarray) -> xr.Dataset:
    """Runs that know which stretch of a trace each seed takes; as they are where a seed is one by itself."""
    if np.array_equal(units, runs["seed"].values):
        return runs
    return runs.assign_coords(stretch=("seed", -1 - units, {"long_name": "stretch of the trace"}))


def units_in(runs: xr.Dataset) -> np.ndarray:
    """The labels that `with_units` put there, [S]."""
    return -1 - runs["stretch"].values if "stretch" in runs.coords else runs["seed"].values.astype(np.int64)


def study_remark(network: Any, policies: pd.DataFrame, horizon: float, tau: ArrayLike) -> str | None:
    """What `trace_remark` says of the deadlines that Co-design chose."""
    chosen = policies.loc[policies["policy"] == "Co-design", "deadline"]
    return trace_remark(network, chosen[np.isfinite(chosen)], horizon, tau)


def trace_remark(network: Any, deadline: ArrayLike, horizon: float, tau: ArrayLike) -> str | None:
    """What a trace is too short to say; None where it is long enough, or the network is none.

    Args:
        network: Where loop times come from.
        deadline: Deadlines that matter (s); the one with the fewest spells of missed loops counts.
        horizon: Length of a run (s).
        tau: Sampling periods (s).
    """
    trace = replayed_trace(network)
    if trace is None:
        return None
    size, run = np.size(trace.delays), _run_rows(trace, horizon, tau)
    if trace.stretches(run) == 1:
        return (
            f"trace {trace.name!r} is too short to say how another measurement of its network would differ: {size} "
            f"loops, of which about {correlation_rows(trace.delays):.0f} hang together, for runs of {run}; "
            "intervals are those of replays of this one"
        )
    computing = _usual_computing(network)
    limits = np.unique(np.asarray(deadline, float)) - computing
    few = next((text for limit in limits if (text := _few_spells(trace, float(limit)))), None)
    return f"{few}; the deadline less the usual {1e3 * computing:.4g} ms of computing" if few and computing else few


def _usual_computing(network: Any) -> float:
    """Median of the computing time (s) that a trace does not hold; 0 where it holds it."""
    while network is not None and not isinstance(network, ComputedTrace):
        network = getattr(network, "network", None) or getattr(network, "path", None)
    return 0.0 if network is None else float(network.compute.quantile(0.5))


def _few_spells(trace: Trace, deadline: float) -> str | None:
    """A sentence where the loops that decide at a deadline come in few independent spells."""
    missed = 1.0 - float(trace.reliability(deadline).share)
    enough = independent_rows(trace.delays, deadline)
    spells, rarer = min(missed, 1.0 - missed) * enough, "missed" if missed < 0.5 else "completed"
    if spells >= _SPELLS:
        return None
    at = f"trace {trace.name!r} has "
    if spells == 0.0:
        most = 3.0 / np.size(trace.delays)
        return at + (f"no {rarer} loop at {1e3 * deadline:.4g} ms, and so does not say how often there are any "
                     f"(below {most:.1g} were they independent)")  # fmt: skip
    return at + (f"only about {max(spells, 1.0):.0f} independent spells of {rarer} loops at {1e3 * deadline:.4g} ms: "
                 f"intervals hold less often than they say (below {_SPELLS} spells)")  # fmt: skip
