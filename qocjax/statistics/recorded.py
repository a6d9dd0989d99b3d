"""Loop times worked out beforehand, given back seed by seed: for networks that are costly, or compiled elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax._kept import called
from qocjax.network.completion import latest
from qocjax.network.interface import Load, Reliability
from qocjax.statistics.estimates import standard_error

__all__ = ["RecordedLoops", "network_keys"]


def network_keys(seeds: Sequence[int], key: int) -> Array:
    """Keys with which `evaluate` draws the loop times of Monte Carlo seeds, [S]."""
    return jax.random.wrap_key_data(called(_words, (np.asarray(seeds, np.uint32), np.int32(key)), ()))


def _words(seeds: Array, key: Array) -> Array:
    root = jax.random.key(key)
    return jax.vmap(lambda seed: jax.random.key_data(jax.random.split(jax.random.fold_in(root, seed))[1]))(seeds)


@dataclass(frozen=True, eq=False)
class RecordedLoops:
    """A network that gives each Monte Carlo seed the loop times that were recorded for its key.

    Attributes:
        keys: [S] keys, as of `network_keys`.
        times: [S, P, N] T_net (s), inf where lost.
        name: For labels.
    """

    keys: Array
    times: np.ndarray
    name: str

    def draw(self, key: Array, num_ticks: int, num_robots: int, tau: float) -> Array:
        """Gives back the loop times of a key, [P, N] s.

        Raises:
            ValueError: Other ticks or robots are asked for than were recorded.
        """
        self._check(num_ticks, num_robots)
        known = jax.random.key_data(self.keys)
        row = jnp.argmax(jnp.all(known == jax.random.key_data(key)[None, :], axis=-1))
        return jnp.asarray(self.times, jnp.result_type(float))[row]

    def given(self, seeds: Sequence[int], key: int, num_ticks: int, num_robots: int) -> np.ndarray:
        """What `draw` gives back for Monte Carlo seeds, [S, P, N] s, without a program that holds all loop times.

        Raises:
            ValueError: Other ticks or robots are asked for than were recorded.
        """
        self._check(num_ticks, num_robots)
        known, asked = (np.asarray(jax.random.key_data(keys)) for keys in (self.keys, network_keys(seeds, key)))
        return self.times[np.argmax((known[None] == asked[:, None]).all(axis=-1), axis=1)]

    def _check(self, num_ticks: int, num_robots: int) -> None:
        if self.times.shape[1:] != (num_ticks, num_robots):
            raise ValueError(f"recorded loops: got {self.times.shape[1:]}, expected {(num_ticks, num_robots)}")

    def reliability(self, deadline: Any, load: Load | None = None) -> Reliability:
        """Returns the share of the recorded loops that complete by `deadline` (s), with its error over the seeds."""
        rows = np.sort(self.times.reshape(len(self.times), -1), axis=1)
        allowed = latest(np.asarray(deadline, np.float64))
        shares = np.stack([np.searchsorted(row, allowed, side="right") for row in rows]) / rows.shape[1]
        return Reliability(shares.mean(axis=0), standard_error(np.moveaxis(shares, 0, -1)))

    def describe(self) -> dict[str, Any]:
        """Returns name and size as plain values."""
        return {"kind": type(self).__name__, "name": self.name, "shape": list(self.times.shape)}
