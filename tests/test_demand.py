"""Network demand: the 3GPP formula against published rates, tables against each other, and linearity."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

from qocjax.network.demand import BANDWIDTH_PARTS, MCS_TABLE_1, Carrier, Traffic


def test_peak_rate_is_that_of_ts_38_306() -> None:
    """100 MHz, 30 kHz, 4 layers: 2337 Mbit/s with 256QAM and rate 948/1024, so 6/8 of it with 64QAM."""
    carrier = Carrier(bandwidth_mhz=100, numerology=1, mcs_downlink=28, layers_downlink=4)
    assert carrier.resource_blocks == 273
    np.testing.assert_allclose(carrier.peak_rate("downlink") / 1e6, 2337.0 * 6 / 8, rtol=2e-4)
    narrow = Carrier(bandwidth_mhz=20, numerology=0, mcs_uplink=28)  # 1e-6 · 6 · 948/1024 · 106 · 12 · 14000 · 0.92
    np.testing.assert_allclose(narrow.peak_rate("uplink") / 1e6, 91.0046, rtol=1e-5)


def test_mcs_table_has_the_spectral_efficiencies_of_ts_38_214() -> None:
    printed = [
        0.2344, 0.3066, 0.3770, 0.4902, 0.6016, 0.7402, 0.8770, 1.0273, 1.1758, 1.3262, 1.3281, 1.4766, 1.6953, 1.9141,
        2.1602, 2.4063, 2.5703, 2.5664, 2.7305, 3.0293, 3.3223, 3.6094, 3.9023, 4.2129, 4.5234, 4.8164, 5.1152, 5.3320,
        5.5547,
    ]  # fmt: skip
    np.testing.assert_allclose([bits * rate / 1024 for bits, rate in MCS_TABLE_1], printed, atol=6e-5)


def test_bandwidth_parts_leave_a_guard_band() -> None:
    for numerology, parts in BANDWIDTH_PARTS.items():
        blocks = np.array(list(parts.values()))
        used = blocks * 12 * 15e3 * 2**numerology / (1e6 * np.array(list(parts)))
        assert (np.diff(blocks) > 0).all() and (used > 0.78).all() and (used < 1).all()


def test_demand_is_messages_times_size() -> None:
    traffic = Traffic(uplink_bytes=1000, downlink_bytes=100)
    demand = traffic.of(np.array([0.01, 0.1]), 2)
    np.testing.assert_allclose(demand.loops_per_s, [200, 20])
    np.testing.assert_allclose(demand.uplink_kbit_s, [1600, 160])
    np.testing.assert_allclose(demand.downlink_kbit_s, [160, 16])
    carrier = traffic.carrier
    np.testing.assert_allclose(demand.uplink_blocks * carrier.rate_per_block("uplink") / 1e3, demand.uplink_kbit_s)
    np.testing.assert_allclose(demand.carrier_share, demand.uplink_blocks / carrier.resource_blocks)
    for name, values in asdict(traffic.of(np.array([0.01, 0.1]), 6)).items():
        np.testing.assert_allclose(values, 3 * getattr(demand, name))


def test_blocks_fall_with_mcs_layers_and_share_of_time() -> None:
    def blocks(**changes: float) -> float:
        return float(Traffic(carrier=replace(Carrier(), **changes)).of(0.01, 2).uplink_blocks)  # type: ignore[arg-type]

    assert blocks(mcs_uplink=20) < blocks(mcs_uplink=5)
    np.testing.assert_allclose(blocks(layers_uplink=2), blocks() / 2)
    np.testing.assert_allclose(blocks(uplink_share=0.25), 4 * blocks())
    np.testing.assert_allclose(blocks(numerology=0), 2 * blocks())  # half the width of a block


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("numerology", lambda: Carrier(numerology=3)),
        ("bandwidth_mhz", lambda: Carrier(bandwidth_mhz=7)),
        ("bandwidth_mhz", lambda: Carrier(bandwidth_mhz=5, numerology=2)),
        ("mcs_uplink", lambda: Carrier(mcs_uplink=29)),
        ("mcs_downlink", lambda: Carrier(mcs_downlink=-1)),
        ("layers_uplink", lambda: Carrier(layers_uplink=9)),
        ("downlink_share", lambda: Carrier(downlink_share=0.0)),
        ("uplink_bytes", lambda: Traffic(uplink_bytes=0)),
        ("tau", lambda: Traffic().of(0.0, 2)),
        ("num_robots", lambda: Traffic().of(0.01, 0)),
        ("direction", lambda: Carrier().rate_per_block("sideways")),
    ],
)
def test_bad_values_are_refused_by_name(name: str, make: object) -> None:
    with pytest.raises(ValueError, match=name):
        make()  # type: ignore[operator]
