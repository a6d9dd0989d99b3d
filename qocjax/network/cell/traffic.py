"""What other traffic leaves of a direction's slots: a constant share, and bursts (model, section 13)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from qocjax import _draws
from qocjax.network._fields import plain, store_float
from qocjax.network.cell.frame import Frame

__all__ = ["Capacity", "OtherTraffic"]


@dataclass(frozen=True)
class OtherTraffic:
    """Traffic of others in one direction; it is served first.

    Attributes:
        share: Of every slot, all the time.
        burst_share: Of every slot, in addition while a burst lasts.
        burst_length: Mean length of a burst (s); lengths and pauses are exponential.
        burst_time: Share of the time in bursts.
    """

    share: float = 0.0
    burst_share: float = 0.0
    burst_length: float = 0.1
    burst_time: float = 0.0

    def __post_init__(self) -> None:
        for name in ("share", "burst_share", "burst_time"):
            store_float(self, name, least=0.0, most=1.0)
        store_float(self, "burst_length", above=0.0)
        if self.share >= 1.0 or self.share + self.burst_share > 1.0:
            raise ValueError(f"OtherTraffic: got share {self.share:g} and burst_share {self.burst_share:g}, expected "
                             "a share below 1 and a sum of at most 1")  # fmt: skip
        if self.bursty and self.burst_time >= 1.0:
            raise ValueError(f"OtherTraffic.burst_time: got {self.burst_time:g}, expected it below 1")

    @property
    def bursty(self) -> bool:
        """Whether there are bursts at all."""
        return self.burst_share > 0.0 and self.burst_time > 0.0

    @property
    def mean_share(self) -> float:
        """Share of the slots that it takes in the mean."""
        return self.share + (self.burst_share * self.burst_time if self.bursty else 0.0)

    def draw(self, key: Array, frame: Frame, seconds: float) -> Array:
        """Draws which slots of that time lie in a burst, booleans [slots], whole patterns; none without bursts."""
        if not self.bursty:
            return jnp.zeros((0,), bool)
        pause = self.burst_length * (1.0 / self.burst_time - 1.0)
        rounds = seconds / (self.burst_length + pause)
        pairs = math.ceil(rounds + 6.0 * math.sqrt(rounds)) + 10
        of_state, of_length = jax.random.split(key)
        begins_on = _draws.bernoulli(of_state, self.burst_time).astype(jnp.int32)
        lengths = _draws.exponential(of_length, (2 * pairs,))
        on = (jnp.arange(2 * pairs) + begins_on) % 2 == 1
        changes = jnp.cumsum(lengths * jnp.where(on, self.burst_length, pause))
        pattern = len(frame.pattern)  # what comes round again keeps the direction of its slots
        instants = jnp.arange(math.ceil(seconds / (pattern * frame.slot)) * pattern) * frame.slot
        return (jnp.searchsorted(changes, instants, side="right") + begins_on) % 2 == 1

    def describe(self) -> dict[str, Any]:
        """Returns the traffic as plain values."""
        return plain(self)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Capacity:
    """What the slots of a direction can carry in one run, in units of a whole slot; `*B` is any batch."""

    free: Array  # share of a slot without a burst
    burst: Array  # share that a burst takes in addition
    on: Array | None  # [slots + 1, *B] slots of the direction in bursts before each slot; None without bursts

    def between(self, slot: Array, later: Array, frame: Frame, direction: str) -> Array:
        """What slots from one up to a later one, itself left out, can carry; slots [M, *B]."""
        count = frame.before(later, direction) - frame.before(slot, direction)
        if self.on is None:
            return count * self.free
        return count * self.free - (self._bursts(later) - self._bursts(slot)) * self.burst

    def carried_by(self, slot: Array, need: Array, frame: Frame, direction: str, slack: float) -> Array:
        """The slot that carries the last of what is needed from a slot on, [M, *B]; the smallest that does."""
        if self.on is None:
            count = jnp.maximum(jnp.ceil(need / self.free - slack).astype(jnp.int32), 1)
            return frame.place(frame.before(slot, direction) + count - 1, direction)
        enough = self._enough(slot, need, frame, direction)

        def halve(_: int, ends: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = ends  # `low` slots are too few, `high` are enough
            middle = (low + high) // 2
            reached = self.between(slot, slot + middle, frame, direction) >= need - slack
            return jnp.where(reached, low, middle), jnp.where(reached, middle, high)

        _, count = jax.lax.fori_loop(0, 31, halve, (jnp.zeros_like(slot), enough))
        return slot + count - 1

    def _bursts(self, slot: Array) -> Array:
        """Slots in bursts before a slot; what was drawn repeats."""
        assert self.on is not None
        turns, rest = jnp.divmod(slot, self.on.shape[0] - 1)
        return turns * self.on[-1:] + jnp.take_along_axis(self.on, rest, axis=0)

    def _enough(self, slot: Array, need: Array, frame: Frame, direction: str) -> Array:
        """How many slots carry what is needed for sure: whole rounds of what was drawn."""
        assert self.on is not None
        length = self.on.shape[0] - 1
        whole = frame.before(jnp.asarray(length), direction) * self.free - self.on[-1:] * self.burst
        rounds = jnp.ceil(need / jnp.maximum(whole, 1e-3)) + 1.0
        return (jnp.minimum(rounds, 2**30 // length) * length).astype(jnp.int32)
