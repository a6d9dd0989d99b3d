"""What counts as one observation: a Monte Carlo seed, or with a measured trace the stretch of it that a seed takes.

However many seeds replay a trace, they know no more of the network than was measured. So errors come from how stretches
of it differ, in which the luck of the seeds is contained.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike

from qocjax.network import Trace
from qocjax.network.correlation import correlation_rows, independent_rows
from qocjax.study.recorded import network_keys

__all__ = ["study_remark", "trace_of", "trace_remark", "units_in", "units_of", "with_units"]

_SPELLS = 30  # independent spells of missed loops from which an interval of a mean is what it says


def trace_of(network: Any) -> Trace | None:
    """The trace that a network replays, as it is or made worse; None for any other network."""
    while network is not None and not isinstance(network, Trace):
        network = getattr(network, "network", None)
    return network


def units_of(network: Any, seeds: Sequence[int], key: int) -> np.ndarray:
    """Which seeds share an observation: a label for each, [S], the seed itself where it is one by itself.

    Args:
        network: Where loop times come from.
        seeds: Monte Carlo seeds.
        key: Root of all random numbers.
    """
    trace = trace_of(network)
    if trace is None or trace.stretches == 1:
        return np.asarray(seeds, np.int64)
    return -1 - trace.stretch(network_keys(seeds, key))  # apart from the numbers of seeds


def with_units(runs: xr.Dataset, units: np.ndarray) -> xr.Dataset:
    """Runs that know which stretch of a trace each seed takes; as they are where a seed is one by itself."""
    if np.array_equal(units, runs["seed"].values):
        return runs
    return runs.assign_coords(stretch=("seed", -1 - units, {"long_name": "stretch of the trace"}))


def units_in(runs: xr.Dataset) -> np.ndarray:
    """The labels that `with_units` put there, [S]."""
    return -1 - runs["stretch"].values if "stretch" in runs.coords else runs["seed"].values.astype(np.int64)


def study_remark(network: Any, policies: pd.DataFrame) -> str | None:
    """What `trace_remark` says of the deadlines that Co-design chose."""
    chosen = policies.loc[policies["policy"] == "Co-design", "deadline"]
    return trace_remark(network, chosen[np.isfinite(chosen)])


def trace_remark(network: Any, deadline: ArrayLike) -> str | None:
    """What a trace is too short to say; None where it is long enough, or the network is none.

    Args:
        network: Where loop times come from.
        deadline: Deadlines that matter (s); the one with the fewest spells of missed loops counts.
    """
    trace = trace_of(network)
    if trace is None:
        return None
    rows, together = np.size(trace.delays), correlation_rows(trace.delays)
    if trace.stretches == 1:
        return (
            f"trace {trace.name!r} is too short to say how another measurement of its network would differ: {rows} "
            f"loops of which about {together:.0f} hang together; intervals are those of replays of this one"
        )
    for limit in np.unique(np.asarray(deadline, float)):
        share = 1.0 - float(trace.reliability(limit).share)
        spells = min(share, 1.0 - share) * independent_rows(trace.delays, float(limit))
        if 0.0 < spells < _SPELLS:
            rarer = "missed" if share < 0.5 else "completed"
            return (
                f"trace {trace.name!r} has only about {max(spells, 1.0):.0f} independent spells of {rarer} loops at "
                f"{1e3 * limit:.4g} ms: intervals hold less often than they say (below {_SPELLS} spells)"
            )
    return None
