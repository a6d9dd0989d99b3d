"""Differences looked at together: none that is marked may owe its mark to having been looked for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from qocjax.statistics.estimates import standard_error
from qocjax.statistics.together import told_apart

SEEDS = 24


def signs(values: np.ndarray) -> np.ndarray:
    """Of differences [K, S]."""
    return told_apart(values.mean(axis=-1), standard_error(values), values.shape[-1])


@pytest.mark.parametrize("common", [0.0, 0.9])
def test_where_nothing_differs_few_tables_have_a_mark(common: float) -> None:
    """Of 40 differences, independent or of common seeds: 95 % intervals, each alone, mark most tables."""
    rng, count = np.random.default_rng(3), 1500
    shared = rng.normal(size=(count, 1, SEEDS))
    tables = np.sqrt(common) * shared + np.sqrt(1 - common) * rng.normal(size=(count, 40, SEEDS))
    marked = sum(signs(table).any() for table in tables)
    assert marked <= stats.binom.ppf(0.999, count, 0.05)
    alone = np.abs(tables.mean(axis=-1)) > stats.t.ppf(0.975, SEEDS - 1) * standard_error(tables)
    assert alone.any(axis=1).mean() > (0.8 if common == 0 else 0.15)


def test_signs_are_those_of_holm() -> None:
    rng = np.random.default_rng(5)
    values = rng.normal(np.linspace(-1.2, 1.2, 15)[:, None], 1.0, (15, SEEDS))
    p = stats.ttest_1samp(values, 0.0, axis=1).pvalue
    expected, left = np.zeros(15), 15
    for k in np.argsort(p):
        if p[k] > 0.05 / left:
            break
        expected[k], left = np.sign(values[k].mean()), left - 1
    np.testing.assert_array_equal(signs(values), expected)
    assert 0 < np.count_nonzero(expected) < 15


def test_exact_differences_and_none() -> None:
    assert told_apart([0.1, 0.0, -0.2], [0.0, 0.0, 0.0], 4).tolist() == [1, 0, -1]
    assert told_apart([0.1], [np.inf], 4).tolist() == [0] and told_apart([], [], 4).size == 0
