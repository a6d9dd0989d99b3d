"""QoS profile of one topic, its protocol timers, and what its messages weigh on the wire (model, section 8)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
from jax import Array

from qocjax import _checks
from qocjax.network._fields import plain, store_float

__all__ = ["RELIABILITIES", "TIMERS", "WINDOW", "Profile"]

RELIABILITIES = ("best_effort", "reliable")
LIFESPANS = ("source", "reception")
PIGGYBACKS = ("always", "full", "never")
WINDOW = 256  # samples that one ACKNACK can ask for (RTPS 2.5, SequenceNumberSet)

# Protocol timers by middleware, as its own defaults are: Eclipse Cyclone DDS 11.0.1; eProsima Fast DDS 3.2.3 (times of
# writer and reader in its documentation, when samples carry heartbeats from its source).
TIMERS: dict[str, dict[str, Any]] = {
    "cyclonedds": {
        "heartbeat_period": 0.1, "piggyback": "always", "acknack_delay": 0.0, "nack_period": 0.1, "repair_delay": 0.0,
        "repair_packet": 1456, "lifespan_from": "reception",
    },
    "fastdds": {
        "heartbeat_period": 3.0, "piggyback": "full", "acknack_delay": 0.005, "nack_period": 0.0, "repair_delay": 0.005,
        "repair_packet": 65500, "lifespan_from": "source",
    },
}  # fmt: skip

# Bytes on the wire: IPv4 and UDP headers, RTPS header, and submessages (RTPS 2.5, section 9.4.5).
_HEADERS = 28 + 20
_INFO_TS, _INFO_DST, _DATA, _HEARTBEAT, _ACKNACK = 12, 16, 24, 32, 32
_IP, _MTU = 20, 1500  # bytes of an IPv4 header, and of the largest packet that needs no fragments


@dataclass(frozen=True)
class Profile:
    """QoS of a topic, on writer and reader, with the timers of the RTPS protocol. Defaults are Eclipse Cyclone DDS's.

    Attributes:
        reliability: `best_effort` or `reliable`.
        depth: KEEP_LAST depth of the writer's history; None for KEEP_ALL.
        reader_depth: Samples of a burst that the reader hands over, its newest; None for all.
        lifespan: Age (s) from which a sample is neither repaired nor handed over.
        lifespan_from: From when the reader counts it: `source`, when the sample was written, as Fast DDS does (clocks
            must be in step), or `reception`, as Cyclone DDS does: then a sample may be older by its way.
        deadline: DDS's DEADLINE (s): periods without a sample are counted, no more. Not the deadline of a loop.
        heartbeat_period: Time (s) since the last heartbeat after which the writer sends one by itself; unless
            `piggyback` is `always`, the time between two of these, from the first sample on.
        piggyback: Which samples carry a heartbeat, so that a gap before them is seen: `always` all, as in Cyclone DDS;
            `full` those written while the history is full of samples that the reader has not acknowledged, as in Fast
            DDS, whose reader answers every heartbeat; `never` none, only the periodic heartbeats show gaps.
        acknack_delay: Time (s) from the heartbeat that shows a new gap to the ACKNACK.
        nack_period: Least time (s) between two ACKNACKs that ask for the same samples; has no say with `full`.
        repair_delay: Time (s) from an ACKNACK's arrival at the writer to the repair.
        repair_packet: Bytes that the repairs which answer one ACKNACK are packed into. What is beyond 1500 goes in
            fragments, and is lost with any of them.
    """

    reliability: str = "reliable"
    depth: int | None = 10
    reader_depth: int | None = None
    lifespan: float = math.inf
    lifespan_from: str = "source"
    deadline: float = math.inf
    heartbeat_period: float = 0.1
    piggyback: str = "always"
    acknack_delay: float = 0.0
    nack_period: float = 0.1
    repair_delay: float = 0.0
    repair_packet: int = 1456

    def __post_init__(self) -> None:
        _checks.choice("Profile.reliability", self.reliability, RELIABILITIES)
        _checks.choice("Profile.lifespan_from", self.lifespan_from, LIFESPANS)
        _checks.choice("Profile.piggyback", self.piggyback, PIGGYBACKS)
        object.__setattr__(self, "repair_packet", _checks.count("Profile.repair_packet", self.repair_packet))
        for name in ("depth", "reader_depth"):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, _checks.count(f"Profile.{name}", value))
        for name in ("lifespan", "deadline"):
            if getattr(self, name) != math.inf:
                store_float(self, name, above=0.0)
        store_float(self, "heartbeat_period", above=0.0)
        for name in ("acknack_delay", "nack_period", "repair_delay"):
            store_float(self, name, least=0.0)

    @property
    def reliable(self) -> bool:
        """Whether lost samples are repaired."""
        return self.reliability == "reliable"

    @property
    def confirms(self) -> bool:
        """Whether the reader answers every heartbeat, and the writer's heartbeats hang on that."""
        return self.piggyback == "full"

    @property
    def window(self) -> int:
        """Samples that may be missing at a time, as far as an ACKNACK can say."""
        return WINDOW if self.depth is None else min(self.depth, WINDOW)

    def data_bytes(self, payload: int) -> int:
        """Bytes of a sample's packet, without the heartbeat that it may carry."""
        return _HEADERS + _INFO_TS + _DATA + payload

    def repair_bytes(self, payload: int) -> tuple[int, int]:
        """Bytes of each packet of repairs by itself, and of each sample in it."""
        return _HEADERS + _INFO_DST, _INFO_TS + _DATA + payload

    def repairs_per_packet(self, payload: int) -> int:
        """Samples that one packet of repairs takes."""
        packet, sample = self.repair_bytes(payload)
        return max(1, (self.repair_packet - packet) // sample)

    def fragments(self, samples: Array, payload: int) -> Array | None:
        """IP fragments of a packet with so many samples, None where no packet needs any."""
        if self.repair_packet <= _MTU:
            return None
        packet, sample = self.repair_bytes(payload)
        return jnp.maximum(1, -(-(packet + samples * sample - _IP) // (_MTU - _IP)))

    def describe(self) -> dict[str, Any]:
        """Returns the profile as plain values."""
        return plain(self)


CARRIED_BYTES = _HEARTBEAT  # of a heartbeat that a sample carries
HEARTBEAT_BYTES = _HEADERS + _INFO_DST + _HEARTBEAT
ACKNACK_BYTES = _HEADERS + _INFO_DST + _ACKNACK
