"""Joint search for a design: a space, limits, methods with equal budgets, and a judgement on fresh seeds."""

from qocjax.search.contest import Contest, compete
from qocjax.search.find import CHOICE_SEEDS, FIRST, Found, find
from qocjax.search.judge import Judged, judge, stacked, tie_set
from qocjax.search.limits import Limits
from qocjax.search.measure import MEASURES, Measure
from qocjax.search.methods import METHODS, Method
from qocjax.search.policies import policy_designs
from qocjax.search.space import Space
from qocjax.search.trial import BudgetSpentError, Known, Problem, Trial, take

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
