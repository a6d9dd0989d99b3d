"""Fitted gains judged: each setting's curve on seeds that the fit has not seen, before and after, in pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from qocjax.network.interface import Network
from qocjax.network.schedule import Rules
from qocjax.scenario import Design
from qocjax.validation.agreement import Agreement, agreement, rmse
from qocjax.validation.curves import Curve, common, normalised
from qocjax.validation.fit import Setting
from qocjax.validation.resample import Interval, hull, percentiles, resample
from qocjax.validation.simulated import simulated_curve

__all__ = ["Judged", "halves", "judge_gains"]


@dataclass(frozen=True, eq=False)
class Judged:
    """How one setting is followed before and after a fit.

    Attributes:
        name: Of the setting.
        before: Agreement with the baseline's gains.
        after: Agreement with the fitted gains.
        gain: RMSE before less RMSE after, of 100, on common bootstrap samples.
        curve: A row per delay: E and both S on the normalised scale, what is left of the difference with its interval,
            and with one that holds at all delays at once (`left_all_`).
    """

    name: str
    before: Agreement
    after: Agreement
    gain: Interval
    curve: pd.DataFrame

    def row(self) -> dict[str, object]:
        """As a row of a table."""
        found: dict[str, object] = {"setting": self.name}
        for label, each in (("before", self.before.rmse), ("after", self.after.rmse), ("gain", self.gain)):
            name = label if label == "gain" else f"rmse_{label}"
            found |= {name: each.value, f"{name}_low": each.low, f"{name}_high": each.high}
        found["rmse_of_noise"] = self.after.noise
        for label, agreed in (("before", self.before), ("after", self.after)):
            rank = agreed.spearman
            found |= {f"spearman_{label}": rank.value, f"spearman_{label}_low": rank.low,
                      f"spearman_{label}_high": rank.high}  # fmt: skip
        worst = self.curve.iloc[int(self.curve["left"].abs().argmax())]
        return found | {
            "worst_delay": worst["delay"], "worst_left": worst["left"], "worst_left_low": worst["left_all_low"],
            "worst_left_high": worst["left_all_high"], "paired": self.after.paired,
        }  # fmt: skip


def judge_gains(
    setting: Setting,
    before: Design,
    after: Design,
    network: Network,
    seeds: Sequence[int],
    *,
    rules: Rules | None = None,
    key: int = 0,
    resamples: int = 2000,
    random: int = 0,
) -> Judged:
    """Judges fitted gains in one setting.

    Args:
        setting: With E on what the fit has not seen.
        before: Numbers; the gains to compare with.
        after: Numbers; the fitted gains.
        network: Where loop times come from.
        seeds: Of the surrogate; where they are those of E, everything is compared in pairs.
        rules: Hold.
        key: Root of all random numbers.
        resamples: Bootstrap samples.
        random: Seed of their draws.

    Raises:
        ValueError: A run that diverged, or a curve that does not vary.
    """
    axis = setting.measured.delays
    own = [simulated_curve(setting.scenario, design, network, axis, seeds, rules=rules, key=key, source=name)
           for name, design in (("baseline", before), ("fitted", after))]  # fmt: skip
    found = [agreement(*common(curve, setting.measured), resamples, random) for curve in own]
    draws = [resample(curve, setting.measured, resamples, random) for curve in own]  # the same samples for both
    distances = [rmse(each.simulated, each.measured) for each in draws]
    gain = hull(found[0].rmse.value - found[1].rmse.value, distances[0] - distances[1], -100.0, 100.0)
    left = normalised(draws[1].simulated) - normalised(draws[1].measured)
    return Judged(setting.name, found[0], found[1], gain, _table(setting, own, left))


def _table(setting: Setting, own: list[Curve], left: np.ndarray) -> pd.DataFrame:
    e, before, after = (normalised(curve.mean) for curve in (setting.measured, *own))
    ends = [percentiles(float(value), column) for value, column in zip(after - e, left.T, strict=True)]
    half = [100.0 / np.ptp(curve.mean) * curve.half_widths() for curve in (setting.measured, own[1])]
    spread = np.maximum(left.std(axis=0), 1e-12)  # the largest of many differences is large by chance: max-t band
    band = spread * np.quantile(np.abs((left - (after - e)) / spread).max(axis=1), 0.95)
    return pd.DataFrame({
        "setting": setting.name, "delay": setting.measured.delays, "measured": e, "measured_half": half[0],
        "before": before, "after": after, "after_half": half[1], "left": after - e,
        "left_low": [each.low for each in ends], "left_high": [each.high for each in ends],
        "left_all_low": after - e - band, "left_all_high": after - e + band,
    })  # fmt: skip


def halves(curve: Curve) -> tuple[Curve, Curve]:
    """A measured curve in two: every other repetition to fit, the others to judge.

    Raises:
        ValueError: A delay has one repetition alone.
    """
    if few := [delay for delay, each in zip(curve.delays, curve.values, strict=True) if each.size < 2]:
        raise ValueError(f"{curve.source}: got one repetition at {1e3 * few[0]:g} ms, expected two or more at every "
                         "delay: some to fit gains to, others to judge them on")  # fmt: skip
    parts = []
    for first in (0, 1):
        seeds = None if curve.seeds is None else curve.seeds[first::2]
        units = None if curve.units is None else curve.units[first::2]
        parts.append(Curve(curve.delays, tuple(each[first::2] for each in curve.values), seeds, curve.source, units))
    return parts[0], parts[1]
