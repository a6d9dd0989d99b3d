"""What is asked of the closed loop: grids, policies, statistics."""

from qocjax.statistics.estimates import Estimate, estimate, paired, standard_error
from qocjax.study.grid import SWEPT, Grid, one_at_a_time
from qocjax.study.opened import open_study
from qocjax.study.policies import POLICIES
from qocjax.study.replay import replay
from qocjax.study.study import Study
from qocjax.study.sweep import run_study

__all__ = [
    "POLICIES",
    "SWEPT",
    "Estimate",
    "Grid",
    "Study",
    "estimate",
    "one_at_a_time",
    "open_study",
    "paired",
    "replay",
    "run_study",
    "standard_error",
]
