"""Joint search for a design: a space, limits, methods with equal budgets, and a judgement on fresh seeds."""

from qocjax.study.search.contest import Contest, compete
from qocjax.study.search.find import CHOICE_SEEDS, FIRST, Found, find
from qocjax.study.search.judge import Judged, judge, stacked, tie_set
from qocjax.study.search.limits import Limits
from qocjax.study.search.measure import MEASURES, Measure
from qocjax.study.search.methods import METHODS, Method
from qocjax.study.search.policies import policy_designs
from qocjax.study.search.space import Space
from qocjax.study.search.trial import BudgetSpentError, Known, Problem, Trial, take

__all__ = [
    "CHOICE_SEEDS",
    "FIRST",
    "MEASURES",
    "METHODS",
    "BudgetSpentError",
    "Contest",
    "Found",
    "Judged",
    "Known",
    "Limits",
    "Measure",
    "Method",
    "Problem",
    "Space",
    "Trial",
    "compete",
    "find",
    "judge",
    "policy_designs",
    "stacked",
    "take",
    "tie_set",
]
