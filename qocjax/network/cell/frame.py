"""Slots of a cell: which direction each one serves (model, section 13)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from qocjax.network._fields import store_float

__all__ = ["DIRECTIONS", "Frame"]

DIRECTIONS = {"uplink": "UB", "downlink": "DB"}
"""Letters of a pattern that serve a direction; B serves both, as with FDD."""


@dataclass(frozen=True)
class Frame:
    """A pattern of slots that repeats.

    Attributes:
        pattern: A letter for each slot: D (downlink), U (uplink), S (special: neither), or B (both, for FDD).
        slot: Length L of a slot (s): 1 ms at 15 kHz between subcarriers, 0.5 ms at 30 kHz.
    """

    pattern: str = "DDDSU"
    slot: float = 0.5e-3

    def __post_init__(self) -> None:
        store_float(self, "slot", above=0.0)
        if not isinstance(self.pattern, str) or not self.pattern or set(self.pattern) - set("DUSB"):
            raise ValueError(f"Frame.pattern: got {self.pattern!r}, expected letters D, U, S and B, such as DDDSU")
        for direction, letters in DIRECTIONS.items():
            if not set(self.pattern) & set(letters):
                raise ValueError(f"Frame.pattern: got {self.pattern!r} without a slot of the {direction}, "
                                 f"expected at least one {' or '.join(letters)}")  # fmt: skip

    def share(self, direction: str) -> float:
        """Share of the slots that serve a direction."""
        return float(self._serves(direction).mean())

    def before(self, slot: Any, direction: str) -> Array:
        """How many slots of a direction there are before a slot (whole numbers of any shape)."""
        serves = self._serves(direction)
        counts = jnp.asarray(np.concatenate([[0], np.cumsum(serves)[:-1]]), jnp.int32)
        turns, place = jnp.divmod(slot, len(self.pattern))
        return turns * int(serves.sum()) + counts[place]

    def place(self, number: Any, direction: str) -> Array:
        """Which slot the direction's slot of that number is, both counted from 0."""
        places = np.flatnonzero(self._serves(direction)).astype(np.int32)
        turns, rest = jnp.divmod(number, places.size)
        return turns * len(self.pattern) + jnp.asarray(places)[rest]

    def serves(self, direction: str, count: int) -> np.ndarray:
        """Which of the first slots serve a direction, booleans [count]."""
        return self._serves(direction)[np.arange(count) % len(self.pattern)]

    def _serves(self, direction: str) -> np.ndarray:
        return np.isin(list(self.pattern), list(DIRECTIONS[direction]))
