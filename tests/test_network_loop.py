"""Networks of legs: F(deadline) against closed forms and Monte Carlo, draws, completion, presets."""

from __future__ import annotations

import itertools
import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import special, stats

from qocjax.network import (
    Constant,
    DelayLaw,
    Empirical,
    GilbertElliott,
    IndependentLoss,
    Leg,
    LoopNetwork,
    Network,
    QuantileTable,
    ShiftedGamma,
    ShiftedLogNormal,
    TruncatedNormal,
    completes,
    kth_5g_network,
    loop_times,
    paper_network,
)
from qocjax.network.convolution import add

DEADLINES = np.linspace(0.0, 0.8, 161)
BURSTY = LoopNetwork(
    uplink=Leg(ShiftedGamma(0.005, 2.0, 0.004), GilbertElliott(0.02, 0.2)),
    compute=TruncatedNormal(0.05, 0.02),
    downlink=Leg(ShiftedLogNormal(0.002, 0.004, 1.0), IndependentLoss(0.05)),
    name="bursty",
)
NETWORKS = [
    paper_network(),
    kth_5g_network(0.02, 0.01, 0.02, 0.01),
    BURSTY,
    LoopNetwork(uplink=Leg(Constant(0.01)), compute=Empirical([0.02, 0.03, math.inf]), name="few"),
]


def _loop(up: DelayLaw, compute: DelayLaw, down: DelayLaw, loss: float = 0.0) -> LoopNetwork:
    return LoopNetwork(uplink=Leg(up, IndependentLoss(loss)), compute=compute, downlink=Leg(down), name="loop")


def test_paper_reliability_is_the_truncated_normal() -> None:
    expected = stats.truncnorm(-4.0, math.inf, 0.20, 0.05).cdf(DEADLINES * (1 + 1e-6))
    np.testing.assert_allclose(paper_network().reliability(DEADLINES).share, expected, atol=1e-12)


def test_constant_legs_shift_exactly_and_losses_multiply() -> None:
    law = TruncatedNormal(0.20, 0.05)
    network = LoopNetwork(
        uplink=Leg(Constant(0.03), GilbertElliott(0.1, 0.3, 0.0, 0.8)),
        compute=law,
        downlink=Leg(Constant(0.02), IndependentLoss(0.1)),
        name="shifted",
    )
    expected = (1 - 0.25 * 0.8) * 0.9 * law.cdf(DEADLINES * (1 + 1e-6) - 0.05)
    np.testing.assert_allclose(network.reliability(DEADLINES).share, expected, atol=1e-12)


def test_constant_loop_is_a_step_that_includes_its_deadline() -> None:
    network = _loop(Constant(0.1), Constant(0.2), Constant(0.0), loss=0.25)
    np.testing.assert_array_equal(network.reliability([0.2999, 0.3, 0.4]).share, [0.0, 0.75, 0.75])


@pytest.mark.parametrize("shapes", [(2.0, 3.0, 4.0), (0.5, 20.0, 0.3), (1.0, 1.0, 60.0)])
def test_sum_of_gammas_is_a_gamma(shapes: tuple[float, float, float]) -> None:
    laws = [ShiftedGamma(0.01, shape, 0.01) for shape in shapes]
    for some in (laws[:2], laws):
        total = sum(law.shape for law in some)
        expected = special.gammainc(total, np.maximum(DEADLINES - 0.01 * len(some), 0.0) / 0.01)
        np.testing.assert_allclose(add(some).cdf(DEADLINES), expected, atol=3e-5)


@pytest.mark.parametrize("means", [(0.001, 0.1), (0.0001, 0.3), (0.05, 0.06)])
def test_sum_of_exponentials_of_any_scales(means: tuple[float, float]) -> None:
    laws = [ShiftedGamma(0.0, 1.0, mean) for mean in means]
    (a, b), t = means, DEADLINES
    expected = 1.0 - (b * np.exp(-t / b) - a * np.exp(-t / a)) / (b - a)
    some: list[DelayLaw] = [*laws, Constant(0.0)]
    for order in itertools.permutations(some):
        np.testing.assert_allclose(add(order).cdf(t), expected, atol=1e-5)


def test_one_law_may_serve_several_legs() -> None:
    law = ShiftedGamma(0.0, 2.0, 0.01)
    np.testing.assert_allclose(add([law, law, law]).cdf(DEADLINES), special.gammainc(6.0, DEADLINES / 0.01), atol=3e-5)


def test_sum_of_samples_is_exact() -> None:
    rng = np.random.default_rng(31)
    parts = [rng.integers(1, high, 200) / 1000.0 for high in (9, 40, 7)]
    parts[1][:20] = math.inf
    every = np.add.outer(np.add.outer(parts[0], parts[1]).ravel(), parts[2]).ravel()
    at = np.arange(60) / 1000.0
    network = _loop(Empirical(parts[0]), Empirical(parts[1]), Empirical(parts[2]))
    expected = [np.mean(completes(every, deadline)) for deadline in at]
    np.testing.assert_allclose(network.reliability(at).share, expected, atol=1e-12)


def test_atom_plus_density_keeps_the_steep_step() -> None:
    atoms, narrow = QuantileTable([0.0, 0.3, 0.8, 1.0], [0.1, 0.2, 0.2, 0.5]), ShiftedGamma(0.0, 2.0, 0.001)
    at = np.linspace(0.199, 0.22, 200)
    below, above = np.linspace(0.1, 0.2, 20_001), np.linspace(0.2, 0.5, 60_001)
    expected = [
        0.3 * narrow.cdf(t - below).mean() + 0.5 * narrow.cdf(t - 0.2) + 0.2 * narrow.cdf(t - above).mean() for t in at
    ]
    np.testing.assert_allclose(add([atoms, narrow]).cdf(at), expected, atol=1e-4)


@pytest.mark.parametrize("network", NETWORKS, ids=lambda network: network.name)
def test_draws_follow_the_reliability(network: LoopNetwork) -> None:
    times = np.asarray(loop_times(network, jax.random.split(jax.random.key(41), 60), 1_000, 2, 0.01))
    at = np.quantile(times[np.isfinite(times)], [0.02, 0.2, 0.5, 0.8, 0.98])
    share = np.stack([completes(times, deadline).mean(axis=1).ravel() for deadline in at])
    spread = stats.sem(share, axis=1) + 1e-9
    assert np.all(np.abs(share.mean(axis=1) - network.reliability(at).share) < 4.0 * spread + 1e-4)
    lost = 1.0 - float(network.reliability(np.inf).share)
    assert np.isinf(times).mean() == pytest.approx(
        lost, abs=4.0 * stats.sem(np.isinf(times).mean(axis=1).ravel()) + 1e-9
    )


@pytest.mark.parametrize(
    "network", [paper_network(), pytest.param(BURSTY, marks=pytest.mark.slow)], ids=lambda network: network.name
)
def test_a_seed_does_not_depend_on_the_others(network: LoopNetwork) -> None:
    keys = jax.random.split(jax.random.key(42), 5)
    together = loop_times(network, keys, 50, 3, 0.01)
    assert together.shape == (5, 50, 3) and together.dtype == jnp.result_type(float)
    alone = jax.jit(network.draw, static_argnums=(1, 2, 3))(keys[3], 50, 3, 0.01)
    np.testing.assert_array_equal(alone, together[3])
    assert len(np.unique(np.asarray(together)[:, :, 0], axis=0)) == 5  # seeds differ


def test_legs_and_robots_are_independent() -> None:
    law = ShiftedGamma(0.0, 1.0, 0.01)
    times = np.asarray(loop_times(_loop(law, law, law), jax.random.split(jax.random.key(43), 10), 2_000, 2, 0.01))
    assert times.var() == pytest.approx(3 * 0.01**2, rel=0.05)  # of dependent legs it would be 5 or 9 times 1e-4
    assert abs(np.corrcoef(times[..., 0].ravel(), times[..., 1].ravel())[0, 1]) < 4.0 / np.sqrt(20_000)
    assert abs(np.corrcoef(times[:, 1:].ravel(), times[:, :-1].ravel())[0, 1]) < 4.0 / np.sqrt(40_000)


@pytest.mark.parametrize("network", NETWORKS, ids=lambda network: network.name)
def test_networks_keep_the_interface(network: LoopNetwork) -> None:
    assert isinstance(network, Network) and isinstance(hash(network), int)
    grid = network.reliability(DEADLINES.reshape(7, 23)).share
    assert grid.shape == (7, 23) and grid.dtype == np.float64
    assert np.all(np.diff(grid.ravel()) >= -1e-12) and grid.min() >= 0.0 and grid.max() <= 1.0
    assert np.ndim(network.reliability(0.2).share) == 0
    description = json.loads(json.dumps(network.describe(), allow_nan=False))
    assert description["name"] == network.name


def test_networks_of_equal_parameters_are_one() -> None:
    assert paper_network() == paper_network() and hash(paper_network()) == hash(paper_network())
    assert kth_5g_network() == kth_5g_network() != kth_5g_network(uplink_loss=0.1)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_loop_measured_at_its_deadline_completes(dtype: type) -> None:
    milliseconds = np.arange(1, 2_000)
    measured: np.ndarray = (milliseconds / 1000.0).astype(dtype)
    deadline = jnp.asarray(milliseconds, dtype) * jnp.asarray(0.001, dtype)
    assert bool(jnp.all(completes(jnp.asarray(measured), deadline)))
    assert not bool(jnp.any(completes(jnp.asarray(measured), deadline * (1 - 1e-5))))
    assert not completes(np.inf, 1e9) and completes(0.0, 0.0)


def test_kth_5g_medians_add_up() -> None:
    network = kth_5g_network()
    up, down = network.uplink.delay, network.downlink.delay
    assert up.quantile(0.5) == pytest.approx(5.6e-3, abs=2e-5) and down.quantile(0.5) == pytest.approx(
        5.58e-3, abs=3e-5
    )
    assert network.reliability(0.2).share < paper_network().reliability(0.19).share
    assert network.reliability(0.23).share > paper_network().reliability(0.2).share
    assert kth_5g_network(uplink_loss=0.1).reliability(0.5).share == pytest.approx(0.9, abs=1e-6)


def test_bad_arguments_are_named() -> None:
    keys = jax.random.split(jax.random.key(0), 2)
    with pytest.raises(TypeError, match="keys: got .*expected typed keys"):
        loop_times(paper_network(), jnp.zeros((2, 2), jnp.uint32), 10, 2, 0.01)
    with pytest.raises(ValueError, match=r"keys: got shape \(\)"):
        loop_times(paper_network(), keys[0], 10, 2, 0.01)
    with pytest.raises(ValueError, match="num_ticks: got 0"):
        loop_times(paper_network(), keys, 0, 2, 0.01)
    with pytest.raises(TypeError, match="num_robots: got 2.0"):
        loop_times(paper_network(), keys, 10, 2.0, 0.01)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="tau: got 0"):
        loop_times(paper_network(), keys, 10, 2, 0.0)
    with pytest.raises(ValueError, match="deadline: got NaN"):
        paper_network().reliability([0.1, math.nan])
    with pytest.raises(TypeError, match="LoopNetwork.uplink: got Constant"):
        LoopNetwork(uplink=Constant(0.1), compute=Constant(0.1), name="x")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="LoopNetwork.compute: got Leg"):
        LoopNetwork(compute=Leg(), name="x")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="Leg.loss: got 0.1"):
        Leg(Constant(0.1), 0.1)  # type: ignore[arg-type]


@pytest.mark.parametrize("network", [paper_network(), kth_5g_network(), BURSTY], ids=lambda network: network.name)
def test_a_longer_draw_begins_with_the_shorter_at_any_period(network: LoopNetwork) -> None:
    """What `prefix_stable` promises, and batches of many sampling periods rely on."""
    key = jax.random.key(5)
    longer = np.asarray(network.draw(key, 512, 3, 0.01))
    np.testing.assert_array_equal(network.draw(key, 301, 3, 0.2), longer[:301])
