"""What goes over the air: messages of one direction, and how a robot comes to send (model, section 13)."""

from __future__ import annotations

from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
from jax import Array

from qocjax import _draws
from qocjax.network._fields import store_float
from qocjax.network.cell.frame import Frame
from qocjax.network.cell.traffic import OtherTraffic
from qocjax.scenario import _pytree

__all__ = ["Access", "Direction"]


@_pytree
@dataclass(frozen=True)
class Direction:
    """One direction of the air.

    Attributes:
        message_bytes: Of one message with all headers.
        slot_bits: What a slot of the direction carries, without other traffic.
        bler: Probability that one transmission fails.
        other: Traffic that is served first.
    """

    message_bytes: float
    slot_bits: float
    bler: float = field(default=0.0, metadata={"static": True})
    other: OtherTraffic = field(default=OtherTraffic(), metadata={"static": True})

    def __post_init__(self) -> None:
        for name in ("message_bytes", "slot_bits"):
            store_float(self, name, above=0.0)
        store_float(self, "bler", least=0.0, most=1.0)

    @property
    def size(self) -> float:
        """What one transmission of a message takes, in whole slots of the direction."""
        return 8.0 * self.message_bytes / self.slot_bits

    def mean_size(self, harq_max: int) -> float:
        """What a message takes in the mean, repetitions included, in whole slots of the direction."""
        return self.size * sum(self.bler**k for k in range(harq_max))

    def draw(self, key: Array, shape: tuple[int, int], frame: Frame, seconds: float) -> tuple[Array, Array]:
        """Draws failed transmissions of each message, one after the other [P, N], and slots in bursts."""
        of_failures, of_bursts = jax.random.split(key)
        failures = jnp.zeros(shape)
        if self.bler > 0.0:  # geometric: one more failure each time that a uniform number lies below the next power
            uniform = _draws.uniform(of_failures, shape, float(jnp.finfo(jnp.float32).tiny))
            failures = jnp.floor(jnp.log(uniform) / jnp.log(self.bler)) if self.bler < 1.0 else jnp.full(shape, jnp.inf)
        return failures, self.other.draw(of_bursts, frame, seconds)


@dataclass(frozen=True)
class Access:
    """How a robot comes to send: at once on a configured grant, or by a scheduling request.

    Attributes:
        request_period: Of the instants at which a robot may ask (s); they and the sampling clock run independently, so
            it waits a uniform part of this. 0 for a configured grant.
        grant: From the request until it may send (s); 0 for a configured grant.
    """

    request_period: float = 0.0
    grant: float = 0.0

    def __post_init__(self) -> None:
        for name in ("request_period", "grant"):
            store_float(self, name, least=0.0)
