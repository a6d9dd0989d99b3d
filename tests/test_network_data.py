"""The readers and the table on measured data, where it is present."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import jax
import numpy as np
import pytest
from scipy import stats

from qocjax.network import QuantileTable, Trace, completes, kth_5g_network, loop_times, read_histogram, read_trace

ROOT = Path(__file__).resolve().parents[1]
HISTOGRAMS = {"uplink": "s1_wall.xml", "downlink": "s10-DL_wall.xml"}


@pytest.fixture(scope="module")
def wifi(shared_data: Path) -> Trace:
    """One of the loops of the Wi-Fi measurement."""
    folder = shared_data / "cleave-wifi-loop" / "MOSN_20m_wifi_plant6_sample_rate_20"
    return read_trace(next(folder.glob("udpclient.plant.3.*.csv")), "rtt", "s", sequence="seq")


def test_wifi_trace(wifi: Trace) -> None:
    delays = np.asarray(wifi.delays)
    assert delays.size == 23_842 and np.isinf(delays).sum() == 9
    np.testing.assert_allclose(delays[:3], [0.03665781021118164, 0.004773378372192383, 0.14162445068359375])
    assert wifi.reliability(2.0).share == pytest.approx(1 - 9 / 23_842, abs=1e-12)
    assert wifi.reliability(np.median(delays)).share == pytest.approx(0.5, abs=1e-3)


def test_replay_keeps_the_correlation_of_wifi(wifi: Trace) -> None:
    late = 1.0 - completes(np.asarray(wifi.delays), 0.006)
    measured = np.corrcoef(late[1:], late[:-1])[0, 1]
    times = loop_times(wifi, jax.random.split(jax.random.key(61), 2), late.size, 1, 0.05)
    replayed = 1.0 - np.asarray(completes(times, 0.006))[..., 0]
    assert measured > 0.15
    for seed in replayed:
        assert np.corrcoef(seed[1:], seed[:-1])[0, 1] == pytest.approx(measured, abs=0.01)


@pytest.mark.parametrize(
    ("name", "rows", "share"),
    [
        ("urban_n8_v20_run01", 6143, 0.0022790),
        ("urban_n78_v20_run02", 6277, 0.0036642),
        ("south_n8_v10_04", 1219, 0.4323216),  # some rows have an empty field in the middle
        ("w2s_n8_v30_run07", 1300, 0.0492308),
    ],
)
def test_5g_round_trips(shared_data: Path, name: str, rows: int, share: float) -> None:
    path = shared_data / "cicv-5g-rtt" / f"{name}.txt"
    trace = read_trace(path, "delay(ms)", "ms", sequence="pub_time(ms)")
    assert np.size(trace.delays) == rows and trace.name == name
    assert 1.0 - trace.reliability(0.1).share == pytest.approx(share, abs=1e-6)
    np.testing.assert_array_equal(read_trace(path, "delay", sequence="pub_time").delays, trace.delays)
    with pytest.raises(ValueError, match=r"has no column 'rtt'; its columns are 'pub_time\(ms\)'"):
        read_trace(path, "rtt", "ms")


def test_5g_rows_longer_than_the_header(shared_data: Path) -> None:
    path = shared_data / "cicv-5g-rtt" / "s2w_n8_v30_run02.txt"
    with pytest.warns(UserWarning, match="rows of 12 fields for 10 names"):
        trace = read_trace(path, "delay(ms)", "ms")
    np.testing.assert_array_equal(np.asarray(trace.delays)[:2], [0.034, 0.025])


@pytest.mark.parametrize("direction", HISTOGRAMS)
def test_table_is_the_histogram(shared_data: Path, direction: str) -> None:
    histogram = read_histogram(shared_data / "kth-5g-owd-histograms" / HISTOGRAMS[direction])
    table = getattr(kth_5g_network(), direction).delay
    at = np.asarray(histogram.delay)
    np.testing.assert_allclose(table.cdf(at), histogram.cdf(at), atol=2.5e-3)
    tail = np.array([0.999, 0.9999, 0.99999])
    np.testing.assert_allclose(table.quantile(tail), histogram.quantile(tail), rtol=0.02)
    draws = np.asarray(table.sample(jax.random.key(62), (5_000,)))
    assert stats.kstest(draws, histogram.cdf).pvalue > 0.01


def test_table_is_what_its_script_makes(shared_data: Path) -> None:
    spec = importlib.util.spec_from_file_location("make_kth_5g", ROOT / "experiments" / "tables" / "make_kth_5g.py")
    assert spec is not None and spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    laws: dict[str, QuantileTable] = {
        direction: script.reduced(read_histogram(shared_data / "kth-5g-owd-histograms" / name))
        for direction, name in HISTOGRAMS.items()
    }
    kept = (ROOT / "qocjax" / "network" / "tables" / "kth_5g.csv").read_text(encoding="utf-8")
    assert script.table_text(**laws) == kept
