"""What a design asks of the network: loops per second, throughput each way, and 5G resource blocks.

The resource blocks follow the data rate of 3GPP TS 38.306, section 4.1.2, for one carrier, with the modulation and code
rate of an MCS index of TS 38.214, table 5.1.3.1-1, in place of the device's largest ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from qocjax import _checks

__all__ = ["BANDWIDTH_PARTS", "MCS_TABLE_1", "Carrier", "Demand", "Traffic"]

# (bits per symbol, code rate x 1024) by MCS index, TS 38.214 table 5.1.3.1-1 (up to 64QAM).
MCS_TABLE_1 = (
    (2, 120), (2, 157), (2, 193), (2, 251), (2, 308), (2, 379), (2, 449), (2, 526), (2, 602), (2, 679),
    (4, 340), (4, 378), (4, 434), (4, 490), (4, 553), (4, 616), (4, 658),
    (6, 438), (6, 466), (6, 517), (6, 567), (6, 616), (6, 666), (6, 719), (6, 772), (6, 822), (6, 873), (6, 910),
    (6, 948),
)  # fmt: skip

# Resource blocks by numerology and bandwidth (MHz) in frequency range 1, TS 38.101-1 table 5.3.2-1.
BANDWIDTH_PARTS = {
    0: {5: 25, 10: 52, 15: 79, 20: 106, 25: 133, 30: 160, 40: 216, 50: 270},
    1: {5: 11, 10: 24, 15: 38, 20: 51, 25: 65, 30: 78, 40: 106, 50: 133, 60: 162, 70: 189, 80: 217, 90: 245, 100: 273},
    2: {10: 11, 15: 18, 20: 24, 25: 31, 30: 38, 40: 51, 50: 65, 60: 79, 70: 93, 80: 107, 90: 121, 100: 135},
}  # fmt: skip

_SUBCARRIERS, _SYMBOLS = 12, 14  # of a resource block; of a slot with normal cyclic prefix
_OVERHEAD = {"uplink": 0.08, "downlink": 0.14}  # frequency range 1, TS 38.306 section 4.1.2


@dataclass(frozen=True)
class Carrier:
    """A 5G carrier in frequency range 1.

    Attributes:
        bandwidth_mhz: Width of the bandwidth part.
        numerology: mu; the subcarrier spacing is 15 · 2^mu kHz.
        mcs_uplink: MCS index of the uplink, TS 38.214 table 5.1.3.1-1.
        mcs_downlink: MCS index of the downlink.
        layers_uplink: Spatial layers of the uplink.
        layers_downlink: Spatial layers of the downlink.
        uplink_share: Share of time that serves the uplink, 1 for FDD.
        downlink_share: Share of time that serves the downlink, 1 for FDD.
    """

    bandwidth_mhz: int = 20
    numerology: int = 1
    mcs_uplink: int = 10
    mcs_downlink: int = 10
    layers_uplink: int = 1
    layers_downlink: int = 1
    uplink_share: float = 1.0
    downlink_share: float = 1.0

    def __post_init__(self) -> None:
        if self.numerology not in BANDWIDTH_PARTS:
            raise ValueError(f"numerology: got {self.numerology}, expected one of 0, 1, 2 (frequency range 1)")
        if self.bandwidth_mhz not in BANDWIDTH_PARTS[self.numerology]:
            known = ", ".join(map(str, BANDWIDTH_PARTS[self.numerology]))
            raise ValueError(f"bandwidth_mhz: got {self.bandwidth_mhz} at numerology {self.numerology}, expected one "
                             f"of {known}")  # fmt: skip
        for name in ("mcs_uplink", "mcs_downlink"):
            if _checks.count(name, getattr(self, name), least=0) >= len(MCS_TABLE_1):
                raise ValueError(f"{name}: got {getattr(self, name)}, expected 0 to {len(MCS_TABLE_1) - 1}")
        for name in ("layers_uplink", "layers_downlink"):
            _checks.bounded(name, _checks.count(name, getattr(self, name)), most=8)
        for name in ("uplink_share", "downlink_share"):
            _checks.bounded(name, getattr(self, name), above=0, most=1, shape=())

    @property
    def resource_blocks(self) -> int:
        """N_PRB of the bandwidth part."""
        return BANDWIDTH_PARTS[self.numerology][self.bandwidth_mhz]

    def rate_per_block(self, direction: str) -> float:
        """Bits per second that one resource block carries, by the formula of TS 38.306 section 4.1.2.

        Args:
            direction: `uplink` or `downlink`.
        """
        _checks.choice("direction", direction, _OVERHEAD)
        bits, code_rate = MCS_TABLE_1[getattr(self, f"mcs_{direction}")]
        symbol_time = 1e-3 / (_SYMBOLS * 2**self.numerology)
        layers, share = getattr(self, f"layers_{direction}"), getattr(self, f"{direction}_share")
        return layers * bits * code_rate / 1024 * _SUBCARRIERS / symbol_time * (1 - _OVERHEAD[direction]) * share

    def peak_rate(self, direction: str) -> float:
        """Bits per second of the whole bandwidth part."""
        return self.resource_blocks * self.rate_per_block(direction)


@dataclass(frozen=True)
class Demand:
    """What designs ask of the network, each of the shape of tau, all robots together."""

    loops_per_s: np.ndarray
    uplink_kbit_s: np.ndarray
    downlink_kbit_s: np.ndarray
    uplink_blocks: np.ndarray  # resource blocks, a mean over time and so no whole number
    downlink_blocks: np.ndarray
    carrier_share: np.ndarray  # of the bandwidth part, the busier direction
    workers: np.ndarray  # of the edge that are busy, in the mean over time; NaN where that is not known


@dataclass(frozen=True)
class Traffic:
    """The messages of a loop, and the carrier that they go over.

    Attributes:
        uplink_bytes: Of one uplink message with all headers.
        downlink_bytes: Of one downlink message with all headers.
        carrier: The 5G carrier.
    """

    uplink_bytes: float = 3000.0
    downlink_bytes: float = 150.0
    carrier: Carrier = Carrier()

    def __post_init__(self) -> None:
        for name in ("uplink_bytes", "downlink_bytes"):
            _checks.bounded(name, getattr(self, name), above=0, shape=())

    def of(self, tau: ArrayLike, num_robots: int, workers: ArrayLike = np.nan) -> Demand:
        """Demand of one loop per robot and sampling period (model, section 4).

        Args:
            tau: Sampling periods (s).
            num_robots: N.
            workers: Workers of the edge that are busy in the mean, of all robots together; NaN where that is not known.
        """
        loops = _checks.count("num_robots", num_robots) / np.asarray(_checks.bounded("tau", tau, above=0), np.float64)
        up, down = 8 * self.uplink_bytes * loops, 8 * self.downlink_bytes * loops
        blocks_up = up / self.carrier.rate_per_block("uplink")
        blocks_down = down / self.carrier.rate_per_block("downlink")
        share = np.maximum(blocks_up, blocks_down) / self.carrier.resource_blocks
        busy = np.broadcast_to(np.asarray(workers, np.float64), loops.shape)
        return Demand(loops, up / 1e3, down / 1e3, blocks_up, blocks_down, share, busy)
