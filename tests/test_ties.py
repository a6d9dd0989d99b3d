"""Ties of a sweep: what the seeds of the choice cannot tell from what was chosen."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.special import stdtrit

from qocjax import Design, Scenario, one_at_a_time, paper_network, run_study
from qocjax.study.study import Study
from qocjax.study.sweep import qoc_by_seed
from qocjax.study.ties import tie_lines

SCENARIO = Scenario(start=[[-0.6, -0.5, 0.3], [-0.6, 0.5, 0.0]], goal=[1.0, 0.0], horizon=4.0)
GRID = one_at_a_time(Design(tau=0.1), {"c_miss": [0.0, 0.05, 2.0], "kappa": [0.25, 2.0]}, [0.2, 0.3, 0.8])


@pytest.fixture(scope="module")
def study() -> Study:
    return run_study(SCENARIO, GRID, paper_network(), range(12), range(12, 24))


def test_a_value_ties_where_the_paired_interval_holds_zero(study: Study) -> None:
    """Intervals that hold all at once: of K - 1 differences each at 95 % with Bonferroni's correction."""
    scores, results = qoc_by_seed(study.runs, study.scale)[GRID.design], study.results
    for row in study.policies.to_dict("records"):
        rows = GRID.rows(row["sweep"])
        values = GRID.value[rows[:, 0]]
        chosen = rows[values == row["value"]][0][GRID.deadline[rows[0]] == row["deadline"]][0]
        tied = []
        for k, value in enumerate(values):
            free = row["policy"] == "Co-design"
            own = rows[k][results["qoc"].to_numpy()[rows[k]].argmax()] if free else (
                rows[k][GRID.deadline[rows[0]] == row["deadline"]][0])  # fmt: skip
            gap = scores[own] - scores[chosen]
            half = stdtrit(len(gap) - 1, 1 - 0.025 / (len(values) - 1)) * gap.std(ddof=1) / len(gap) ** 0.5
            if own == chosen or gap.mean() + half >= 0.0:
                tied.append(f"{value:g}")
        assert row["tied_values"].split() == tied
        assert row["tied_deadline_low"] <= row["deadline"] <= row["tied_deadline_high"]


def test_equal_designs_tie_and_worse_ones_do_not(study: Study) -> None:
    best = study.policies[study.policies["policy"] == "Co-design"].set_index("sweep")
    assert "0.25" not in best.loc["kappa", "tied_values"].split()  # slow, and surely worse
    assert best.loc["c_miss", "tied_values"].split()[:2] == ["0", "0.05"]
    assert any(line.startswith("c_miss: 0, 0.05") for line in tie_lines(study.policies))


def test_nothing_is_said_of_what_stands_alone() -> None:
    row = {"policy": "Co-design", "qoc": 0.5, "sweep": "eta", "value": 1.0, "tied_values": "1",
           "tied_deadline_low": 0.2, "tied_deadline_high": 0.2}  # fmt: skip
    assert tie_lines(pd.DataFrame([row])) == []
    assert tie_lines(pd.DataFrame([row | {"tied_deadline_high": 0.3}])) == [
        "eta: 1; at 1 any deadline from 200 to 300 ms"
    ]
    assert tie_lines(pd.DataFrame([row | {"qoc": np.nan, "tied_values": "1 2"}])) == []
