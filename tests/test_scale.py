"""The QoC scale: what its error is, which intervals hold, where it comes from."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from qocjax import Design, QocScale, Scenario, evaluate, one_at_a_time, paper_network, run_study, simulate
from qocjax.config.scale import given_scale, yardstick
from qocjax.statistics.scales import measured_scale, scale_of_runs, scale_text, standing_still
from qocjax.statistics.scores import Scored, Scores, seed_scores

SCENARIO = Scenario(start=[[-0.6, -0.5, 0.3], [-0.6, 0.5, 0.0]], goal=[1.0, 0.0], horizon=4.0)


@pytest.mark.parametrize(
    "scenario",
    [
        Scenario(),
        SCENARIO,
        Scenario(start=[[0.5, 0.5, 0.0]], reference_per_robot=True, normaliser="goal_distance", weights=[1.0, 3.0]),
    ],
)
def test_standing_still_is_a_run_without_a_loop(scenario: Scenario) -> None:
    ticks = round(scenario.horizon / 0.01)
    run = simulate(scenario, Design(), np.full((ticks, scenario.num_robots), np.inf))
    assert standing_still(scenario) == pytest.approx(float(np.max(run.auc)), rel=1e-4)


def test_error_of_the_median_is_the_spread_of_medians() -> None:
    rng, found, errors = np.random.default_rng(0), [], []
    for _ in range(300):
        luck = rng.normal(0.0, 0.3, (1, 24, 1))  # what the runs of a seed have in common
        scale = scale_of_runs(np.exp(rng.normal(1.0, 0.5, (40, 24, 2)) + luck), SCENARIO)
        found.append(scale.median)
        errors.append(scale.median_se)
    assert np.mean(errors) == pytest.approx(np.std(found), rel=0.1)


def test_parts_are_the_whole() -> None:
    auc = np.exp(np.random.default_rng(1).normal(1.0, 0.8, (10, 16, 2)))
    auc[3, 4, 1] = np.inf
    parts = [(slice(0, 8), auc[:, :8]), (slice(8, 16), auc[:4, 8:]), (slice(8, 16), auc[4:, 8:])]
    assert measured_scale(lambda: parts, np.arange(16), None) == scale_of_runs(auc, SCENARIO, "runs")
    whole = scale_of_runs(auc, SCENARIO)
    assert whole.largest == standing_still(SCENARIO) and whole.median == np.median(auc[np.isfinite(auc)])
    assert "known to ±" in scale_text(whole, "of this study") and "known" not in scale_text(QocScale(1.0, 2.0), "given")
    with pytest.raises(ValueError, match="j_max_of: got 'largest', expected one of still, runs"):
        scale_of_runs(auc, SCENARIO, "largest")


def score(auc: np.ndarray, scale: QocScale) -> Scored:
    return Scores.of(auc, scale).mean()


def test_a_given_scale_has_one_interval() -> None:
    auc = np.random.default_rng(2).gamma(3.0, 1.0, (32, 2))
    fixed, known = QocScale(3.0, 100.0), QocScale(3.0, 100.0, median_se=0.3)
    assert score(auc, fixed).whole == score(auc, fixed).given == score(auc, known).given
    slope = float((seed_scores(auc, QocScale(3.001, 100.0)) - seed_scores(auc, QocScale(2.999, 100.0))).mean()) / 0.002
    assert score(auc, known).whole.se == pytest.approx(np.hypot(score(auc, fixed).given.se, 0.3 * slope), rel=1e-3)
    gap = (Scores.of(auc, known) - Scores.of(auc, known)).mean()
    assert gap.given.mean == 0.0 and gap.whole.se == 0.0


@pytest.mark.slow
def test_intervals_of_a_study_hold_as_often_as_they_say() -> None:
    """Over other keys: given the scale the long-run QoC on that scale, with its error that on the long-run scale."""
    grid = one_at_a_time(Design(tau=0.1), {"kappa": [1.0, 2.0, 4.0]}, [0.2, 0.3, 0.5])
    network = paper_network()
    many = evaluate(SCENARIO, grid.designs, network, range(4000), key=99)["auc"].values.astype(float)
    truth = QocScale(float(np.median(many)), standing_still(SCENARIO))
    held, count = {"given": 0, "whole": 0, "gap": 0}, 150
    for key in range(count):
        study = run_study(SCENARIO, grid, network, range(24), range(24, 88), key=key)
        row = study.policies.iloc[0]
        place = int(np.flatnonzero((grid.value == row["value"]) & (grid.deadline == row["deadline"]))[0])
        own = float(seed_scores(many[grid.design[place]], study.scale).mean())
        long_run = float(seed_scores(many[grid.design[place]], truth).mean())
        held["given"] += row["qoc_low"] <= own <= row["qoc_high"]
        held["whole"] += row["qoc_whole_low"] <= long_run <= row["qoc_whole_high"]
        other = study.policies.iloc[2]
        at = int(np.flatnonzero((grid.value == other["value"]) & (grid.deadline == other["deadline"]))[0])
        gap = float(seed_scores(many[grid.design[at]], truth).mean()) - long_run
        held["gap"] += other["difference_whole_low"] <= gap <= other["difference_whole_high"]
    low, high = stats.binom.ppf([0.001, 0.999], count, 0.95)
    assert all(low <= hits <= high for hits in held.values()), held


def test_a_scale_is_named_by_a_file_or_a_study(tmp_path: Path) -> None:
    paper = given_scale("sweep", None, None, "paper", Scenario())
    assert paper is not None and paper.largest == pytest.approx(standing_still(Scenario()), rel=1e-4)
    (tmp_path / "record.json").write_text(json.dumps({"j_med": 2.0, "j_max": 9.0, "yardstick": yardstick(SCENARIO)}))
    assert given_scale("sweep", None, None, str(tmp_path), SCENARIO) == QocScale(2.0, 9.0)
    assert given_scale("sweep", 1.0, 2.0, None, SCENARIO) == QocScale(1.0, 2.0)
    assert given_scale("sweep", None, None, None, SCENARIO) is None
    (tmp_path / "broken.json").write_text("{")
    for numbers, source, words in (
        ((1.0, None), None, "sweep.j_med, sweep.j_max: got 1.0 and None, expected both or neither"),
        ((1.0, 2.0), "paper", "sweep.scale: got paper beside sweep.j_med"),
        ((None, None), "paper", "paper.yaml is for start"),
        ((None, None), str(tmp_path / "none"), "expected the folder of a finished study, a file, or one of paper"),
        ((None, None), str(tmp_path / "broken.json"), "holds no j_med and j_max"),
    ):
        with pytest.raises(ValueError, match=words):
            given_scale("sweep", *numbers, source, SCENARIO)
