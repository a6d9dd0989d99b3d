"""A validation in lines for a terminal: agreement, regimes, and what fitted gains are worth."""

from __future__ import annotations

import numpy as np
import pandas as pd

from qocjax.study.edges import bounds_text
from qocjax.units import printed_unit
from qocjax.validation import Curve, Fit, Judged, Validation

__all__ = ["page"]


def page(
    found: Validation, points: pd.DataFrame | None = None, fitted: Fit | None = None, judged: Judged | None = None
) -> str:
    """What a validation found, as a few lines for a terminal.

    Args:
        found: Agreement and regimes.
        points: Recorded runs, of which those that do not count are told.
        fitted: Gains that were fitted to E.
        judged: What they are worth on runs that the fit has not seen.
    """
    how = "compared in pairs, by seed" if found.agreement.paired else "compared by their means"
    lines = [f"S: {found.simulated.source}, {_count(found.simulated)}; E: {found.measured.source}, "
             f"{_count(found.measured)}; {found.agreement.delays} delays, {how}."]  # fmt: skip
    if points is not None:
        lost = points[points["left_out"] != ""]
        lines += [f"{row.run}: left out: {row.left_out}" for row in lost.itertuples()]
    if min(found.measured.repetitions) == 1:
        lines.append("E has one run alone at some delays, whose error is in no interval.")
    names = {"spearman": "Spearman's rank correlation", "kendall": "Kendall's rank correlation",
             "rmse": "RMSE on the normalised scale", "rmse_log": "RMSE of normalised log AUC",
             "rmse_of_noise": "RMSE of the noise alone"}  # fmt: skip
    for row in found.agreement_table.itertuples():
        ends = "" if np.isnan(row.low) else f"  [{row.low:.3g}, {row.high:.3g}]"
        lines.append(f"  {names[str(row.measure)]:<30} {row.value:.3g}{ends}")
    lines += [
        "",
        _regime_text(found.regime_table),
        "The first and the last of the delays compared set the scale and where the regimes end.",
    ]
    if fitted is not None and judged is not None:
        lines += ["", *_fit_lines(fitted, judged)]
    return "\n".join(lines)


def _count(curve: Curve) -> str:
    low, high = int(curve.repetitions.min()), int(curve.repetitions.max())
    if low == high:
        return f"{low} run{'s' if low > 1 else ''} at each delay"
    return f"{low} to {high} runs at each delay"


def _regime_text(table: pd.DataFrame) -> str:
    def end(value: float, low: float, high: float) -> str:
        return f"{1e3 * value:.0f}" if low == high else f"{1e3 * value:.0f} [{1e3 * low:.0f}, {1e3 * high:.0f}]"

    shown = pd.DataFrame({
        "curve": table["curve"].where(~table["curve"].duplicated(), ""),
        "regime": table["regime"],
        "from (ms)": [end(r.begin, r.begin_low, r.begin_high) if r.shown else "not shown" for r in table.itertuples()],
        "to (ms)": [end(r.end, r.end_low, r.end_high) if r.shown else "" for r in table.itertuples()],
        "F": [f"{r.reliability_begin:.3f} to {r.reliability_end:.3f}" if r.shown else "" for r in table.itertuples()],
        "change (of 100)": [
            f"{r.change:+.1f} [{r.change_low:+.1f}, {r.change_high:+.1f}]" if r.shown and np.isfinite(r.change)
            else "begins before" if r.shown and r.begins_before else "" for r in table.itertuples()
        ],
    })  # fmt: skip
    return shown.to_string(index=False)


def _fit_lines(fitted: Fit, judged: Judged) -> list[str]:
    gains = ", ".join(f"{name} = {value:.3g} {printed_unit(name)}".strip() for name, value in fitted.gains.items())
    row = judged.row()
    texts = {name: f"{row[name]:.3g} [{row[f'{name}_low']:.3g}, {row[f'{name}_high']:.3g}]"
             for name in ("rmse_before", "rmse_after", "gain", "worst_left")}  # fmt: skip
    return [
        f"Fitted on half of the runs: {gains}",
        *([bounds_text(fitted.at_edge)] if fitted.at_edge else []),
        f"On the other half: RMSE {texts['rmse_before']} before, {texts['rmse_after']} after; less by {texts['gain']}.",
        f"What is left is largest at {1e3 * judged.curve.loc[judged.curve['left'].abs().idxmax(), 'delay']:g} ms: "
        f"S - E = {texts['worst_left']} (of 100; the interval holds at all delays at once).",
    ]
