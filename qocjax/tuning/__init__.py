"""Tuning of continuous parameters by gradients: bounds, estimators, the search, and its judgement."""

from qocjax.tuning.bounds import DEFAULT_BOUNDS, Bounds
from qocjax.tuning.estimators import ESTIMATORS, Blend, Estimator, Pathwise, Slopes, Smoothed, make_estimator
from qocjax.tuning.judge import Tuning, judge, tune
from qocjax.tuning.problem import Problem, spread_starts
from qocjax.tuning.search import Search, Trail, search

__all__ = [
    "DEFAULT_BOUNDS",
    "ESTIMATORS",
    "Blend",
    "Bounds",
    "Estimator",
    "Pathwise",
    "Problem",
    "Search",
    "Slopes",
    "Smoothed",
    "Trail",
    "Tuning",
    "judge",
    "make_estimator",
    "search",
    "spread_starts",
    "tune",
]
