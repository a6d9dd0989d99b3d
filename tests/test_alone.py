"""A robot by itself: it has nobody to collide with, and what does not matter to it is not told as if it did."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from qocjax import QocScale, Scenario
from qocjax.advice.little import Little, little_of
from qocjax.advice.margins import Margin
from qocjax.advice.plane import Plane
from qocjax.advice.reaching import Bound
from qocjax.advice.robust import _close
from qocjax.advice.target import Target, usual_target
from qocjax.advice.verdict import answer_of, verdict_of
from qocjax.commands.advice_page.decision import _safety
from qocjax.commands.advice_page.words import collisions_text
from qocjax.commands.sweep_page import collisions_text as swept_text
from qocjax.quality import qoc
from qocjax.statistics.collisions import collision_share, is_alone
from qocjax.statistics.estimates import Estimate, share
from qocjax.statistics.scores import Scores


def test_one_robot_has_nobody_to_collide_with() -> None:
    never = np.zeros(8, bool)
    assert collision_share(never, 1) == Estimate(0.0, 0.0, 0.0, 0.0)
    units = np.array([-1, -1, -1, -2, -2, -2, -3, -3])
    assert collision_share(never, 1, units, np.arange(8.0)).high == 0.0
    assert collision_share(never, 2) == share(never) and collision_share(never, 2).high > 0.3
    assert is_alone(collision_share(never, 1).high) and not is_alone(share(np.zeros(100_000)).high)
    row = pd.Series({"collision_low": 0.0, "collision_high": 0.0})
    assert verdict_of(True, row, 0.0) == "recommended"  # whatever is allowed


def test_a_plane_of_one_robot_keeps_any_limit() -> None:
    scores = np.ones((2, 3, 4))
    plane = {robots: Plane(np.arange(3.0), np.array([0.5, 1.0]), scores, scores, scores < 0.0, robots)
             for robots in (1, 2)}  # fmt: skip
    assert plane[1].excess(0.0).max() == 0.0 and plane[1].to_table()["collision_high"].max() == 0.0
    assert plane[2].excess(0.01).max() <= 0.0 < plane[2].to_table()["collision_high"].min()


@pytest.mark.parametrize(
    ("upper", "words"), [(0.0, "One robot: nobody to collide with; walls"), (0.02, "never closer")]
)
def test_pages_say_that_nobody_is_there(upper: float, words: str) -> None:
    row = {"collision_share": 0.0, "collision_low": 0.0, "collision_high": upper,
           "min_distance": np.inf if upper == 0.0 else 0.4}  # fmt: skip
    text = _safety(row, 0.01)
    assert words in text and "inf" not in text
    assert collisions_text(row) == ("none" if upper == 0.0 else "0.0% [0.0%, 2.0%]")
    swept = pd.DataFrame([row | {"within_limit": True}])
    assert next(swept_text(each) for each in swept.itertuples()).startswith("one robot" if upper == 0.0 else "0.0% [")


def test_what_is_little_is_a_radius_over_the_way() -> None:
    """A robot that lags by its radius all the way has just that AUC more; and a slower one has as much of it."""
    burger = Scenario(start=[[-2.0, 0.0, 0.0]], normaliser="goal_distance", nominal_v_max=0.2, robot_radius=0.1)
    little = little_of(burger, QocScale(0.01, 20.0))
    assert little.auc == pytest.approx(4.0 / 0.2 * 0.1**2 / 4.0**2) and little.ratio == pytest.approx(100 * little.auc)
    assert little.further(little.auc) == pytest.approx(0.1) and little.further(-1.0) == 0.0
    best, worse = (float(qoc(auc, QocScale(0.01, 20.0))) for auc in (0.004, 0.004 + little.auc))
    assert little.share(best) == pytest.approx(worse / best)  # what QoC makes of it
    shown = usual_target(burger, QocScale(0.01, 20.0))
    assert shown.little == little and shown.level(best) == pytest.approx(worse)
    np.testing.assert_allclose(shown.beyond(np.array([[worse]]), np.array([best])), 0.0, atol=1e-12)
    assert f"or AUC at most {little.auc:.2g} s more" in shown.text and "and AUC grows" in shown.lost


def test_where_auc_is_large_a_share_of_the_best_is_all() -> None:
    paper = Scenario()
    assert usual_target(paper, QocScale(5.0, 30.0)) == Target()  # the paper's own two robots
    assert little_of(paper, QocScale(5.0, 30.0)).auc == pytest.approx(4.0 / 0.7 * 0.105**2 / 1.5**2)


def test_a_deadline_that_hardly_matters_may_stay() -> None:
    little = Little(0.012, 0.105, 7.5)
    ends = (Bound(0.04, 0.04, 0.04, False), Bound(0.43, 0.43, 0.43, False))

    def answer(at: float, qoc_: float, high: float = 0.0, target: Target | None = None) -> str:
        margin = Margin(target or Target(little=little), 0.05, Estimate(0.8, 0.01, 0.78, 0.82), *ends)
        row = pd.Series({"deadline": at, "collision_low": 0.0, "collision_high": high, "qoc": qoc_})
        return answer_of(row, margin, 0.01)

    assert answer(0.3, 0.21) == "yes: hardly matters" and answer(0.05, 0.79) == "yes"
    assert answer(0.3, 0.21, high=0.02) == "not shown" and answer(0.6, 0.05) == "no: target"
    assert answer(0.3, 0.21, target=Target()) == "yes"  # a margin that is given as it is


def test_standing_up_may_cost_a_part_of_what_is_little() -> None:
    scale = QocScale(0.0016, 17.0)
    best, safer = (Scores.of(np.full((8, 1), auc), scale) for auc in (0.0005, 0.0006))
    assert not _close(safer, best, None) and _close(safer, best, Little(0.012, 0.105, 7.5))
    assert not _close(Scores.of(np.full((8, 1), 0.005), scale), best, Little(0.012, 0.105, 7.5))
