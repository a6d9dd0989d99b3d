"""AUC over configured delays from recorded runs: a point per run, at the delay that its own stamps tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from qocjax import _checks
from qocjax.recorded import RecordedRun
from qocjax.validation.curves import Curve

__all__ = ["Grouping", "curve_of_runs", "run_points"]


@dataclass(frozen=True)
class Grouping:
    """How runs come to their configured delays.

    Attributes:
        label: Label of a run that holds its configured delay in ms; None measures it.
        quantile: Of a run's D_cfg, which is its configured delay. Commands that miss it are late, never early: a low
            quantile is the configured delay whether late commands are applied late or not at all.
        delays: Configured delays to take the nearest of (s); None makes bins.
        tolerance: Farthest that a run's delay may lie from a configured one (s).
        bin: Width of the bins about whole multiples of it (s).
    """

    label: str | None = None
    quantile: float = 0.1
    delays: Sequence[float] | np.ndarray | None = None
    tolerance: float = 0.01
    bin: float = 0.02

    def __post_init__(self) -> None:
        _checks.bounded("quantile", self.quantile, least=0, most=1)
        _checks.bounded("tolerance", self.tolerance, above=0)
        _checks.bounded("bin", self.bin, above=0)
        if self.delays is not None:
            _checks.bounded("delays", np.asarray(self.delays, float), least=0)

    def place(self, delay: float) -> float | None:
        """The configured delay of a run with this delay (s); None where none is near."""
        if self.delays is None:
            return round(delay / self.bin) * self.bin
        axis = np.asarray(self.delays, float)
        nearest = float(axis[np.abs(axis - delay).argmin()])
        return nearest if abs(nearest - delay) <= self.tolerance else None


def run_points(
    runs: Sequence[RecordedRun], labels: Sequence[dict[str, str | float]], grouping: Grouping
) -> pd.DataFrame:
    """A row per run: its D_cfg (model, section 10), the delay that it counts for, its AUC, or why it does not count.

    D_cfg of a command is when it was applied less the stamp of the state that it answers, both on the robot's clock.

    Returns:
        Columns run, d_cfg (s; the quantile over all loops of all robots), d_cfg_median, late_share (of loops later than
        the configured delay and the tolerance), delay (s; NaN where the run does not count), auc (s), left_out.
    """
    rows = []
    for run, label in zip(runs, labels, strict=True):
        times = np.concatenate([each.table["loop_time"].to_numpy(float) for each in run.loops.values()] or [[]])
        times = times[np.isfinite(times)]
        low, middle = np.quantile(times, [grouping.quantile, 0.5]) if times.size else (np.nan, np.nan)
        delay, auc, why = _point(run, label, float(low), grouping)
        late = float(np.mean(times > delay + grouping.tolerance)) if times.size and np.isfinite(delay) else np.nan
        rows.append({"run": run.name, "d_cfg": low, "d_cfg_median": middle, "late_share": late, "delay": delay,
                     "auc": auc, "left_out": why})  # fmt: skip
    return pd.DataFrame(rows)


def _point(
    run: RecordedRun, label: dict[str, str | float], measured: float, grouping: Grouping
) -> tuple[float, float, str]:
    """Configured delay (s) and AUC (s) of a run, or why it has none."""
    none, delay = float("nan"), measured
    if grouping.label is not None:
        given = label.get(grouping.label)
        if not isinstance(given, int | float):
            return none, none, f"its label {grouping.label!r} is {given!r}, no number of ms"
        delay = float(given) / 1e3
    if not np.isfinite(delay):
        return none, none, "no command or stamp tells of its delay"
    if run.quality is None or not np.isfinite(run.quality.auc).any():
        return none, none, "no AUC: " + (run.findings.notes[-1] if run.findings.notes else "no poses")
    place = grouping.place(delay)
    if place is None:
        return none, none, f"{1e3 * delay:.4g} ms is within {1e3 * grouping.tolerance:g} ms of no configured delay"
    return place, float(np.nanmean(run.quality.auc)), ""


def curve_of_runs(points: pd.DataFrame, source: str = "recorded runs") -> Curve:
    """The curve of the runs that count; runs of one configured delay are repetitions.

    Raises:
        ValueError: No run counts.
    """
    counting = points[points["left_out"] == ""]
    if counting.empty:
        first = f"{points['run'].iloc[0]}: {points['left_out'].iloc[0]}" if len(points) else "there are no runs"
        raise ValueError(f"{source}: got no run with a configured delay and an AUC ({first}), expected some")
    groups = counting.groupby("delay")["auc"]
    axis = np.array(sorted(groups.groups), np.float64)
    return Curve(axis, tuple(groups.get_group(delay).to_numpy(np.float64) for delay in axis), None, source)
