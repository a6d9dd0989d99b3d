"""Traces: order, offsets, wrapping, time base and reliability."""

from __future__ import annotations

import json
import math
import warnings

import jax
import numpy as np
import pytest

from qocjax import Design, Scenario, evaluate
from qocjax.network import Network, Trace, completes, faster_than_measured, loop_times, paper_network

KEYS = jax.random.split(jax.random.key(51), 200)


def _ramp(rows: int, **more: object) -> Trace:
    """A trace whose delays tell the row."""
    return Trace(np.arange(rows) / 1000.0, "ramp", **more)  # type: ignore[arg-type]


def _rows(times: jax.Array) -> np.ndarray:
    return np.rint(np.asarray(times) * 1000.0).astype(int)


def test_rows_follow_in_order_from_an_offset_per_robot() -> None:
    rows = _rows(loop_times(_ramp(1_000), KEYS, 300, 3, 0.01))
    assert np.all(np.diff(rows, axis=1) % 1_000 == 1)
    starts = rows[:, 0]
    assert np.all(np.sort(starts, axis=1)[:, 1:] > np.sort(starts, axis=1)[:, :-1])  # distinct between robots
    assert len(np.unique(starts[:, 0])) > 150  # of 200 seeds
    for robot in range(3):  # every row is as likely a start as any other
        assert np.histogram(starts[:, robot], 4, (0, 1_000))[0].min() > 25


@pytest.mark.parametrize("rows", [1, 2, 3, 5])
def test_offsets_are_distinct_where_possible(rows: int) -> None:
    with pytest.warns(UserWarning, match="comes round again"):
        starts = _rows(loop_times(_ramp(rows), KEYS[:50], 8, 3, 0.01))[:, 0]
    assert all(len(set(each)) == min(rows, 3) for each in starts.tolist())


def test_a_longer_run_wraps_and_says_so_once() -> None:
    trace = _ramp(100)
    with pytest.warns(UserWarning, match=r"trace 'ramp' has 100 rows and a run takes 250") as caught:
        rows = _rows(loop_times(trace, KEYS[:4], 250, 2, 0.01))
    assert len(caught) == 1
    np.testing.assert_array_equal(rows[:, 100:200], rows[:, :100])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        loop_times(trace, KEYS[:4], 251, 2, 0.01)  # another compilation
        loop_times(_ramp(100), KEYS[:4], 100, 2, 0.01)  # just long enough


@pytest.mark.parametrize(("period", "tau"), [(0.05, 0.01), (0.01, 0.05), (0.02, 0.03), (0.01, 0.01)])
def test_a_period_keeps_the_length_of_bursts(period: float, tau: float) -> None:
    rows = _rows(loop_times(_ramp(1_000, period=period), KEYS[:5], 100, 2, tau))
    passed = (rows - rows[:, :1]) % 1_000
    expected = np.floor(np.arange(100) * tau / period + 1e-6)
    np.testing.assert_array_equal(passed, np.broadcast_to(expected[None, :, None], passed.shape))


def test_a_seed_does_not_depend_on_the_others() -> None:
    trace = _ramp(1_000)
    together = loop_times(trace, KEYS[:5], 50, 2, 0.01)
    np.testing.assert_array_equal(loop_times(trace, KEYS[2:3], 50, 2, 0.01)[0], together[2])
    np.testing.assert_array_equal(trace.draw(KEYS[2], 50, 2, 0.01), together[2])


def test_reliability_is_the_share_of_the_rows() -> None:
    trace = Trace([0.1, 0.3, math.inf, 0.1], "few")
    np.testing.assert_array_equal(trace.reliability([[0.09, 0.1], [0.3, math.inf]]).share, [[0.0, 0.5], [0.75, 0.75]])
    times = np.asarray(loop_times(_ramp(500), KEYS[:10], 500, 2, 0.01))  # each robot sees each row once
    for deadline in (0.0, 0.1, 0.25):
        assert completes(times, deadline).mean() == pytest.approx(
            float(_ramp(500).reliability(deadline).share), abs=1e-12
        )


def test_lost_loops_stay_lost() -> None:
    times = np.asarray(loop_times(Trace([0.1, math.inf], "half"), KEYS[:3], 2, 1, 0.01))
    assert np.all(np.isinf(times).sum(axis=1) == 1)


def test_a_trace_is_a_network() -> None:
    trace = Trace([0.1, 0.2, math.inf, math.inf], "few", period=0.05, source="somewhere.csv")
    assert isinstance(trace, Network) and isinstance(hash(trace), int)
    description = json.loads(json.dumps(trace.describe(), allow_nan=False))
    assert description["kind"] == "Trace" and description["source"] == "somewhere.csv"
    assert description["samples"] == 4 and description["lost_share"] == 0.5 and description["period"] == 0.05


@pytest.mark.parametrize(
    ("delays", "period", "message"),
    [
        ([], None, r"Trace.delays: got shape \(0,\)"),
        ([[0.1]], None, r"Trace.delays: got shape \(1, 1\)"),
        ([0.1, -0.1], None, r"Trace.delays\[1\]: got -0.1"),
        ([0.1, math.nan], None, r"Trace.delays\[1\]: got nan"),
        ([math.inf], None, r"got 1 lost messages and no delay"),
        ([0.1], 0.0, r"Trace.period: got 0.0, expected > 0"),
    ],
)
def test_bad_parameters_are_named(delays: list[float], period: float | None, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Trace(delays, "bad", period)


def test_a_replay_faster_than_the_measurement_is_told() -> None:
    trace = Trace([0.1, 0.2], "hall", period=0.055, period_from="column 'sent(ms)'")
    said = faster_than_measured(trace, 0.01)
    assert said is not None and "\n" not in said
    assert (
        "trace 'hall' was measured with a loop every 55 ms (column 'sent(ms)') and is replayed with one every 10 ms"
        in said
    )
    assert (
        "set the sampling period (loop.tau, search.tau) to 0.055 s or more" in said
        and "network.faster_than_measured=true" in said
    )
    assert faster_than_measured(trace, 0.055) is None and faster_than_measured(trace, 0.1) is None
    assert faster_than_measured(Trace([0.1], "one"), 0.01) is None
    assert faster_than_measured(paper_network(), 1e-4) is None


def test_a_trace_with_a_source_is_simulated_as_it_is() -> None:
    trace = Trace(np.full(400, 0.15), "named", source="somewhere")
    scenario = Scenario(start=[[-0.6, -0.5, 0.3], [-0.6, 0.5, 0.0]], goal=[1.0, 0.0], horizon=2.0)
    runs = evaluate(scenario, Design(tau=0.1, deadline=[0.1, 0.2]), trace, range(2))
    np.testing.assert_array_equal(runs["completed_share"].values.mean(axis=1), [0.0, 1.0])
