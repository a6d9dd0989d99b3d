"""Grids, policies, statistics, and a small study from end to end."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hydra import compose, initialize_config_dir
from scipy import stats

from qocjax import Design, QocScale, Scenario, Study, evaluate, one_at_a_time, paper_network, qoc, run_study
from qocjax.commands.sweep_page import policy_text
from qocjax.config import conf_dir, load
from qocjax.config.codesign import CodesignConfig
from qocjax.config.study import StudyConfig
from qocjax.config.tune import TuneConfig
from qocjax.network.interface import exactly
from qocjax.statistics.scales import standing_still
from qocjax.study import POLICIES, SWEPT, Grid, estimate, paired, standard_error
from qocjax.study.edges import edges_of, edges_text
from qocjax.study.sweep import qoc_by_seed, results_table
from qocjax.tunables import DESIGN

SCENARIO = Scenario(start=[[-0.6, -0.5, 0.3], [-0.6, 0.5, 0.0]], goal=[1.0, 0.0], horizon=4.0)
BASE = Design(tau=0.1)
DEADLINES = [0.3, 0.1, 0.2, 0.4]
SWEEPS = {"kappa": [0.5, 2.0, 4.0], "gamma": [4.0, 2.0], "tau": [0.1, 0.2]}
SELECTION, EVALUATION = range(6), range(100, 108)
NAMES = list(DESIGN)


@pytest.fixture(scope="module")
def grid() -> Grid:
    return one_at_a_time(BASE, SWEEPS, DEADLINES)


@pytest.fixture(scope="module")
def study(grid: Grid) -> Study:
    return run_study(SCENARIO, grid, paper_network(), SELECTION, EVALUATION, key=2)


def test_sweeps_share_their_baseline(grid: Grid) -> None:
    assert len(grid.sweep) == (3 + 2 + 2) * 4
    assert len(grid.designs.tau) == (1 + 2 + 1 + 1) * 4  # the baseline once, and what differs from it
    columns = np.stack([getattr(grid.designs, name) for name in NAMES])
    assert np.unique(columns, axis=1).shape[1] == columns.shape[1]
    for row, (sweep, value, deadline, place) in enumerate(
        zip(grid.sweep, grid.value, grid.deadline, grid.design, strict=True)
    ):
        wanted = replace(BASE, **{sweep: value, "deadline": deadline})
        assert [getattr(grid.designs, n)[place] for n in NAMES] == [getattr(wanted, n) for n in NAMES], row
    for sweep, values in SWEEPS.items():
        rows = grid.rows(sweep)
        assert set(grid.sweep[rows].ravel()) == {sweep}
        np.testing.assert_array_equal(grid.value[rows], np.broadcast_to(np.sort(values)[:, None], (len(values), 4)))
        np.testing.assert_array_equal(grid.deadline[rows], np.broadcast_to(np.sort(DEADLINES), (len(values), 4)))
    assert set(SWEPT) == {"v_max", "eta", "tau", "kappa", "gamma", "c_miss"}


def test_policies_pick_what_they_say() -> None:
    scores = np.array([[0.1, 0.5, 0.3, 0.2], [0.2, 0.4, 0.6, 0.1], [0.05, 0.55, 0.6, 0.2]])
    reliability = np.array([0.0, 0.02, 0.5, 1.0])
    pick = {name: policy(scores, reliability, 0.01) for name, policy in POLICIES.items()}
    assert pick == {"Co-design": (1, 2), "MinDelay": (2, 1), "MaxRel": (0, 3)}  # of equals, the first
    assert POLICIES["MinDelay"](scores, reliability, 0.0) == (1, 0)  # the literal smallest
    assert POLICIES["MinDelay"](scores, reliability, 0.02) == (2, 1)
    assert POLICIES["MinDelay"](scores, reliability, 0.5) == (1, 2)
    with pytest.raises(ValueError, match="min_reliability"):
        POLICIES["MinDelay"](scores, reliability * 0.1, 0.5)
    scores[1, 2], scores[:, 3] = np.nan, [np.nan, 0.1, 0.2]
    assert {name: policy(scores, reliability, 0.01) for name, policy in POLICIES.items()} == {
        "Co-design": (2, 2), "MinDelay": (2, 1), "MaxRel": (2, 3),
    }  # fmt: skip


def test_no_policy_beats_co_design_where_it_chooses() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        scores, reliability = rng.random((4, 6)), np.sort(rng.random(6))
        best = {name: scores[policy(scores, reliability, 0.01)] for name, policy in POLICIES.items()}
        assert best["Co-design"] == scores.max() >= max(best["MinDelay"], best["MaxRel"])


def test_statistics_are_those_of_scipy() -> None:
    a, b = np.random.default_rng(1).normal(size=(2, 17)) + [[1.0], [0.3]]
    for confidence in (0.95, 0.9):
        got = estimate(a, confidence)
        low, high = stats.t.interval(confidence, 16, loc=a.mean(), scale=stats.sem(a))
        np.testing.assert_allclose([got.mean, got.se, got.low, got.high], [a.mean(), stats.sem(a), low, high])
        gap, test = paired(a, b, confidence), stats.ttest_rel(a, b).confidence_interval(confidence)
        np.testing.assert_allclose([gap.mean, gap.low, gap.high], [(a - b).mean(), test.low, test.high])
    np.testing.assert_allclose(standard_error(np.stack([a, b])), stats.sem(np.stack([a, b]), axis=1))
    np.testing.assert_allclose(standard_error(np.stack([a, b]), axis=0), stats.sem(np.stack([a, b]), axis=0))
    for call in (lambda: estimate([1.0]), lambda: standard_error(np.ones((3, 1))), lambda: paired(a, b[:5])):
        with pytest.raises(ValueError, match="seeds|others"):
            call()


def test_results_are_the_means_over_robots_then_seeds(study: Study, grid: Grid) -> None:
    results, runs = study.results, study.runs
    assert len(results) == len(grid.sweep) and not results.isna().any(axis=None)
    assert runs["seed"].values.tolist() == list(SELECTION)
    auc = runs["auc"].values.astype(float)
    assert (study.scale.median, study.scale.largest) == (np.median(auc), standing_still(SCENARIO))
    assert 0.0 < study.scale.median_se < 0.2 * study.scale.median
    by_seed = qoc(auc, study.scale).mean(axis=2)
    np.testing.assert_allclose(results["qoc"], by_seed.mean(axis=1)[grid.design])
    np.testing.assert_allclose(results["qoc_se"], stats.sem(by_seed, axis=1)[grid.design])
    np.testing.assert_allclose(results["auc_se"], stats.sem(auc.mean(axis=2), axis=1)[grid.design])
    np.testing.assert_allclose(results["reliability"], paper_network().reliability(grid.deadline).share)
    np.testing.assert_allclose(results["collision_share"], runs["collided"].mean("seed").values[grid.design])
    assert results["qoc"].between(0, 1, inclusive="right").all()
    for name in NAMES:
        np.testing.assert_array_equal(results[name], getattr(grid.designs, name)[grid.design])
    shared = results[(results["kappa"] == 2) & (results["gamma"] == 2) & (results["tau"] == 0.1)]
    assert len(shared) == 3 * 4 and shared.groupby("deadline")["qoc"].nunique().max() == 1


def test_normalised_auc_is_that_of_each_curve(study: Study, grid: Grid) -> None:
    """100 (S - min S) / (max S - min S) over the deadlines (paper, Eq. 22); what diverged is no end of the scale."""
    for _, curve in study.results.groupby(["sweep", "value"]):
        low, high = curve["auc"].min(), curve["auc"].max()
        np.testing.assert_allclose(curve["auc_normalised"], 100 * (curve["auc"] - low) / (high - low))
        assert (curve["auc_normalised"].min(), curve["auc_normalised"].max()) == (0.0, 100.0)
    runs = study.runs.copy(deep=True)
    lost = int(grid.design[(grid.sweep == "gamma") & (grid.value == 4.0)][0])
    flat = grid.design[(grid.sweep == "kappa") & (grid.value == 0.5)]
    runs["auc"][lost], runs["auc"][flat] = np.inf, 3.0
    table = results_table(runs, grid, exactly(np.ones(len(grid.designs.tau))), study.scale)
    own = table[(table["sweep"] == "gamma") & (table["value"] == 4.0)]["auc_normalised"]
    assert np.isinf(own).tolist() == [True, False, False, False] and (own.min(), own.iloc[1:].max()) == (0.0, 100.0)
    assert (table[(table["sweep"] == "kappa") & (table["value"] == 0.5)]["auc_normalised"] == 0).all()


def test_policies_are_chosen_on_some_seeds_and_judged_on_others(study: Study, grid: Grid) -> None:
    table = study.policies
    assert len(table) == 3 * 3 and not table.isna().any(axis=None)
    assert study.evaluation["seed"].values.tolist() == list(EVALUATION)
    for sweep, rows in table.groupby("sweep"):
        of_sweep = study.results[study.results["sweep"] == sweep]
        row = rows.set_index("policy").loc
        assert row["Co-design"]["qoc_selection"] == of_sweep["qoc"].max() >= rows["qoc_selection"].max()
        assert row["MaxRel"]["deadline"] == max(DEADLINES)
        assert row["MinDelay"]["deadline"] == min(DEADLINES)  # F(100 ms) = 2.3 %
        for name, limit in (("MaxRel", 0.4), ("MinDelay", 0.1)):
            there = of_sweep[of_sweep["deadline"] == limit]
            assert row[name]["value"] == there.loc[there["qoc"].idxmax(), "value"]
        scores = {}
        for name, choice in rows.set_index("policy").iterrows():
            design = replace(BASE, **{sweep: choice["value"], "deadline": choice["deadline"]})
            again = evaluate(SCENARIO, design, paper_network(), EVALUATION, key=2)
            scores[name] = qoc_by_seed(again, study.scale)[0]
            wanted = estimate(scores[name])
            found = choice[["qoc", "qoc_se", "qoc_low", "qoc_high"]].astype(float)
            np.testing.assert_allclose(found, [wanted.mean, wanted.se, wanted.low, wanted.high], rtol=1e-4)
        gap = paired(scores["MaxRel"], scores["Co-design"])
        found = row["MaxRel"][["difference", "difference_low", "difference_high"]].astype(float)
        np.testing.assert_allclose(found, [gap.mean, gap.low, gap.high], atol=1e-4)
        assert row["Co-design"]["difference"] == row["Co-design"]["difference_se"] == 0


def test_choices_at_an_end_of_what_was_tried_are_said_to_be_there(study: Study) -> None:
    for row in study.policies.to_dict("records"):
        ends = {row["sweep"]: (row["value"], SWEEPS[row["sweep"]])}
        ends |= {"deadline": (row["deadline"], DEADLINES)} if row["policy"] == "Co-design" else {}
        wanted = [f"{'smallest' if each == min(tried) else 'largest'} {name}" for name, (each, tried) in ends.items()
                  if each in (min(tried), max(tried))]  # fmt: skip
        assert row["at_edge"] == ", ".join(wanted), row
    assert any(study.policies["at_edge"])
    rows = pd.DataFrame({"sweep": "eta", "value": [0.0, 1.0, 2.0], "deadline": 0.1})
    assert edges_of(rows, {"value": 2.0, "deadline": 0.1}, "Co-design") == "largest eta"  # one deadline has no end
    assert edges_of(rows, {"value": np.nan, "deadline": np.nan}, "Co-design") == ""
    marked = study.policies.iloc[:2].assign(at_edge=["largest kappa, smallest deadline", ""])
    assert edges_text(marked).endswith("beyond: largest kappa (Co-design); smallest deadline in kappa (Co-design)")
    assert edges_text(marked.iloc[1:]) == ""


def test_the_table_of_a_terminal_has_auc_and_collisions_in_120_columns(study: Study) -> None:
    lines = policy_text(study.policies).splitlines()
    assert max(map(len, lines)) < 120
    for line, row in zip(lines[1:], study.policies.to_dict("records"), strict=False):
        assert f"{row['auc']:.3f} ± {row['auc_se']:.3f}" in line
        assert f" {row['collision_share']:.1%} [" in line and line.rstrip().endswith("]")
        assert ("*" in line) == bool(row["at_edge"])


def test_a_scale_that_is_given_is_used() -> None:
    scale = QocScale(1.0, 3.0)
    small = one_at_a_time(BASE, {"kappa": [1.0]}, [0.2, 0.3])
    study = run_study(SCENARIO, small, paper_network(), [0, 1], [2, 3], scale=scale, min_reliability=0.9)
    assert study.scale == scale
    np.testing.assert_allclose(study.results["qoc"], qoc_by_seed(study.runs, scale).mean(axis=1))
    assert study.policies.set_index("policy").loc["MinDelay", "deadline"] == 0.3  # F(200 ms) = 50 %


def test_one_robot_has_no_distance_and_no_gap_in_its_table() -> None:
    alone = Scenario(start=[[-0.6, 0, 0.3]], goal=[1.0, 0.0], horizon=4.0, normaliser="goal_distance")
    study = run_study(alone, one_at_a_time(BASE, {"kappa": [1.0]}, [0.2]), paper_network(), [0, 1], [2, 3])
    assert not study.results.isna().any(axis=None) and not study.policies.isna().any(axis=None)
    assert study.results["min_distance"].item() == study.results["min_distance_se"].item() == np.inf
    assert study.results["collision_share"].item() == 0 and np.isfinite(study.results["auc_se"].item())


def test_a_demand_on_reliability_that_nothing_meets_is_refused_before_the_simulation() -> None:
    small = one_at_a_time(BASE, {"kappa": [1.0]}, [0.1, 0.2])
    done: list[int] = []
    with pytest.raises(ValueError, match="min_reliability"):
        run_study(SCENARIO, small, paper_network(), [0, 1], [2, 3], min_reliability=0.9, progress=done.append)
    assert not done


def test_arrivals_and_diverged_runs_in_the_table(study: Study) -> None:
    small = one_at_a_time(BASE, {"kappa": [1.0]}, [0.2])
    runs = study.runs.isel(design=[0], seed=slice(4)).assign_coords(deadline=("design", [0.2]))
    time = np.array([[[1.0, 3.0], [2.0, 1.0], [np.inf, 1.0], [4.0, 1.0]]])
    runs["arrival_time"] = (("design", "seed", "robot"), time)
    auc = np.array([[[1.0, 3.0], [2.0, np.nan], [np.inf, 1.0], [4.0, 1.0]]])
    runs["auc"] = (("design", "seed", "robot"), auc)
    share = paper_network().reliability(small.designs.deadline)
    row = results_table(runs, small, share, QocScale.of(auc)).iloc[0]
    assert (row["arrived_share"], row["arrival_time"]) == (0.75, 3.0)
    np.testing.assert_allclose(row["arrival_time_se"], stats.sem([3.0, 2.0, 4.0]))
    assert row["diverged_share"] == 0.5
    scores = qoc_by_seed(runs, QocScale.of(auc))[0]  # J_med 1.5 s, J_max 4 s: a diverged robot counts as J_max
    np.testing.assert_allclose(scores[1], (1 / (1 + 2 / 1.5) + 1 / (1 + 4 / 1.5)) / 2)
    runs["arrival_time"] = xr.full_like(runs["arrival_time"], np.inf)
    assert results_table(runs, small, share, QocScale.of(auc)).iloc[0]["arrival_time"] == np.inf


def test_grids_and_bounds_end_at_what_the_robot_can_do() -> None:
    def made(command: str, model: type, *options: str) -> Any:
        return load(model, compose(command, ["robot=turtlebot3_burger", *options]))

    with initialize_config_dir(str(conf_dir().resolve()), version_base="1.3"):
        sweep = made("sweep", StudyConfig, "sweep=v_max")
        assert set(sweep.build_grid().value.tolist()) == {0.2}
        assert sweep.beyond() == ["sweep.grids.v_max: 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1, 1.2, 1.5 left out, more than "
                                  "the robot's 0.22"]  # fmt: skip
        free = made("sweep", StudyConfig, "sweep=v_max", "robot.v_limit=null")
        assert len(set(free.build_grid().value.tolist())) == 10 and not free.beyond()
        tuned = made("tune", TuneConfig, "tune.wrt=[v_max,kappa]").build_bounds()
        assert tuned.high.tolist() == [0.22, 8.0]
        space = made("codesign", CodesignConfig).build_space()
        assert space.bounds["v_max"][1] == 0.22
        for command, model, option, words in (
            (
                "sweep",
                StudyConfig,
                "sweep.grids.v_max=[0.5]",
                r"sweep.grids.v_max: got \[0.5\], expected some up to 0.22",
            ),
            ("sweep", StudyConfig, "robot.v_max=0.3", "robot.v_max: got 0.3, expected at most robot.v_limit, 0.22"),
        ):
            with pytest.raises(ValueError, match=words):
                made(command, model, option).build_grid()
        with pytest.raises(ValueError, match="below the robot's 0.22"):
            made("tune", TuneConfig, "tune.wrt=[v_max]", "tune.bounds.v_max=[0.3,1]").build_bounds()
