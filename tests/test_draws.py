"""One key, one seed: the same numbers whether 64 bits are on or not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hydra import compose, initialize_config_dir

from qocjax import Design, Scenario, evaluate
from qocjax.batch.drawing import draw_seeds
from qocjax.config import StudyConfig, conf_dir, load
from qocjax.network import Trace
from qocjax.network.contention import contended_times
from qocjax.network.interface import Network, SharedNetwork

TICKS, TAU, DEADLINE = 300, 0.02, 0.2
OPTIONS = {
    "paper": [],
    "kth_5g": ["network=kth_5g"],
    "gamma": ["network=loop", "delay@network.compute=gamma"],
    "lognormal": ["network=loop", "delay@network.compute=log_normal"],
    "burst losses": ["network=loop", "loss@network.uplink.loss=gilbert_elliott"],
    "independent losses": [
        "network=loop",
        "loss@network.uplink.loss=independent",
        "network.uplink.loss.probability=0.2",
    ],
    "edge": ["network.edge.discipline=latest", "network.edge.workers=1"],
    "dds": ["network=dds"],
    "cell": ["network=cell", "network.uplink.bler=0.3"],
}


def network_of(name: str) -> Network:
    if name == "trace":
        return Trace(np.random.default_rng(0).gamma(4.0, 0.03, 900).astype(np.float32), TAU)
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return load(StudyConfig, compose("sweep", OPTIONS[name])).build_network()


def in_width(wide: bool, make: Callable[[], Any]) -> Any:
    with jax.enable_x64(wide):
        return jax.tree.map(np.asarray, make())


def drawn_of(network: Network) -> tuple[Any, Any]:
    found = draw_seeds(jnp.zeros((2, 3)), (0.1, 0.1), network, [0, 1, 7], 5, TICKS, TAU)
    times = found.network
    if isinstance(network, SharedNetwork):
        times = contended_times(network, found.network, TICKS, TAU, [DEADLINE])[0]
    return found.start, times


QUICK = ("paper", "burst losses", "trace")  # a law, a process that goes on, whole numbers; others take long to compile


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in (*OPTIONS, "trace")]
)
def test_loop_times_of_a_seed_do_not_depend_on_the_width(name: str) -> None:
    network = network_of(name)
    (start, times), (narrow_start, narrow_times) = (in_width(wide, lambda: drawn_of(network)) for wide in (True, False))
    assert (times.dtype, narrow_times.dtype) == (np.float64, np.float32)
    np.testing.assert_allclose(start, narrow_start, rtol=1e-6)
    np.testing.assert_array_equal(np.isinf(times), np.isinf(narrow_times))
    kept = np.isfinite(times)
    assert kept.mean() > 0.02
    close = np.isclose(times[kept], narrow_times[kept], rtol=2e-5, atol=2e-6)
    assert close.mean() > (0.99 if name == "cell" else 1 - 1e-9)  # of a cell, rounding may lead to the next slot


def test_a_run_in_float64_checks_the_one_in_float32() -> None:
    scenario, network = Scenario(horizon=2.0), network_of("paper")
    designs = Design(tau=TAU, deadline=np.array([0.1, 0.2, 0.4]))
    exact = in_width(True, lambda: evaluate(scenario, designs, network, range(16), dtype=jnp.float64)["auc"].values)
    quick = in_width(False, lambda: evaluate(scenario, designs, network, range(16))["auc"].values)
    np.testing.assert_allclose(quick, exact, rtol=1e-4)  # before robots meet, rounding is not amplified
