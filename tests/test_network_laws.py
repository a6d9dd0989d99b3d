"""Delay laws: draws follow the CDF, CDF and quantile are inverse, bad parameters are refused."""

from __future__ import annotations

import math
from collections.abc import Callable

import jax
import numpy as np
import pytest
from scipy import stats

from qocjax.network import (
    Constant,
    DelayLaw,
    Empirical,
    QuantileTable,
    ShiftedGamma,
    ShiftedLogNormal,
    TruncatedNormal,
)

WITH_DENSITY: dict[str, DelayLaw] = {
    "paper": TruncatedNormal(0.20, 0.05),
    "half_normal": TruncatedNormal(0.0, 0.05),
    "two_sided": TruncatedNormal(0.02, 0.01, 0.01, 0.025),
    "upper_tail": TruncatedNormal(-0.05, 0.05, 0.05),
    "gamma": ShiftedGamma(0.004, 2.5, 0.003),
    "peaked_gamma": ShiftedGamma(0.0, 0.4, 0.01),
    "log_normal": ShiftedLogNormal(0.003, 0.002, 0.8),
    "table": QuantileTable([0.0, 0.2, 0.2, 0.9, 1.0], [0.01, 0.02, 0.03, 0.04, 0.4]),
}
SCIPY = {
    "paper": stats.truncnorm(-4.0, math.inf, 0.20, 0.05),
    "two_sided": stats.truncnorm(-1.0, 0.5, 0.02, 0.01),
    "gamma": stats.gamma(2.5, 0.004, 0.003),
    "log_normal": stats.lognorm(0.8, 0.003, 0.002),
}


@pytest.mark.parametrize("name", WITH_DENSITY)
def test_draws_follow_the_cdf(name: str) -> None:
    law = WITH_DENSITY[name]
    draws = np.asarray(law.sample(jax.random.key(11), (20_000,)))
    assert stats.kstest(draws, law.cdf).pvalue > 0.01


@pytest.mark.parametrize("name", WITH_DENSITY)
def test_float32_draws_follow_the_cdf(name: str) -> None:
    law = WITH_DENSITY[name]
    with jax.enable_x64(False):
        draws = law.sample(jax.random.key(12), (20_000,))
    assert draws.dtype == np.float32
    assert np.all(np.isfinite(draws)) and np.all(np.asarray(draws) >= 0.0)
    assert stats.kstest(np.asarray(draws, np.float64), law.cdf).pvalue > 0.01


@pytest.mark.parametrize("name", SCIPY)
def test_cdf_and_quantile_agree_with_scipy(name: str) -> None:
    level = np.array([[1e-4, 0.1, 0.5], [0.9, 0.99, 0.9999]])
    delay = SCIPY[name].ppf(level)
    np.testing.assert_allclose(WITH_DENSITY[name].cdf(delay), level, rtol=1e-9)
    np.testing.assert_allclose(WITH_DENSITY[name].quantile(level), delay, rtol=1e-9)


@pytest.mark.parametrize("name", WITH_DENSITY)
def test_quantile_inverts_the_cdf(name: str) -> None:
    law = WITH_DENSITY[name]
    level = np.linspace(0.001, 0.999, 500)
    np.testing.assert_allclose(law.cdf(law.quantile(level)), level, atol=1e-9)


@pytest.mark.parametrize("law", [*WITH_DENSITY.values(), Constant(0.1), Empirical([0.1, 0.2, math.inf])])
def test_law_is_a_law(law: DelayLaw) -> None:
    delay = np.linspace(-0.1, 2.0, 301).reshape(7, 43)
    level = law.cdf(delay)
    assert level.shape == delay.shape and level.dtype == np.float64
    assert np.all(np.diff(level.ravel()) >= 0.0) and np.all(level[delay < 0.0] == 0.0) and level.max() <= 1.0
    assert np.ndim(law.cdf(0.1)) == 0
    assert law.sample(jax.random.key(0), (3, 2)).shape == (3, 2)
    assert isinstance(law, DelayLaw) and hash(law) == hash(law)
    assert law.describe()["kind"] == type(law).__name__


def test_draws_respect_the_bounds() -> None:
    law = TruncatedNormal(0.02, 0.01, 0.019, 0.021)
    with jax.enable_x64(False):
        draws = np.asarray(law.sample(jax.random.key(3), (100_000,)))
    assert np.float32(0.019) <= draws.min() and draws.max() <= np.float32(0.021)


def test_empirical_is_its_samples() -> None:
    law = Empirical([0.3, 0.1, 0.1, math.inf, 0.2])
    np.testing.assert_array_equal(law.cdf([0.0999, 0.1, 0.25, 0.3, math.inf]), [0.0, 0.4, 0.6, 0.8, 0.8])
    np.testing.assert_array_equal(law.quantile([0.0, 0.4, 0.41, 0.8, 1.0]), [0.1, 0.1, 0.2, 0.3, math.inf])
    draws = np.asarray(law.sample(jax.random.key(5), (50_000,)))
    values, counts = np.unique(draws, return_counts=True)
    np.testing.assert_array_equal(values, [0.1, 0.2, 0.3, math.inf])
    assert stats.chisquare(counts, 50_000 * np.array([0.4, 0.2, 0.2, 0.2])).pvalue > 0.01


def test_quantile_table_with_atom_is_right_continuous() -> None:
    law = QuantileTable([0.0, 0.25, 0.75, 1.0], [0.1, 0.2, 0.2, 0.3])
    np.testing.assert_allclose(law.cdf([0.1, 0.15, 0.2 - 1e-12, 0.2, 0.25, 0.3]), [0, 0.125, 0.25, 0.75, 0.875, 1])
    draws = np.asarray(law.sample(jax.random.key(6), (50_000,)))
    assert stats.binomtest(int(np.sum(draws == 0.2)), draws.size, 0.5).pvalue > 0.01


def test_measured_laws_keep_a_copy() -> None:
    samples = np.array([0.1, 0.2])
    law = Empirical(samples)
    samples[0] = 5.0
    assert law.cdf(0.1) == 0.5
    with pytest.raises(ValueError, match="read-only"):
        np.asarray(law.samples)[0] = 1.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Constant(-0.1), r"Constant.value: got -0.1, expected >= 0"),
        (lambda: Constant(math.inf), r"Constant.value: got inf, expected finite"),
        (lambda: TruncatedNormal(0.2, 0.0), r"TruncatedNormal.std: got 0.0, expected > 0"),
        (lambda: TruncatedNormal(math.nan, 0.1), r"TruncatedNormal.mean: got nan"),
        (lambda: TruncatedNormal(0.2, 0.1, -1.0), r"TruncatedNormal.low: got -1.0, expected >= 0"),
        (lambda: TruncatedNormal(0.2, 0.1, 0.3, 0.3), r"TruncatedNormal.high: got 0.3, expected > 0.3"),
        (lambda: TruncatedNormal(0.2, 0.01, 0.3), r"holds 0 of a normal law"),
        (lambda: ShiftedGamma(0.0, -1.0, 0.1), r"ShiftedGamma.shape: got -1.0, expected > 0"),
        (lambda: ShiftedLogNormal(0.0, 0.1, 11.0), r"ShiftedLogNormal.sigma: got 11.0, expected <= 10"),
        (lambda: Empirical([]), r"Empirical.samples: got shape \(0,\)"),
        (lambda: Empirical([0.1, -0.2]), r"Empirical.samples\[1\]: got -0.2"),
        (lambda: Empirical([0.1, math.nan]), r"Empirical.samples\[1\]: got nan"),
        (lambda: Empirical([math.inf, math.inf]), r"got 2 lost messages and no delay"),
        (lambda: QuantileTable([0.0, 1.0], [0.1]), r"expected as many"),
        (lambda: QuantileTable([0.1, 1.0], [0.1, 0.2]), r"from 0 to 1"),
        (lambda: QuantileTable([0.0, math.nan, 1.0], [0.1, 0.2, 0.3]), r"from 0 to 1"),
        (lambda: QuantileTable([0.0, 1.0], [0.2, 0.1]), r"nondecreasing, finite delays"),
        (lambda: Empirical([0.1]).cdf(math.nan), r"delay: got NaN"),
    ],
)
def test_bad_parameters_are_named(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("value", ["0.1", True, None])
def test_wrong_type_is_named(value: object) -> None:
    with pytest.raises(TypeError, match="Constant.value: got"):
        Constant(value)  # type: ignore[arg-type]
