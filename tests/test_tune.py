"""Tuning by gradients: bounds, estimators against each other and against differences, the search, its judgement."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import optax
import pandas as pd
import pytest
from hydra import compose, initialize_config_dir

from qocjax import Design, QocScale, Scenario, gradient, paper_network
from qocjax.commands.tune import design_text, landscape, run
from qocjax.config import conf_dir, load
from qocjax.config.tune import TuneConfig
from qocjax.figures.gradients import gradient_errors
from qocjax.figures.tuning import tuning_map, tuning_progress
from qocjax.search.objective import Objective
from qocjax.tunables import CONTINUOUS
from qocjax.tuning import (
    DEFAULT_BOUNDS,
    ESTIMATORS,
    Bounds,
    Pathwise,
    Problem,
    Search,
    Slopes,
    Smoothed,
    Tuning,
    make_estimator,
    search,
    spread_starts,
    tune,
)
from qocjax.tuning.estimators import clipped, mean, median_of_means

SCENARIO = Scenario(start=[[-0.6, -0.5, 0.3], [-0.6, 0.5, 0.0]], goal=[1.0, 0.0], horizon=3.0)
BASE = Design(tau=0.1)
GAINS = Bounds(("kappa", "gamma"))
SCALE = QocScale(1.5, 50.0)


def a_problem(bounds: Bounds = GAINS, deadlines: Any = (0.2, 0.4), scale: QocScale = SCALE) -> Problem:
    return Problem(Objective(SCENARIO, paper_network(), scale), BASE, bounds, np.array(deadlines))


class Hill(Problem):
    """A problem with a known gradient: Q = q(u) + noise of the seed, and derivatives by seed with heavy tails."""

    peak = np.array([0.7, -0.4])

    def scores(self, free: np.ndarray, seeds: Any) -> np.ndarray:
        self.objective.simulations += int(np.prod(np.shape(free)[:-1])) * len(seeds)
        noise = np.array([np.random.default_rng(s).normal(0, 0.1) for s in seeds])
        return (1.0 - 0.1 * ((free - self.peak) ** 2).sum(axis=-1))[..., None] + noise

    def pathwise(self, free: np.ndarray, seeds: Any) -> tuple[np.ndarray, np.ndarray]:
        tails = np.stack([np.random.default_rng(s).standard_cauchy(2) for s in seeds])
        return self.scores(free, seeds), (-0.2 * (free - self.peak))[:, None] + 0.1 * tails


def a_hill() -> Hill:
    return Hill(Objective(SCENARIO, paper_network(), SCALE), BASE, GAINS, np.array([0.2, 0.3, 0.4]))


# Bounds


@pytest.mark.parametrize("names", [CONTINUOUS, ("gamma", "kappa"), ("eta",)])
def test_bijection_goes_there_and_back_within_its_bounds(names: tuple[str, ...]) -> None:
    bounds = Bounds(names)
    free = np.random.default_rng(0).normal(0, 2, (50, len(names)))
    values = bounds.values(free)
    assert ((values > bounds.low) & (values < bounds.high)).all()
    np.testing.assert_allclose(bounds.free(values), free, rtol=1e-9, atol=1e-9)
    ends = bounds.values(np.array([[-1e3] * len(names), [1e3] * len(names)]))
    np.testing.assert_allclose(ends, [bounds.low, bounds.high])
    h = 1e-6
    np.testing.assert_allclose(
        bounds.slopes(free), (bounds.values(free + h) - bounds.values(free - h)) / (2 * h), rtol=1e-6, atol=1e-12
    )


def test_scale_is_logarithmic_where_positive_and_linear_from_zero() -> None:
    assert Bounds(("kappa",), {"kappa": [0.5, 8.0]}).values(np.zeros(1)) == pytest.approx(2.0)  # geometric mean
    assert Bounds(("eta",), {"eta": [0.0, 2.0]}).values(np.zeros(1)) == pytest.approx(1.0)  # arithmetic
    assert set(DEFAULT_BOUNDS) == set(CONTINUOUS)


@pytest.mark.parametrize(
    ("names", "given", "message"),
    [
        ((), {}, "wrt: got"),
        (("kappa", "kappa"), {}, "each once"),
        (("tau",), {}, "wrt: got 'tau'"),
        (("kappa",), {"kapa": [1, 2]}, "bounds: got 'kapa'"),
        (("kappa",), {"kappa": [2.0, 1.0]}, r"bounds.kappa: got \[2, 1\], expected low < high"),
        (("kappa",), {"kappa": [1.0]}, r"bounds.kappa: .* expected \[low, high\]"),
        (("eta",), {"eta": [-1.0, 1.0]}, "bounds.eta: .* >= 0"),
        (("v_max",), {"v_max": [0.0, 1.0]}, "bounds.v_max: .* > 0"),
        (("eta",), {"eta": [0.0, np.inf]}, "bounds.eta: .* finite"),
    ],
)
def test_bad_bounds_are_named(names: tuple[str, ...], given: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Bounds(names, given)


def test_a_value_outside_its_bounds_has_no_free_coordinate() -> None:
    with pytest.raises(ValueError, match=r"gamma: got 9, expected a value between its bounds 0.25 and 8"):
        GAINS.free(np.array([2.0, 9.0]))


def test_a_start_is_moved_within_its_bounds_only_if_need_be() -> None:
    moved = GAINS.values(GAINS.nearest(np.array([[2.0, 3.0], [9.0, 0.25]])))
    np.testing.assert_allclose(moved, [[2.0, 3.0], [8.0 / 32**0.01, 0.25 * 32**0.01]])
    np.testing.assert_allclose(Bounds(("eta",)).values(Bounds(("eta",)).nearest(np.zeros(1))), 0.02)


# Estimators


def test_pathwise_is_the_derivative_of_the_score() -> None:
    problem, seeds = a_problem(), range(6)
    free = GAINS.free(np.array([[2.0, 2.0], [1.0, 3.0]]))
    scores, slopes = problem.pathwise(free, seeds)
    np.testing.assert_allclose(scores, problem.scores(free, seeds), rtol=1e-5)
    h = 1e-3  # float32 runs: the step is chosen for rounding
    for k in range(2):
        step = h * np.eye(2)[k]
        fd = (problem.scores(free + step, seeds) - problem.scores(free - step, seeds)) / (2 * h)
        np.testing.assert_allclose(np.median(slopes[..., k] - fd), 0.0, atol=2e-3)


@pytest.mark.slow
def test_pathwise_in_the_free_coordinates_is_the_gradient_by_the_chain_rule() -> None:
    seeds, free = range(6), GAINS.free(np.array([[2.0, 2.0], [1.0, 3.0]]))
    problem = a_problem()
    runs = gradient(SCENARIO, problem.designs(free), paper_network(), seeds)
    one = Problem(Objective(SCENARIO, paper_network(), QocScale(1e9, 1e12)), BASE, GAINS, problem.deadlines)
    _, flat = one.pathwise(free, seeds)  # Q is linear there: dQ/dJ = -1e-9
    wanted = np.stack([runs["d_auc_kappa"], runs["d_auc_gamma"]], axis=-1) * GAINS.slopes(free)[:, None]
    np.testing.assert_allclose(-1e9 * flat, wanted, rtol=1e-3, atol=1e-4)


def test_beyond_the_largest_auc_qoc_is_flat() -> None:
    _, slopes = a_problem(scale=QocScale(1.0, 1e-3)).pathwise(np.zeros((2, 2)), range(6))
    np.testing.assert_array_equal(slopes, 0.0)


def test_smoothed_is_exact_on_a_quadratic_whatever_its_width() -> None:
    hill, free = a_hill(), np.array([[0.0, 0.0], [1.0, 1.0], [0.7, -0.4]])
    for width in (0.1, 1.0):
        found = Smoothed()(hill, free, range(5), np.random.default_rng(3), width)
        np.testing.assert_allclose(found.gradient, -0.2 * (free - hill.peak), atol=1e-12)
        np.testing.assert_allclose(found.variance, 0.0, atol=1e-20)  # common random numbers: the noise cancels
    assert hill.objective.simulations == 2 * 3 * 4 * 5


def test_simulations_are_counted_with_their_tangents() -> None:
    problem = a_problem()
    Pathwise()(problem, np.zeros((2, 2)), range(6), np.random.default_rng(0), 0.1)
    assert problem.objective.simulations == 2 * 6 * 3
    Smoothed()(problem, np.zeros((2, 2)), range(6), np.random.default_rng(0), 0.1)
    assert problem.objective.simulations == 2 * 6 * 3 + 2 * 6 * 4


def test_robust_means_and_blend_withstand_heavy_tails() -> None:
    hill, free = a_hill(), np.zeros((3, 2))
    exact = -0.2 * (free - hill.peak)

    def error(name: str) -> float:
        rng = np.random.default_rng(0)
        found = [make_estimator(name)(hill, free, range(k, k + 32), rng, 0.3).gradient for k in range(0, 1600, 32)]
        return float(np.sqrt(np.mean((np.stack(found) - exact) ** 2)))

    plain = error("pathwise")
    assert error("clipped") < 0.3 * plain
    assert error("median_of_means") < 0.3 * plain
    assert error("blend") < 0.01 * plain  # the smoothed one has no variance here


def test_combinations_agree_where_nothing_is_extreme() -> None:
    slopes = np.random.default_rng(1).normal(2.0, 0.01, (64, 3))
    for combine in (mean, lambda s: clipped(s, 100.0), median_of_means):
        found, variance = combine(slopes)
        np.testing.assert_allclose(found, 2.0, atol=0.01)
        np.testing.assert_allclose(np.sqrt(variance), 0.01 / 8, rtol=0.8)
    np.testing.assert_array_equal(clipped(np.zeros((4, 2)))[0], 0.0)
    spiked = np.vstack([np.ones((9, 1)), [[1e6]]])
    np.testing.assert_allclose(clipped(spiked)[0], 1.1)  # the outlier counts for two


class Broken(Hill):
    good = 3

    def pathwise(self, free: np.ndarray, seeds: Any) -> tuple[np.ndarray, np.ndarray]:
        scores, slopes = super().pathwise(free, seeds)
        slopes[1, self.good :, 0] = np.nan
        return scores, slopes


def test_derivatives_that_are_not_finite_are_dropped_and_counted() -> None:
    broken = Broken(Objective(SCENARIO, paper_network(), SCALE), BASE, GAINS, np.array([0.2, 0.3, 0.4]))
    for name in ("pathwise", "clipped", "median_of_means", "blend"):
        found = ESTIMATORS[name](broken, np.zeros((3, 2)), range(8), np.random.default_rng(0), 0.3)
        assert found.dropped == 5 and np.isfinite(found.gradient).all() and np.isfinite(found.variance).all()
    broken.__class__.good = 1
    try:
        with pytest.raises(ValueError, match=r"finite derivatives in 1 of 8 runs at kappa=1.414.*deadline=0.3 s"):
            Pathwise()(broken, np.zeros((3, 2)), range(8), np.random.default_rng(0), 0.3)
    finally:
        broken.__class__.good = 3


def test_an_unknown_estimator_is_named() -> None:
    with pytest.raises(ValueError, match="estimator: got 'exact', expected one of pathwise"):
        make_estimator("exact")


# Search


def test_search_climbs_a_hill_from_all_starts_on_new_seeds_in_each_step() -> None:
    hill = a_hill()
    start = np.array([[-3.0, 3.0], [0.0, 0.0], [3.0, 3.0]])
    trail = search(hill, start, Search(optax.adam(0.2), steps=80, patience=0), 7)
    np.testing.assert_allclose(trail.result, np.tile(hill.peak, (3, 1)), atol=0.1)
    assert len(trail.table) == 80 * 3 and not trail.stopped_early and trail.dropped == 0
    assert np.isfinite(trail.table.to_numpy(float)).all()
    np.testing.assert_allclose(trail.table[["kappa", "gamma"]].to_numpy()[1], GAINS.values(np.zeros(2)))
    assert trail.table["simulations"].iloc[-1] == hill.objective.simulations == 80 * 3 * 4 * 16
    noise = trail.table.query("point == 0")["qoc"].to_numpy()[-10:]
    assert np.std(noise) > 0.005  # each step has other seeds


def test_search_stops_where_nothing_is_gained() -> None:
    hill = a_hill()
    start = np.tile(hill.peak, (3, 1))
    settings = Search(optax.sgd(1e-6), steps=60, width=0.1, last_width=0.1, patience=5, tolerance=1.0)
    trail = search(hill, start, settings, 0)
    assert trail.stopped_early and trail.table["step"].max() == 9
    assert not search(hill, start, replace(settings, patience=0), 0).stopped_early
    assert search(hill, start, replace(settings, tolerance=0.0), 0).stopped_early  # what is gained is noise
    climbing = search(hill, start - 4.0, replace(settings, rule=optax.sgd(0.2), tolerance=0.0), 0)
    assert climbing.table["step"].max() > 20 and climbing.stopped_early


def test_where_qoc_has_settled_the_width_is_halved_before_the_search_stops() -> None:
    widths: list[float] = []

    class Watched(Smoothed):
        def __call__(self, problem: Problem, free: np.ndarray, seeds: Any, rng: Any, width: float) -> Slopes:
            widths.append(width)
            return super().__call__(problem, free, seeds, rng, width)

    settings = Search(optax.sgd(1e-6), Watched(), steps=999, width=0.4, last_width=0.1, patience=5, tolerance=1.0)
    hill = a_hill()
    trail = search(hill, np.tile(hill.peak, (3, 1)), settings, 0)
    assert trail.stopped_early and len(widths) == 30
    assert widths[0] == 0.4 and widths[10] == pytest.approx(0.2, rel=0.02) and widths[29] == 0.1
    pathwise = search(hill, np.tile(hill.peak, (3, 1)), replace(settings, estimator=Pathwise()), 0)
    assert pathwise.stopped_early and pathwise.table["step"].max() == 9  # nothing to narrow


def test_widths_shrink_by_equal_ratios() -> None:
    settings = Search(optax.sgd(1.0), steps=5, width=1.6, last_width=0.1)
    np.testing.assert_allclose([settings.width_at(k) for k in range(5)], [1.6, 0.8, 0.4, 0.2, 0.1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"steps": 0}, "steps: got 0"),
        ({"seeds": 1}, "seeds: got 1"),
        ({"width": 0.0}, "width: got 0.0"),
        ({"last_width": -1.0}, "last_width"),
        ({"average": 1.5}, "average"),
        ({"patience": -1}, "patience"),
        ({"tolerance": -1.0}, "tolerance"),
    ],
)
def test_bad_settings_are_named(change: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Search(optax.sgd(1.0), **change)


def test_starts_are_spread_evenly_within_the_bounds() -> None:
    values = GAINS.values(spread_starts(4000, GAINS, np.random.default_rng(0)))
    share = np.log(values / GAINS.low) / np.log(GAINS.high / GAINS.low)
    assert share.min() > 0.0499 and share.max() < 0.9501
    np.testing.assert_allclose(np.quantile(share, [0.25, 0.5, 0.75], axis=0).T, [[0.275, 0.5, 0.725]] * 2, atol=0.03)


# From end to end


@pytest.fixture(scope="module")
def tuning() -> Tuning:
    settings = Search(optax.adam(0.3), steps=12, seeds=8, patience=0)
    objective = Objective(SCENARIO, paper_network(), SCALE)
    return tune(
        objective, BASE, GAINS, [0.4, 0.2], settings, starts=2, selection_seeds=range(8), evaluation_seeds=range(50, 70)
    )


def test_all_deadlines_and_starts_are_judged_on_fresh_seeds(tuning: Tuning) -> None:
    table = tuning.designs
    assert table["deadline"].tolist() == [0.2, 0.2, 0.4, 0.4] and table["start"].tolist() == [0, 1, 0, 1]
    assert not table.isna().any().any() and not tuning.trace.isna().any().any()
    assert table["chosen"].sum() == 1 and tuning.chosen.name == table["qoc_selection"].idxmax()
    free = GAINS.free(table[["kappa", "gamma"]].to_numpy())
    again = tuning.problem.scores(free, range(50, 70))
    np.testing.assert_allclose(table["qoc"], again.mean(axis=1), rtol=1e-6)
    gaps = again - again[tuning.chosen.name]
    np.testing.assert_allclose(table["difference"], gaps.mean(axis=1), atol=1e-9)
    assert (table["tied"] == ((table["difference_low"] <= 0) & (table["difference_high"] >= 0))).all()
    assert table.loc[table["chosen"], "tied"].all()
    untuned = tuning.problem.objective.scores(replace(BASE, deadline=np.array([0.2, 0.4])), range(50, 70))
    np.testing.assert_allclose(table["gain"], again.mean(axis=1) - np.repeat(untuned.mean(axis=1), 2), atol=1e-7)


def test_the_first_start_is_the_baseline_and_the_work_is_counted(tuning: Tuning) -> None:
    first = tuning.trace.query("step == 0 and start == 0")
    np.testing.assert_allclose(first[["kappa", "gamma"]], [[2.0, 2.0]] * 2, rtol=1e-5)
    assert tuning.simulations == {"search": 12 * 4 * 4 * 8, "selection": 4 * 8, "evaluation": 4 * 20 + 2 * 20}


def test_tuning_gains_over_the_baseline(tuning: Tuning) -> None:
    assert tuning.chosen["gain_low"] > 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"deadlines": []}, "deadline"),
        ({"deadlines": [0.2, 0.2]}, "each once"),
        ({"starts": 0}, "starts: got 0"),
        ({"selection_seeds": range(1)}, "selection_seeds: got 1 seeds"),
        ({"evaluation_seeds": range(2, 9)}, "evaluation_seeds: got 2 in both"),
    ],
)
def test_bad_input_is_named_before_anything_is_simulated(change: dict, message: str) -> None:
    objective = Objective(SCENARIO, paper_network(), SCALE)
    args: dict[str, Any] = {
        "baseline": BASE, "bounds": GAINS, "deadlines": [0.2], "settings": Search(optax.sgd(1.0)),
        "selection_seeds": range(4), "evaluation_seeds": range(10, 14),
    } | change  # fmt: skip
    with pytest.raises(ValueError, match=message):
        tune(objective, **args)
    assert objective.simulations == 0


def test_figures_show_the_paths_and_their_ends(tuning: Tuning) -> None:
    table = landscape(tuning, np.array([0.2, 0.4]), 4, range(3))
    assert len(table) == 2 * 16 and not table.isna().any().any()
    figure = tuning_map(table, tuning.trace, tuning.designs)
    panel = figure.axes[0]
    first = tuning.trace.query("deadline == 0.2 and start == 0")
    np.testing.assert_allclose(panel.lines[0].get_xdata(), first["kappa"])
    stars = next(line for line in panel.lines if line.get_marker() == "*")
    np.testing.assert_allclose(stars.get_ydata(), tuning.designs.query("deadline == 0.2")["gamma"])
    assert len(tuning_progress(tuning.trace).axes[0].lines) == 2
    with pytest.raises(ValueError, match="column 'qoc_se' is missing"):
        tuning_progress(tuning.trace.drop(columns="qoc_se"))


def test_a_figure_of_gradient_errors_holds_its_table() -> None:
    row = {"deadline": 0.1, "parameter": "kappa", "truth": 2.0, "bias_se": 0.2, "sign_agreement": 0.9}
    table = pd.DataFrame(
        [row | {"horizon": h, "estimator": e, "bias": b, "spread": 3.0 * b} for h, e, b in
         [(5.0, "a", 1.0), (30.0, "a", 4.0), (5.0, "b", 0.2), (30.0, "b", 0.4)]]
    )  # fmt: skip
    bias, spread, signs = gradient_errors(table).axes
    np.testing.assert_allclose(bias.lines[0].get_ydata(), [0.5, 2.0])
    hollow = [line for line in bias.lines if line.get_markerfacecolor() == "w"]
    assert [line.get_ydata().tolist() for line in hollow] == [[], [0.1]]  # below two standard errors
    np.testing.assert_allclose(spread.lines[1].get_ydata(), [0.3, 0.6])
    np.testing.assert_allclose(signs.lines[0].get_ydata(), [0.9, 0.9])
    with pytest.raises(ValueError, match="column 'spread' is missing"):
        gradient_errors(table.drop(columns="spread"))


# Command line

SMALL = [
    "scenario.horizon=3", "loop.tau=0.1", "tune.deadline_ms=[200,300]", "tune.steps=3", "tune.step_seeds=4",
    "tune.starts=2", "tune.seeds=4", "tune.evaluation_seeds=6", "tune.landscape=3",
]  # fmt: skip


def a_config(*overrides: str) -> TuneConfig:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return load(TuneConfig, compose("tune", overrides=[*SMALL, *overrides]))


@pytest.mark.parametrize("spelling", ["tune.bounds.kappa=[0.5,4]", "tune.bounds={kappa: [0.5, 4.0]}"])
def test_bounds_are_given_by_name_and_the_others_are_those_of_the_library(spelling: str) -> None:
    bounds = a_config(spelling).build_bounds()
    np.testing.assert_array_equal([bounds.low, bounds.high], [[0.5, 0.25], [4.0, 8.0]])
    every = {name: tuple(pair) for name, pair in a_config().tune.bounds.items()}
    assert every == DEFAULT_BOUNDS


@pytest.mark.parametrize("optimiser", ["adam", "sgd"])
@pytest.mark.parametrize("schedule", ["constant", "cosine", "exponential"])
def test_rates_follow_the_schedule(optimiser: str, schedule: str) -> None:
    part = a_config(f"optimiser={optimiser}", f"optimiser.schedule={schedule}").optimiser
    rates = part.rates(100)
    last = part.rate if schedule == "constant" else part.last_rate
    np.testing.assert_allclose([rates(0), rates(100)], [part.rate, last], rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["smoothed", "blend"])
def test_all_parameters_may_be_tuned_with_any_estimator(estimator: str) -> None:
    config = a_config("tune.wrt=[v_max,omega_max,eta,kappa,gamma,c_miss,d_safe]", f"tune.estimator={estimator}",
                      "tune.steps=2", "optimiser=sgd")  # fmt: skip
    found = run(config, quiet=True)
    assert not found.designs.isna().any().any()
    bounds = found.problem.bounds
    values = found.designs[list(bounds.names)].to_numpy()
    assert ((values >= bounds.low) & (values <= bounds.high)).all()
    assert "Co-design" in design_text(found)


@pytest.mark.parametrize(
    ("build", "overrides", "message"),
    [
        (TuneConfig.build_search, ["optimiser.schedule=linear"], "optimiser.schedule: got 'linear'"),
        (TuneConfig.build_search, ["optimiser.rate=0.0"], "optimiser.rate"),
        (TuneConfig.build_search, ["optimiser.b2=1.0"], "optimiser.b2"),
        (TuneConfig.build_search, ["tune.estimator=best"], "estimator: got 'best'"),
        (TuneConfig.build_search, ["tune.steps=0"], "tune.steps: got 0"),
        (TuneConfig.build_bounds, ["tune.bounds.eta=[0,1]"], r"tune.bounds.eta: got \[0.0, 1.0\], .* eta is not tuned"),
        (TuneConfig.build_bounds, ["tune.bounds.kappa=[3]"], r"bounds.kappa: got \[3.0\], expected \[low, high\]"),
        (TuneConfig.build_bounds, ["tune.wrt=[tau]"], "tune.wrt: got tau, expected one of v_max, "),
        (TuneConfig.deadlines, ["tune.deadline_ms=[]"], r"tune.deadline_ms: got \[\]"),
        (TuneConfig.deadlines, ["tune.deadline_ms=[100,100]"], "each once"),
        (TuneConfig.deadlines, ["tune.deadline_ms=[-100]"], "tune.deadline_ms"),
        (TuneConfig.seeds, ["tune.seeds=1"], "tune.seeds: got 1"),
        (TuneConfig.scale, ["tune.j_med=1.0"], "expected both or neither"),
    ],
)
def test_bad_options_are_named(build: Callable, overrides: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build(a_config(*overrides))


def test_command_line_writes_tables_figures_and_a_record(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "qocjax.tune", *SMALL]
    done = subprocess.run([*command, f"hydra.run.dir={tmp_path}"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Co-design" in done.stdout and done.stderr == ""
    for name in ("designs.csv", "trace.csv", "record.json", "config.yaml", "figures/map.png", "figures/progress.pdf"):
        assert (tmp_path / name).stat().st_size > 0
    assert len(pd.read_csv(tmp_path / "trace.csv")) == 3 * 2 * 2
    bad = subprocess.run([*command, "tune.bounds.kappa=[3,2]", f"hydra.run.dir={tmp_path}/bad"],
                         capture_output=True, text=True, check=False)  # fmt: skip
    assert bad.returncode == 2
    assert bad.stderr == "error: tune.bounds.kappa: got [3.0, 2.0], expected [low, high] with low < high, or null\n"


def test_slopes_hold_what_the_trace_reports(tuning: Tuning) -> None:
    seen: list[Slopes] = []
    hill = a_hill()
    trail = search(hill, np.zeros((3, 2)), Search(optax.sgd(0.1), steps=2, patience=0), 0, seen.append)
    np.testing.assert_array_equal(trail.table["qoc"], np.concatenate([s.qoc for s in seen]))
    np.testing.assert_array_equal(trail.table["slope_gamma"], np.concatenate([s.gradient[:, 1] for s in seen]))
    assert set(trail.table.columns) - {"point"} == set(tuning.trace.columns) - {"start"}
