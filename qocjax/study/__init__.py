"""What is asked of the closed loop: grids, policies, statistics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qocjax._lazy import names_of

if TYPE_CHECKING:
    from qocjax.statistics.estimates import Estimate, estimate, paired, standard_error
    from qocjax.study.grid import SWEPT, Grid, one_at_a_time
    from qocjax.study.opened import open_study
    from qocjax.study.policies import POLICIES
    from qocjax.study.replayed import replay
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

if not TYPE_CHECKING:  # tables and what reads them take long to import, and a configuration needs none
    _HOMES = {
        "qocjax.statistics.estimates": ("Estimate", "estimate", "paired", "standard_error"),
        "qocjax.study.grid": ("SWEPT", "Grid", "one_at_a_time"),
        "qocjax.study.opened": ("open_study",),
        "qocjax.study.policies": ("POLICIES",),
        "qocjax.study.replayed": ("replay",),
        "qocjax.study.study": ("Study",),
        "qocjax.study.sweep": ("run_study",),
    }
    __getattr__, __dir__ = names_of(__name__, _HOMES)
