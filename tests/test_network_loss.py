"""Loss processes: stationary probability, burst lengths and correlation against the Markov chain's own formulas."""

from __future__ import annotations

from collections.abc import Callable

import jax
import numpy as np
import pytest
from scipy import stats

from qocjax.network import GilbertElliott, IndependentLoss, LossProcess

TICKS, ROBOTS = 2_000, 3


def _draws(loss: LossProcess, seeds: int = 40, ticks: int = TICKS) -> np.ndarray:
    keys = jax.random.split(jax.random.key(21), seeds)
    return np.asarray(jax.jit(jax.vmap(lambda key: loss.sample(key, ticks, ROBOTS)))(keys))


@pytest.mark.parametrize("probability", [0.0, 0.03, 1.0])
def test_independent_loss_has_its_probability(probability: float) -> None:
    lost = _draws(IndependentLoss(probability))
    assert lost.shape == (40, TICKS, ROBOTS) and lost.dtype == bool
    assert stats.binomtest(int(lost.sum()), lost.size, probability).pvalue > 0.01


CHANNELS = [
    GilbertElliott(0.01, 0.1),
    GilbertElliott(0.02, 0.05, 0.01, 0.6),
    GilbertElliott(0.7, 0.9, 0.1, 0.5),
    GilbertElliott(1.0, 1.0, 0.0, 1.0),
]


@pytest.mark.parametrize("channel", CHANNELS)
def test_channel_is_stationary_from_the_first_message(channel: GilbertElliott) -> None:
    lost = _draws(channel, seeds=4_000, ticks=3)
    for tick in range(3):
        assert stats.binomtest(int(lost[:, tick].sum()), lost[:, tick].size, channel.probability).pvalue > 0.005


@pytest.mark.parametrize("channel", CHANNELS)
def test_channel_has_the_autocorrelation_of_its_chain(channel: GilbertElliott) -> None:
    lost = _draws(channel).astype(float) - channel.probability
    bad, decay = channel.bad_share, 1.0 - channel.p_good_to_bad - channel.p_bad_to_good
    for lag in (1, 2, 5):
        expected = bad * (1.0 - bad) * (channel.loss_bad - channel.loss_good) ** 2 * decay**lag
        per_run = np.mean(lost[:, lag:] * lost[:, :-lag], axis=1).ravel()
        assert np.mean(per_run) == pytest.approx(expected, abs=4.0 * stats.sem(per_run) + 1e-3)


def test_bursts_have_geometric_length() -> None:
    lost = _draws(GilbertElliott(0.02, 0.25))
    edges = np.diff(lost.astype(int), axis=1, prepend=0, append=0)
    starts = np.argwhere(np.moveaxis(edges, 1, 2) == 1)
    ends = np.argwhere(np.moveaxis(edges, 1, 2) == -1)
    length = (ends - starts)[(starts[:, 2] > 0) & (ends[:, 2] < TICKS), 2]
    counts = np.bincount(np.minimum(length, 15))[1:]
    expected = np.append(stats.geom(0.25).pmf(np.arange(1, 15)), stats.geom(0.25).sf(14))
    assert stats.chisquare(counts, length.size * expected).pvalue > 0.01


def test_channel_of_equal_states_is_independent_loss() -> None:
    channel = GilbertElliott(0.1, 0.2, 0.05, 0.05)
    assert channel.probability == pytest.approx(0.05)
    lost = _draws(channel)
    pairs = int((lost[:, 1:] & lost[:, :-1]).sum())
    assert pairs / lost[:, 1:].size == pytest.approx(0.05**2, rel=0.05)


def test_robots_lose_independently() -> None:
    lost = _draws(GilbertElliott(0.05, 0.2), seeds=200, ticks=2_000).mean(axis=1)
    corr = np.corrcoef(lost[:, 0], lost[:, 1])[0, 1]
    assert abs(corr) < 4.0 / np.sqrt(200)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: IndependentLoss(1.5), r"IndependentLoss.probability: got 1.5, expected <= 1"),
        (lambda: GilbertElliott(-0.1, 0.1), r"GilbertElliott.p_good_to_bad: got -0.1, expected >= 0"),
        (lambda: GilbertElliott(0.1, 0.1, 0.0, 2.0), r"GilbertElliott.loss_bad: got 2.0, expected <= 1"),
        (lambda: GilbertElliott(0.0, 0.0), r"expected at least one above 0"),
    ],
)
def test_bad_parameters_are_named(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
