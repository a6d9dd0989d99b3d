"""S held against E: normalised curves, their agreement, and the regimes of both, as tables (model, section 10)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from qocjax.network.interface import Reliability
from qocjax.validation.agreement import Agreement, agreement
from qocjax.validation.curves import Curve, common, normalised
from qocjax.validation.regimes import Regimes, regimes
from qocjax.validation.resample import Interval, percentiles, resample

__all__ = ["CURVES", "Validation", "compare"]

CURVES = ("simulated", "measured")


@dataclass(frozen=True, eq=False)
class Validation:
    """What a validation found; both curves at the delays that they have in common."""

    simulated: Curve
    measured: Curve
    agreement: Agreement
    regimes: dict[str, Regimes]  # by curve
    curve: pd.DataFrame  # a row per delay
    agreement_table: pd.DataFrame  # a row per measure
    regime_table: pd.DataFrame  # a row per curve and regime


def compare(
    simulated: Curve,
    measured: Curve,
    reliability: Callable[[np.ndarray], Reliability],
    *,
    resamples: int = 2000,
    random: int = 0,
    share: float = 0.5,
) -> Validation:
    """Compares two curves at their common delays.

    Args:
        simulated: S.
        measured: E.
        reliability: F, of delays (s).
        resamples: Bootstrap samples behind every interval.
        random: Seed of their draws.
        share: See `regimes`.

    Raises:
        ValueError: Fewer than three common delays, or a curve that does not vary.
    """
    s, e = common(simulated, measured)
    found = agreement(s, e, resamples, random)
    drawn = resample(s, e, resamples, random)
    both = {"simulated": regimes(s, drawn.simulated, share), "measured": regimes(e, drawn.measured, share)}
    loops = reliability(s.delays)
    gaps = normalised(_varied(drawn.simulated)) - normalised(_varied(drawn.measured))
    curve = _curve_table(s, e, loops, gaps)
    return Validation(s, e, found, both, curve, _agreement_table(found), _regime_table(both, reliability))


def _varied(curves: np.ndarray) -> np.ndarray:
    """The curves with a scale; the others as those before them, so that pairs stay pairs."""
    bad = np.ptp(curves, axis=1) <= 0
    return np.where(bad[:, None], curves[~bad][:1], curves)


def _curve_table(s: Curve, e: Curve, loops: Reliability, gaps: np.ndarray) -> pd.DataFrame:
    """Means with Student intervals, in s and on the normalised scale, and the difference with its bootstrap interval.

    The interval of a normalised value is that of the mean on the scale of the curve's own minimum and maximum: a
    bootstrap of normalised values would have none where the curve is 0 or 100 by definition.
    """
    columns: dict[str, np.ndarray] = {"delay": s.delays, "reliability": loops.share, "reliability_se": loops.error}
    for name, curve in zip(CURVES, (s, e), strict=True):
        mean, half = curve.mean, curve.half_widths()
        scale = 100.0 / np.ptp(mean)
        columns |= {f"{name}_auc": mean, f"{name}_auc_low": mean - half, f"{name}_auc_high": mean + half}
        scaled = normalised(mean)
        columns |= {f"{name}": scaled, f"{name}_low": scaled - scale * half, f"{name}_high": scaled + scale * half,
                    f"{name}_runs": curve.repetitions}  # fmt: skip
    own = normalised(s.mean) - normalised(e.mean)
    found = [percentiles(float(value), column) for value, column in zip(own, gaps.T, strict=True)]
    columns |= {"difference": own, "difference_low": np.array([each.low for each in found]),
                "difference_high": np.array([each.high for each in found])}  # fmt: skip
    return pd.DataFrame(columns)


def _agreement_table(found: Agreement) -> pd.DataFrame:
    rows = [{"measure": name, "value": each.value, "low": each.low, "high": each.high}
            for name, each in (("spearman", found.spearman), ("kendall", found.kendall), ("rmse", found.rmse),
                               ("rmse_log", found.rmse_log))]  # fmt: skip
    rows.append({"measure": "rmse_of_noise", "value": found.noise, "low": np.nan, "high": np.nan})
    return pd.DataFrame(rows).assign(delays=found.delays, paired=found.paired)


def _regime_table(found: dict[str, Regimes], reliability: Callable[[np.ndarray], Reliability]) -> pd.DataFrame:
    """Begin and end of each regime with their intervals (s), F there, and how far AUC falls or rises in it (of 100)."""
    rows = []
    for curve, each in found.items():
        first, last = (Interval(value, value, value) for value in (each.first, each.last))
        bounds = (first, each.begins, each.best, last)
        falls = Interval(-each.fall.value, -each.fall.high, -each.fall.low)
        moved = (Interval(np.nan, np.nan, np.nan), falls, each.rise)
        for k, (regime, span) in enumerate(each.spans.items()):
            row: dict[str, object] = {"curve": curve, "regime": regime, "shown": span is not None}
            for name, end in (("begin", bounds[k]), ("end", bounds[k + 1]), ("change", moved[k])):
                row |= {name: end.value, f"{name}_low": end.low, f"{name}_high": end.high}
            ends = (bounds[k].value, bounds[k + 1].value)
            f = reliability(np.array(ends)).share
            row |= {"reliability_begin": f[0], "reliability_end": f[1]}
            row["begins_before"] = k == 0 and each.open
            rows.append(row)
    table = pd.DataFrame(rows)
    return table
