"""QoC of a design with two intervals: given its scale, and with what is not known of the scale (model, section 5)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import special

from qocjax.quality import QocScale, qoc
from qocjax.study.statistics import Estimate, estimate, paired

__all__ = ["Scored", "difference", "score", "seed_scores", "with_scale"]

_STEP = 1e-4  # of J_med, for the slope


class Scored(NamedTuple):
    """A mean over seeds."""

    given: Estimate  # the scale taken as it is
    whole: Estimate  # with the error of J_med in it

    def columns(self, name: str) -> dict[str, float]:
        """Columns of a table: the mean, and both intervals."""
        return {
            name: self.given.mean, f"{name}_se": self.given.se, f"{name}_low": self.given.low,
            f"{name}_high": self.given.high, f"{name}_whole_se": self.whole.se, f"{name}_whole_low": self.whole.low,
            f"{name}_whole_high": self.whole.high,
        }  # fmt: skip


def seed_scores(auc: np.ndarray, scale: QocScale) -> np.ndarray:
    """QoC by seed [..., S] of AUC [..., S, N]; an infinite AUC counts as the largest."""
    return np.asarray(qoc(np.asarray(auc, np.float64), scale)).mean(axis=-1)


def score(auc: np.ndarray, scale: QocScale) -> Scored:
    """Mean QoC of runs [S, N]."""
    given = estimate(seed_scores(auc, scale))
    return Scored(given, with_scale(given, lambda other: float(seed_scores(auc, other).mean()), scale, auc.shape[0]))


def difference(auc: np.ndarray, others: np.ndarray, scale: QocScale) -> Scored:
    """Mean difference of QoC of runs [S, N] to others on the same seeds."""
    given = paired(seed_scores(auc, scale), seed_scores(others, scale))

    def gap(other: QocScale) -> float:
        return float((seed_scores(auc, other) - seed_scores(others, other)).mean())

    return Scored(given, with_scale(given, gap, scale, auc.shape[0]))


def with_scale(given: Estimate, statistic: Callable[[QocScale], float], scale: QocScale, seeds: int) -> Estimate:
    """An estimate with the error of J_med in it: that of independent seeds, times the slope of the estimate in J_med.

    Args:
        given: The estimate with the scale as it is.
        statistic: The estimate on another scale.
        scale: The scale.
        seeds: S behind the estimate.
    """
    if not scale.median_se > 0.0:
        return given
    ends = [statistic(QocScale(scale.median * (1.0 + side * _STEP), scale.largest)) for side in (-1.0, 1.0)]
    slope = (ends[1] - ends[0]) / (2.0 * _STEP * scale.median)
    se = float(np.hypot(given.se, slope * scale.median_se))
    half = se * float(special.stdtrit(max(seeds - 1, 1), 0.975))
    return Estimate(given.mean, se, given.mean - half, given.mean + half)
