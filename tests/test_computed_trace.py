"""A log of the network alone: what the edge computes is asked for, and comes between the two ways of a round trip."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from logs import LOGS

from qocjax import QocScale, Rules
from qocjax.advice.stress import worse
from qocjax.config import conf_dir, load
from qocjax.config.advise import AdviseConfig
from qocjax.config.study import StudyConfig
from qocjax.network import (
    ComputedTrace,
    Constant,
    Edge,
    EdgeNetwork,
    Load,
    Trace,
    TruncatedNormal,
    faster_than_measured,
    loop_times,
    with_edge,
)
from qocjax.network.stressed import Stressed, with_lost_twice, with_slow_compute
from qocjax.search.objective import Objective
from qocjax.statistics.units import trace_remark, units_of

ALONE = ["irtt", "ping", "fping", "sockperf", "performance_test", "DelayReplayer with times", "CICV5G", "loop times"]
WHOLE = ["EdgeDroid", "CLEAVE", "CARET"]
KEYS = jax.random.split(jax.random.key(4), 6)


def measured(rows: int = 3200, period: float | None = 0.1) -> Trace:
    rng = np.random.default_rng(2)
    delays = 0.02 + 0.01 * rng.exponential(size=rows)
    return Trace(np.where(rng.random(rows) < 0.05, np.inf, delays), "measured", period)


@pytest.fixture
def composer() -> Iterator[None]:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        yield


def config(*options: str, command: str = "advise") -> AdviseConfig | StudyConfig:
    return load(AdviseConfig if command == "advise" else StudyConfig, compose(command, ["network=trace", *options]))


def test_reliability_is_the_mean_over_the_rows() -> None:
    trace, law = measured(400), TruncatedNormal(0.03, 0.01)
    deadlines = np.array([0.0, 0.03, 0.05, 0.07, 1.0])
    wanted = [np.mean([float(law.cdf(at - row)) if np.isfinite(row) else 0.0 for row in trace.delays])
              for at in deadlines]  # fmt: skip
    np.testing.assert_allclose(ComputedTrace(trace, law).reliability(deadlines).share, wanted, atol=1e-4)


def test_a_loop_is_a_row_of_the_trace_and_a_computation() -> None:
    trace = measured()
    network = ComputedTrace(trace, Constant(0.04))
    alone = loop_times(trace, KEYS, 20, 2, 0.1)
    np.testing.assert_allclose(loop_times(network, KEYS, 20, 2, 0.1), alone + 0.04)
    np.testing.assert_allclose(loop_times(EdgeNetwork(network, Edge()), KEYS, 20, 2, 0.1), alone + 0.04, rtol=1e-6)
    random = np.asarray(loop_times(ComputedTrace(trace, TruncatedNormal(0.04, 0.01)), KEYS, 20, 2, 0.1) - alone)
    taken = random[np.isfinite(random)]
    assert taken.mean() == pytest.approx(0.04, abs=0.003) and np.unique(taken.round(9)).size == taken.size


def test_a_busy_worker_drops_what_it_would_drop_of_any_network() -> None:
    """Round trips of 20 ms every 100 ms, 150 ms of computing: every second sample meets a busy worker."""
    network = with_edge(ComputedTrace(Trace(np.full(50, 0.02), "calm", 0.1), Constant(0.15)), Edge(discipline="skip"))
    times = np.asarray(loop_times(network, KEYS[:2], 10, 2, 0.1))
    np.testing.assert_allclose(times[:, ::2], 0.17)
    assert np.isinf(times[:, 1::2]).all()


def test_it_stays_a_measured_trace() -> None:
    """Observations are stretches, a copy is of the same time, and it is not replayed faster than it was measured."""
    trace = measured()
    networks = [
        ComputedTrace(trace, Constant(0.04)),
        with_edge(ComputedTrace(trace, Constant(0.04)), Edge(discipline="skip")),
    ]
    for network in (*networks, with_slow_compute(networks[1], 1.5), Stressed(networks[0], hang=2)):
        np.testing.assert_array_equal(
            units_of(network, range(40), 0, 4.0, 0.1), units_of(trace, range(40), 0, 4.0, 0.1)
        )
        assert "measured with a loop every 100 ms" in str(faster_than_measured(network, 0.02))
        assert faster_than_measured(network, 0.1) is None
    copied = np.asarray(jax.vmap(lambda key: trace.draw_again(key, 5, 2, 0.1))(KEYS))
    np.testing.assert_allclose(jax.vmap(lambda key: networks[0].draw_again(key, 5, 2, 0.1))(KEYS), copied + 0.04)
    np.testing.assert_array_equal(jax.vmap(lambda key: networks[1].draw_again(key, 5, 2, 0.1)[0])(KEYS), copied)


@pytest.mark.slow
def test_losses_are_doubled_and_computing_made_slower() -> None:
    network = with_edge(ComputedTrace(measured(), TruncatedNormal(0.03, 0.005)), Edge(discipline="skip"))
    load = Load(300, 2, 0.1)
    lost = 1.0 - float(with_lost_twice(network).reliability(10.0, load).share)
    once = 1.0 - float(network.reliability(10.0, load).share)
    assert lost == pytest.approx(1.0 - (1.0 - once) ** 2, abs=0.015)
    slower = with_slow_compute(network, 2.0)
    assert slower is not None and slower.reliability(0.07, load).share < network.reliability(0.07, load).share - 0.1


def test_a_trace_too_short_at_the_deadline_less_the_computing_says_so() -> None:
    network = ComputedTrace(measured(), Constant(0.5))
    assert trace_remark(network, 0.8, 4.0, 0.1) is None  # 0.3 s are left: what does not arrive is lost, 5 % of 3200
    calm = ComputedTrace(Trace(0.02 + 0.001 * np.random.default_rng(0).random(3200), "calm", 0.1), Constant(0.5))
    assert "no missed loop at 300 ms" in str(trace_remark(calm, 0.8, 4.0, 0.1))
    assert "less the usual 500 ms of computing" in str(trace_remark(calm, 0.8, 4.0, 0.1))


@pytest.mark.filterwarnings("ignore:.*found 1 duplicates")
@pytest.mark.parametrize("command", ["advise", "sweep"])
@pytest.mark.parametrize("name", ALONE)
def test_what_the_edge_computes_is_asked_for(name: str, command: str, tmp_path: Path, composer: None) -> None:
    sample = LOGS[name]
    (tmp_path / sample.name).write_text(sample.text)
    options = [f"network.path={tmp_path / sample.name}", "network.unit=ms", "network.period=0.1"]
    with pytest.raises(
        ValueError, match=r"network.compute: got nothing, but .* holds the network alone.*network.compute=0.02"
    ):
        config(*options, command=command).build_network()
    plain = config(*options, "network.compute=0").build_network()
    assert isinstance(plain, Trace)
    found = config(*options, "network.compute=0.02", command=command).build_network()
    path = found if command == "sweep" else found.path  # a search has an edge of one worker a robot
    assert isinstance(path, ComputedTrace) and path.compute == Constant(0.02)
    np.testing.assert_array_equal(path.trace.delays, plain.delays)


@pytest.mark.filterwarnings("ignore:.*found")
@pytest.mark.parametrize("name", WHOLE)
def test_of_a_loop_nobody_is_asked(name: str, tmp_path: Path, composer: None) -> None:
    sample = LOGS[name]
    (tmp_path / sample.name).write_text(sample.text)
    options = [f"network.path={tmp_path / sample.name}"]
    assert isinstance(config(*options).build_network(), Trace)
    with pytest.warns(UserWarning, match="hold a computation; network.compute comes on top"):
        assert isinstance(config(*options, "network.compute=0.01").build_network(), EdgeNetwork)


def test_traces_of_ingest_and_named_columns_are_loops(tmp_path: Path, composer: None) -> None:
    (tmp_path / "loop.csv").write_text("sequence,source_stamp,loop_time\n0,0.0,0.1\n1,0.1,0.2\n2,0.2,0.1\n")
    assert isinstance(config(f"network.path={tmp_path / 'loop.csv'}").build_network(), Trace)
    (tmp_path / "rtt.csv").write_text("rtt\n100\n120\n")
    named = [f"network.path={tmp_path / 'rtt.csv'}", "network.column=rtt", "network.unit=ms", "network.period=0.1"]
    assert isinstance(config(*named).build_network(), Trace)
    law = ["delay@network.compute=truncated_normal", "network.compute.mean=0.02", "network.compute.std=0.005"]
    found = config(*named, *law, "network.edge.workers=2").build_network()
    assert isinstance(found, EdgeNetwork) and found.edge == Edge(workers=2, discipline="skip")
    assert found.path.compute == TruncatedNormal(0.02, 0.005, 0.0, float("inf"))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["network.compute=20ms"], "network.compute: got '20ms', expected a finite number of s >= 0, such as 0.02"),
        (["network.compute=-1"], "network.compute: got -1, expected a finite number"),
        (["network.compute=nan"], "network.compute: got nan, expected a finite number"),
        (["network.compute=true"], "network.compute: got True, expected a finite number"),
        (["network.edge.workers=2"], r"network.edge: got .*, expected network.compute with it"),
        (["network.compute=0", "network.edge.discipline=fifo"], "network.edge: got .*, expected network.compute"),
    ],
)  # fmt: skip
def test_nonsense_is_one_line(options: list[str], said: str, composer: None) -> None:
    with pytest.raises(ValueError, match=said):
        config("network.path=ping.txt", *options)


def test_advice_tries_slower_computing(composer: None) -> None:
    scenario = config("network.path=none.csv", "network.column=rtt").build_scenario()
    network = with_edge(ComputedTrace(measured(), Constant(0.04)), Edge(discipline="skip"))
    objective = Objective(scenario, network, QocScale(1.0, 2.0), Rules(), 0, simulations=0)
    assert set(worse(objective, 0.1)) == {
        "all loop times x 1.25", "all loop times x 1.5", "bursts twice as long", "computing x 1.5", "lost loops x 2",
    }  # fmt: skip
