"""Validation: AUC over configured delays of the surrogate held against measured ones, and gains fitted to them."""

from qocjax.validation.agreement import Agreement, agreement, kendall, rmse, spearman
from qocjax.validation.compare import Validation, compare
from qocjax.validation.curves import Curve, common, normalised
from qocjax.validation.fit import BOUNDS, FIT_METHODS, Fit, Setting, fit
from qocjax.validation.judge import Judged, halves, judge_gains
from qocjax.validation.regimes import REGIMES, Regimes, boundaries, regimes
from qocjax.validation.resample import Interval, Resampled, resample
from qocjax.validation.runs import Grouping, curve_of_runs, run_points
from qocjax.validation.simulated import simulated_curve
from qocjax.validation.tables import curve_of_csv

__all__ = [
    "BOUNDS",
    "FIT_METHODS",
    "REGIMES",
    "Agreement",
    "Curve",
    "Fit",
    "Grouping",
    "Interval",
    "Judged",
    "Regimes",
    "Resampled",
    "Setting",
    "Validation",
    "agreement",
    "boundaries",
    "common",
    "compare",
    "curve_of_csv",
    "curve_of_runs",
    "fit",
    "halves",
    "judge_gains",
    "kendall",
    "normalised",
    "regimes",
    "resample",
    "rmse",
    "run_points",
    "simulated_curve",
    "spearman",
]
