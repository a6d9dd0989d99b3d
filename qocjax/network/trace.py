"""A measured trace of loop times, replayed in order, so that its correlation survives (model, section 4)."""

from __future__ import annotations

import warnings
import weakref
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike

from qocjax import _draws
from qocjax._kept import called
from qocjax.network._fields import delay_array, no_nan, store_float
from qocjax.network.completion import latest
from qocjax.network.correlation import correlation_rows
from qocjax.network.empirical import Empirical
from qocjax.network.interface import Load, Reliability, exactly
from qocjax.scenario import num_ticks

__all__ = ["Trace", "faster_than_measured", "key_of_copy", "replayed_trace", "with_replayed"]

_WITHIN = ("network", "path", "trace")  # what a network that is made of another calls it

_STRETCHES = (16, 8, 4)  # each number's stretches are unions of those of the one before; fewer say nothing of a network
_LENGTH = 8.0  # correlation lengths in a stretch
_RUNS = 1.6  # runs in a stretch: one that reads on into the next is not independent of it
_NEAR = 0.97  # of the measured period; a sampling period that much shorter is the same rate


@dataclass(frozen=True, eq=False)
class Trace:
    """Measured loop times, one after the other.

    The trace is cut into stretches, each long against a run and against the time over which its loops hang together.
    Every Monte Carlo seed takes one at random: its robots start there, each at a random place of its own, read on
    beyond its end, and go on at the start where the trace ends. So a seed sees the network of one time, and how
    stretches differ tells how another measurement of the same network would (`stretch`).

    Loop p takes row p, however long the measurement waited between rows, unless `period` says how long: then it takes
    the row measured p * tau after the start, so that bursts keep their length in seconds.
    """

    delays: ArrayLike  # [L] s, inf for a lost loop; kept as a read-only float64 array
    name: str
    period: float | None = None  # s, between two rows of the measurement; None for one row per tick
    source: str = ""  # where it comes from, for the record
    period_from: str = ""  # where the period comes from, such as a column of send times

    def __post_init__(self) -> None:
        object.__setattr__(self, "delays", delay_array("Trace.delays", self.delays))
        if self.period is not None:
            store_float(self, "period", above=0.0)

    def draw(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Array:
        """Replays the trace for one Monte Carlo seed: loop times [P, N] (s), inf where lost.

        Robots start in different parts of a stretch, at different rows if there are enough. Warns, once in the life of
        a trace, if the run is longer than the trace, which then comes round again.
        """
        steps = self._steps(num_ticks, tau)
        self._warn_if_shorter(int(steps[-1]) + 1)
        return self._replay(key, jax.random.split(key)[1], steps, num_robots)

    def draw_again(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Array:
        """Replays other places of the stretch that a seed takes, [P, N] s: a copy of the network at the same time."""
        return self._replay(key, key_of_copy(key), self._steps(num_ticks, tau), num_robots)

    def _replay(self, key: Array, of_robots: Array, steps: np.ndarray, num_robots: int) -> Array:
        rows = jnp.asarray(self.delays, jnp.result_type(float))
        edges = jnp.asarray(self._edges(self.stretches(int(steps[-1]) + 1)))
        row = _row(key, np.size(self.delays))
        place = jnp.searchsorted(edges, row, side="right") - 1
        begin, size = edges[place], edges[place + 1] - edges[place]
        part = jnp.maximum(size // num_robots, 1)
        apart = jnp.arange(num_robots) * part + _draws.whole(of_robots, part, (num_robots,))
        start = begin + (row - begin + apart) % size
        return rows[((steps % rows.size)[:, None] + start[None, :]) % rows.size]

    def run_rows(self, horizon: float, tau: float) -> int:
        """Rows that a run of `horizon` s with a loop every `tau` s takes."""
        return int(self._steps(num_ticks(horizon, tau), tau)[-1]) + 1

    def ticks_within(self, tau: float) -> int:
        """Loops, one every `tau` s, that the trace has rows for before it comes round again."""
        rows = np.size(self.delays)
        return rows if self.period is None else max(int((rows - 1e-6) * self.period / tau), 1)

    def stretches(self, run_rows: int) -> int:
        """Number of stretches for runs of so many rows; 1 where the trace is too short to be cut."""
        least = max(_LENGTH * self._together, _RUNS * run_rows)
        return next((number for number in _STRETCHES if number * least <= np.size(self.delays)), 1)

    def stretch(self, keys: Array, run_rows: int) -> np.ndarray:
        """Which stretch each Monte Carlo seed takes, [S], by its key; for runs of so many rows."""
        rows = called(_rows, (jax.random.key_data(keys),), (int(np.size(self.delays)),))
        return np.searchsorted(self._edges(self.stretches(run_rows)), rows, side="right") - 1

    def rows_of(self, stretch: int, run_rows: int) -> tuple[int, int]:
        """First row of a stretch, and the first one after it; for runs of so many rows."""
        first, end = self._edges(self.stretches(run_rows))[stretch : stretch + 2]
        return int(first), int(end)

    def reliability(self, deadline: Any, load: Load | None = None) -> Reliability:
        """Returns the share of the loops of the trace that complete by `deadline` (s), whatever the load.

        Raises:
            ValueError: A deadline is NaN.
        """
        return exactly(self._law.cdf(latest(no_nan("deadline", deadline))))

    def describe(self) -> dict[str, Any]:
        """Returns name, source, size and quantiles as plain values, not the rows."""
        own = {"kind": "Trace", "name": self.name, "period": self.period, "period_from": self.period_from}
        return self._law.describe() | own

    @cached_property
    def _law(self) -> Empirical:
        return Empirical(self.delays, self.source)

    @cached_property
    def _together(self) -> float:
        return correlation_rows(self.delays)

    def _edges(self, stretches: int) -> np.ndarray:
        """First row of each stretch, and the number of rows."""
        whole = np.arange(_STRETCHES[0] + 1) * np.size(self.delays) // _STRETCHES[0]
        return whole[:: _STRETCHES[0] // stretches]

    def _steps(self, num_ticks: int, tau: float) -> np.ndarray:
        """Rows between the start and each tick, [P]."""
        if self.period is None:
            return np.arange(num_ticks)
        return np.floor(np.arange(num_ticks) * (tau / self.period) + 1e-6).astype(int)

    def _warn_if_shorter(self, needed: int) -> None:
        rows = np.size(self.delays)
        if needed > rows and self not in _ROUND_AGAIN:
            _ROUND_AGAIN.add(self)
            warnings.warn(
                f"trace {self.name!r} has {rows} rows and a run takes {needed}: it comes round again within the run",
                stacklevel=3,
            )


def key_of_copy(key: Array) -> Array:
    """The key of a second network beside one with this key: its numbers are others.

    A small number would not do: folded in, it gives one of the keys that a split of this key gives.
    """
    return jax.random.fold_in(key, 7919)


def replayed_trace(network: Any) -> Trace | None:
    """The trace that a network replays: as it is, made worse, or with a computation; None for any other network."""
    while network is not None and not isinstance(network, Trace):
        within = (getattr(network, name, None) for name in _WITHIN)
        network = next((each for each in within if each is not None), None)
    return network


def with_replayed(network: Any, trace: Trace) -> Any:
    """A network that replays a trace, with another one in its place."""
    if isinstance(network, Trace):
        return trace
    name = next(name for name in _WITHIN if getattr(network, name, None) is not None)
    return replace(network, **{name: with_replayed(getattr(network, name), trace)})


def faster_than_measured(network: Any, tau: float) -> str | None:
    """Says what is wrong with replaying a trace at a shorter sampling period than it was measured with.

    A trace tells nothing of loops that it does not hold: more of them would load the network, and between two rows it
    repeats the last, so that the edge looks free and a burst of misses is met with fewer independent ones.

    Args:
        network: Any network; only a trace that knows its period can be too slow.
        tau: Sampling period of the replay (s).

    Returns:
        One sentence with what to do; None where there is nothing to say.
    """
    trace = replayed_trace(network)
    if trace is None or trace.period is None or tau >= _NEAR * trace.period:
        return None
    origin = f" ({trace.period_from})" if trace.period_from else ""
    return (
        f"trace {trace.name!r} was measured with a loop every {1e3 * trace.period:.4g} ms{origin} and is replayed "
        f"with one every {1e3 * tau:.4g} ms: what that many loops do to the network is not in it; measure at that "
        f"rate, set the sampling period (loop.tau, search.tau) to {trace.period:.4g} s or more, or allow it with "
        "network.faster_than_measured=true"
    )


def _row(key: Array, count: int) -> Array:
    """The row of so many that decides a seed's stretch."""
    return _draws.whole(jax.random.split(key)[0], count)


def _rows(words: Array, count: int) -> Array:
    """Those of several seeds, by the words of their keys."""
    return jax.vmap(lambda each: _row(jax.random.wrap_key_data(each), count))(words)


_ROUND_AGAIN: weakref.WeakSet[Trace] = weakref.WeakSet()  # those that have said so
