"""Validation: curves, their agreement, regimes, intervals; where E comes from; fitted gains; the command."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pandas as pd
import pytest
from bags import AMCL, STAMPED, Message, pose, stamped, write_bag
from hydra import compose, initialize_config_dir
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

import qocjax
from qocjax import Design, Scenario, paper_network
from qocjax.commands.validate import Outcome, report, run
from qocjax.config import conf_dir, load
from qocjax.config.validate import ValidateConfig
from qocjax.network.interface import exactly
from qocjax.network.schedule import Rules
from qocjax.validation import (
    REGIMES,
    Curve,
    Grouping,
    Setting,
    agreement,
    boundaries,
    common,
    compare,
    curve_of_csv,
    fit,
    halves,
    judge_gains,
    kendall,
    normalised,
    regimes,
    resample,
    rmse,
    simulated_curve,
    spearman,
)

ROOT = Path(__file__).parents[1]
DELAYS = np.array([0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8])
SHAPE = np.array([20.0, 9.0, 4.0, 3.5, 3.3, 4.2, 6.0])


def curve(values: np.ndarray, spread: float = 0.0, seed: int = 0, count: int = 16) -> Curve:
    """A curve of these means, its repetitions spread about them."""
    noise = np.random.default_rng(seed).normal(0.0, spread, (len(values), count))
    return Curve.of_table(DELAYS[: len(values)], values[:, None] + noise, range(count))


# Mathematics of curves


def test_equal_curves_agree_without_error_whatever_their_noise() -> None:
    same = curve(SHAPE, 0.5)
    found = agreement(same, same)
    assert found.paired
    assert (found.rmse.value, found.rmse.low, found.rmse.high, found.noise) == (0.0, 0.0, 0.0, 0.0)
    assert (found.rmse_log.value, found.rmse_log.high) == (0.0, 0.0)
    for rank in (found.spearman, found.kendall):
        assert (rank.value, rank.low, rank.high) == pytest.approx((1.0, 1.0, 1.0))


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.integers(1, 100), min_size=3, max_size=12, unique=True),
    st.floats(0.1, 50.0),
    st.floats(-50.0, 50.0, allow_subnormal=False),
)
def test_an_affine_transform_changes_neither_scale_nor_ranks_nor_regimes(
    values: list[int], factor: float, offset: float
) -> None:
    array = np.array(values, float)
    moved = factor * array + offset
    np.testing.assert_allclose(normalised(moved), normalised(array), atol=1e-6)
    assert (normalised(array).min(), normalised(array).max()) == (0.0, 100.0)
    assert float(rmse(array, moved)) == pytest.approx(0.0, abs=1e-6)
    axis = np.arange(array.size) / 10
    for own, other in zip(boundaries(axis, array[None]), boundaries(axis, moved[None]), strict=True):
        np.testing.assert_allclose(own, other, atol=1e-6)


def test_curves_turned_over_are_ranked_against_each_other() -> None:
    assert float(spearman(SHAPE, -SHAPE)) == pytest.approx(-1.0)
    assert float(kendall(SHAPE, -SHAPE)) == pytest.approx(-1.0)
    assert float(rmse(SHAPE, -SHAPE)) == pytest.approx(np.sqrt(np.mean((2 * normalised(SHAPE) - 100) ** 2)))


@pytest.mark.parametrize("ties", [False, True])
def test_rank_correlations_are_those_of_scipy(ties: bool) -> None:
    rng = np.random.default_rng(5)
    both = rng.integers(0, 4, (2, 50, 9)).astype(float) if ties else rng.normal(size=(2, 50, 9))
    for k in range(50):
        assert float(spearman(both[0, k], both[1, k])) == pytest.approx(stats.spearmanr(both[0, k], both[1, k])[0])
        assert float(kendall(both[0, k], both[1, k])) == pytest.approx(stats.kendalltau(both[0, k], both[1, k])[0])
    np.testing.assert_allclose(spearman(*both)[7], spearman(both[0, 7], both[1, 7]))


def test_a_flat_curve_has_no_scale() -> None:
    with pytest.raises(ValueError, match="got 3 s at all 7 delays, expected a curve that varies"):
        normalised(np.full(7, 3.0))


def test_common_delays_are_those_of_both() -> None:
    one, other = curve(SHAPE), Curve(DELAYS[1:], tuple(SHAPE[1:, None] + np.zeros((6, 2))), None)
    first, second = common(one, other)
    np.testing.assert_array_equal(first.delays, DELAYS[1:])
    np.testing.assert_array_equal(second.mean, SHAPE[1:])
    with pytest.raises(ValueError, match=r"got 2 common to .*\(100, 150.* ms\), expected 3 or more"):
        common(one, other.at([0, 1]))


# Regimes


def test_regimes_of_a_constructed_curve_are_where_they_were_put() -> None:
    # Falls from 100 at 0.1 s to 0 at 0.3 s in a straight line with a plateau before, rises to 40 at 0.8 s.
    axis = np.array([0.0, 0.1, 0.2, 0.3, 0.5, 0.8])
    auc = 3.0 + 0.07 * np.array([100.0, 100.0, 50.0, 0.0, 16.0, 40.0])
    found = regimes(Curve.of_table(axis, auc[:, None] + np.zeros((6, 4)), range(4)), np.tile(auc, (200, 1)))
    assert found.begins.value == pytest.approx(0.2)
    assert (found.best.value, found.first, found.last) == (0.3, 0.0, 0.8)
    assert (found.fall.value, found.rise.value) == pytest.approx((100.0, 40.0))
    assert not found.open
    spans = found.spans
    assert list(spans) == list(REGIMES)
    np.testing.assert_allclose(list(spans.values()), [(0.0, 0.2), (0.2, 0.3), (0.3, 0.8)])
    later = boundaries(axis, auc[None], share=0.9)[0][0]
    assert later == pytest.approx(0.28)  # a line from (0.2, 50) to (0.3, 0) has 10 left at 0.28


@pytest.mark.parametrize(
    ("auc", "shown"),
    [
        ([9.0, 7.0, 5.0, 3.0], [True, True, False]),  # falls only
        ([3.0, 5.0, 7.0, 9.0], [False, False, True]),  # rises only
        ([9.0, 3.0, 4.0, 5.0], [True, True, True]),
    ],
)
def test_a_regime_that_a_curve_does_not_show_is_not_reported(auc: list[float], shown: list[bool]) -> None:
    values = np.array(auc)
    found = regimes(curve(values, 0.05), np.tile(values, (200, 1)))
    assert [span is not None for span in found.spans.values()] == shown


def test_a_rise_within_the_noise_is_no_regime() -> None:
    one = curve(np.array([9.0, 3.0, 3.0, 3.02]), 0.8, seed=3)
    drawn = resample(one, one).simulated
    found = regimes(one, drawn)
    assert found.rise.low == 0.0
    assert found.spans["delay-dominant"] is None


# Intervals


@pytest.mark.parametrize("bump", [0.0, 0.3, 2.0])
def test_intervals_hold_the_truth_as_often_as_they_say(bump: float) -> None:
    """200 repetitions with 16 seeds that both curves share: the 95 % intervals hold the truth in 88 % at the least."""
    rng = np.random.default_rng(1)
    other = SHAPE + bump * np.sin(np.arange(SHAPE.size))
    truth = (float(rmse(SHAPE, other)), float(spearman(SHAPE, other)), float(kendall(SHAPE, other)))
    held = np.zeros(3)
    for k in range(200):
        shared = rng.normal(0.0, 0.5, 16)
        own = [values[:, None] + shared + rng.normal(0.0, 0.6, (SHAPE.size, 16)) for values in (SHAPE, other)]
        found = agreement(*(Curve.of_table(DELAYS, each, range(16)) for each in own), count=300, random=k)
        held += [each.low - 1e-9 <= value <= each.high + 1e-9
                 for each, value in zip((found.rmse, found.spearman, found.kendall), truth, strict=True)]  # fmt: skip
    assert (held / 200 >= 0.88).all(), held / 200


def test_the_bootstrap_spread_of_a_mean_is_that_of_students_interval() -> None:
    one = curve(SHAPE, 0.7, seed=2, count=6)
    drawn = resample(one, one, count=20_000)
    np.testing.assert_allclose(1.96 * drawn.simulated.std(axis=0), one.half_widths(), rtol=0.03)


def test_pairs_take_off_what_both_owe_to_the_seed() -> None:
    shared = np.random.default_rng(0).normal(0.0, 2.0, (SHAPE.size, 32))
    both = [SHAPE[:, None] + shared + np.random.default_rng(k).normal(0.0, 0.05, shared.shape) for k in (1, 2)]
    s, e = (Curve.of_table(DELAYS, each, range(32)) for each in both)
    apart = agreement(s, replace(e, seeds=None))
    together = agreement(s, e)
    assert together.paired and not apart.paired
    assert together.noise < 0.1 * apart.noise
    assert together.rmse.high < apart.rmse.high


def test_repetitions_without_seeds_vary_by_themselves_and_one_alone_does_not() -> None:
    ragged = Curve(DELAYS[:3], (np.array([9.0, 11.0]), np.array([5.0]), np.array([7.0, 7.5, 8.0])), None)
    drawn = resample(ragged, ragged).measured
    spread = drawn.std(axis=0)
    assert spread[1] == 0.0 and (spread[[0, 2]] > 0.1).all()
    np.testing.assert_array_equal(np.isnan(ragged.half_widths()), [False, True, False])


def test_tables_of_a_comparison_say_what_was_found() -> None:
    s, e = curve(SHAPE, 0.1, 1), curve(SHAPE + np.arange(7.0) / 2, 0.1, 2)
    found = compare(s, e, lambda delays: exactly(np.asarray(delays) / 0.8))
    table = found.curve
    np.testing.assert_allclose(table["difference"], normalised(s.mean) - normalised(e.mean))
    np.testing.assert_allclose(table["reliability"], DELAYS / 0.8)
    np.testing.assert_allclose(table["simulated_auc"], s.mean)
    assert (table["simulated_low"] < table["simulated"]).all() and (table["measured"] < table["measured_high"]).all()
    assert (table["difference_low"] <= table["difference"] + 1e-9).all()
    rows = found.regime_table
    assert list(rows["regime"]) == 2 * list(REGIMES)
    np.testing.assert_array_equal(rows["end"][:2], rows["begin"][1:3])
    np.testing.assert_allclose(rows["reliability_end"], rows["end"] / 0.8)


@pytest.fixture
def composer() -> Iterator[None]:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        yield


FAST = ["scenario.horizon=8", "validation.delay_ms=[140,200,400,800]", "validation.seeds=4", "figures=false",
        "validation.resamples=200"]  # fmt: skip


def validate(*options: str, folder: Path | None = None) -> Outcome:
    return run(load(ValidateConfig, compose("validate", [*FAST, *options])), folder, quiet=True)


# Simulated curves

NET = paper_network()
SHORT = Scenario(horizon=8.0)
SLOW = Design(tau=0.05)


def test_a_simulated_curve_is_what_evaluate_gives_at_each_deadline() -> None:
    found = simulated_curve(SHORT, SLOW, NET, [0.4, 0.15], range(3), rules=Rules(hold="decay"), key=4)
    runs = qocjax.evaluate(SHORT, replace(SLOW, deadline=np.array([0.15, 0.4])), NET, range(3), rules=Rules(hold="decay"), key=4)  # fmt: skip  # noqa: E501
    np.testing.assert_array_equal(found.delays, [0.15, 0.4])
    np.testing.assert_allclose(np.stack(found.values), runs["auc"].values.mean(axis=-1), rtol=1e-6)
    assert found.seeds == (0, 1, 2)


def test_a_delay_is_injected_by_the_deadline_alone() -> None:
    with pytest.raises(ValueError, match="actuation: got 'arrival', expected 'deadline'"):
        simulated_curve(SHORT, SLOW, NET, [0.2], range(2), rules=Rules("arrival"))
    with pytest.raises(ValueError, match="expected ascending ones"):
        simulated_curve(SHORT, SLOW, NET, [0.2, 0.2], range(2))


@pytest.mark.slow
def test_a_curve_of_the_stack_shares_its_seeds_with_that_of_the_surrogate(composer: None) -> None:
    small = [f"measured.controller.{name}" for name in
             ("mppi.batch_size=32", "mppi.time_steps=16", "mppi.prune_distance=1", "resolution=0.2")]  # fmt: skip
    options = ["scenario.horizon=1", "validation.delay_ms=[300,400,1200]", "validation.seeds=2"]
    found = validate("measured=stack", *small, *options).validation
    assert found.agreement.paired and found.measured.source == "stack"
    assert not np.allclose(found.measured.mean[:2], found.simulated.mean[:2], rtol=1e-3)
    # With a delay beyond the horizon nobody moves under either: what is left is the start jitter of the seed.
    np.testing.assert_allclose(found.measured.values[2], found.simulated.values[2], rtol=1e-4)


# Tables of measured pairs

GOOD = "# campaign\nphi,run,auc_s,seed\n100,a,8.0,1\n100,b,10.0,2\n\n200.0,a,4.0,1\n200,b,5,2\n400,a,6,1\n400,b,7,2\n"


def test_a_table_of_pairs_becomes_a_curve(tmp_path: Path) -> None:
    path = tmp_path / "auc.csv"
    path.write_text(GOOD)
    found = curve_of_csv(path, delay="phi", auc="auc_s", unit="ms")
    np.testing.assert_allclose(found.delays, [0.1, 0.2, 0.4])
    np.testing.assert_array_equal(found.repetitions, [2, 2, 2])
    np.testing.assert_allclose(found.mean, [9.0, 4.5, 6.5])
    assert found.seeds is None
    seeded = curve_of_csv(path, delay="phi", auc="auc_s", unit="ms", seed="seed")
    assert seeded.seeds == (1, 2)
    np.testing.assert_array_equal(seeded.values[1], [4.0, 5.0])
    np.testing.assert_allclose(curve_of_csv(path, delay="phi", auc="auc_s", unit="s").delays, [100.0, 200.0, 400.0])


def test_robots_of_one_run_are_no_repetitions(tmp_path: Path) -> None:
    path = tmp_path / "auc.csv"
    path.write_text("delay,auc,run\n0.1,2,a\n0.1,4,a\n0.1,9,b\n0.2,1,a\n0.2,2,b\n")
    found = curve_of_csv(path, unit="s", run="run")
    np.testing.assert_array_equal(found.values[0], [3.0, 9.0])
    np.testing.assert_array_equal(found.repetitions, [2, 2])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("phi,auc_s\n100,8\n200,much\n", r"auc.csv, line 3, column 'auc_s': got 'much', expected a number"),
        ("phi,auc_s\n100,8\n\n-200,4\n", r"auc.csv, line 4, column 'phi': got -200, expected a number >= 0"),
        ("phi,auc_s\n100,8\n200,-4\n", r"auc.csv, line 3, column 'auc_s': got -4, expected a number >= 0"),
        ("phi,auc_s\n100,8\n200,inf\n", r"auc.csv, line 3, column 'auc_s': got 'inf', expected a finite number"),
        ("phi,auc_s\n100,8\n200\n", r"auc.csv, line 3: .*"),
        ("phi,auc\n100,8\n", r"auc.csv: has no column 'auc_s'; its columns are"),
        ("phi,auc_s\n", r"auc.csv"),
        ("", r"auc.csv"),
    ],
)
def test_a_bad_table_is_refused_by_file_and_line(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "auc.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        curve_of_csv(tmp_path / "auc.csv", delay="phi", auc="auc_s", unit="ms")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("delay,auc,seed\n1,8,1\n1,9,2\n2,4,1\n", "got seed 2 at 1000 ms but not at 2000 ms, expected the same seeds"),
        ("delay,auc,seed\n1,8,1\n2,4,1\n2,4,3\n", "got seed 3 at 2000 ms but not at 1000 ms"),
        ("delay,auc,seed\n1,8,1\n2,4,1.5\n", "line 3, column 'seed': got 1.5, expected a whole number"),
    ],
)
def test_seeds_of_a_table_are_checked(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "auc.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        curve_of_csv(tmp_path / "auc.csv", unit="s", seed="seed")


def test_a_table_needs_a_known_unit_and_one_name_for_a_run(tmp_path: Path) -> None:
    (tmp_path / "auc.csv").write_text(GOOD)
    with pytest.raises(ValueError, match="unit: got 'min', expected one of s, ms, us, ns"):
        curve_of_csv(tmp_path / "auc.csv", unit="min")
    with pytest.raises(ValueError, match="run, seed: got 'run' and 'seed', expected one"):
        curve_of_csv(tmp_path / "auc.csv", unit="ms", run="run", seed="seed")


# Fitted gains


def test_fitted_gains_bring_the_curves_together_on_seeds_that_the_fit_has_not_seen() -> None:
    scenario, axis = Scenario(horizon=12.0), [0.16, 0.2, 0.3, 0.5, 0.8]
    baseline, true = Design(tau=0.05), Design(tau=0.05, eta=0.0, kappa=0.6, gamma=1.0)
    e = simulated_curve(scenario, true, NET, axis, range(96))
    known, held_out = e.of_seeds(range(32)), e.of_seeds(range(32, 96))
    bounds = {"eta": (0.0, 1.0), "kappa": (0.3, 4.0), "gamma": (0.5, 4.0)}
    found = fit([Setting("one", scenario, known)], baseline, NET, bounds, budget=768 + 32 * 100)
    assert set(found.gains) == set(bounds)
    assert all(low <= found.gains[name] <= high for name, (low, high) in bounds.items())
    assert found.design.d_safe == baseline.d_safe and found.looks <= 768 + 32 * 100
    judged = judge_gains(Setting("one", scenario, held_out), baseline, found.design, NET, range(32, 96))
    assert judged.before.paired
    assert judged.gain.low > 0.0
    assert judged.gain.value == pytest.approx(judged.before.rmse.value - judged.after.rmse.value)
    np.testing.assert_allclose(judged.curve["left"], judged.curve["after"] - judged.curve["measured"])


def test_gains_that_are_the_truth_leave_nothing() -> None:
    e = simulated_curve(SHORT, SLOW, NET, [0.15, 0.2, 0.4], range(4))
    judged = judge_gains(Setting("same", SHORT, e), replace(SLOW, kappa=1.0), SLOW, NET, range(4))
    assert judged.after.rmse.value == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(judged.curve[["left", "left_low", "left_high"]], 0.0, atol=1e-9)
    assert judged.row()["setting"] == "same"


def test_halves_share_no_run() -> None:
    one = curve(SHAPE, 1.0, count=5)
    known, held_out = halves(one)
    assert (known.seeds, held_out.seeds) == ((0, 2, 4), (1, 3))
    assert not set(known.values[0]) & set(held_out.values[0])
    with pytest.raises(ValueError, match="got one repetition at 100 ms, expected two or more"):
        halves(curve(SHAPE, count=1))


def test_a_fit_needs_settings_and_a_known_method() -> None:
    with pytest.raises(ValueError, match="settings: got none"):
        fit([], SLOW, NET)
    with pytest.raises(ValueError, match="method: got 'newton', expected one of random, sobol, cma_es"):
        fit([Setting("one", SHORT, curve(SHAPE))], SLOW, NET, method="newton")


# The command


def test_what_is_written_can_be_read_again_and_gives_the_same(composer: None, tmp_path: Path) -> None:
    first = validate("measured=surrogate", "measured.eta=0", "measured.kappa=1", "figures=true", folder=tmp_path)
    again = validate(
        "measured=csv", f"measured.path={tmp_path / 'measured.csv'}", "measured.unit=s", "measured.seed=seed"
    )
    assert again.validation.agreement.paired
    assert again.validation.agreement.rmse.value == pytest.approx(first.validation.agreement.rmse.value, rel=1e-6)
    assert (tmp_path / "figures" / "validation.png").read_bytes().startswith(b"\x89PNG")
    record = json.loads((tmp_path / "record.json").read_text())
    assert record["seeds"] == {"simulated": [0, 1, 2, 3], "measured": [0, 1, 2, 3]}
    assert record["versions"]["jax"] == jax.__version__
    table = pd.read_csv(tmp_path / "curve.csv")
    np.testing.assert_allclose(table["delay"], [0.14, 0.2, 0.4, 0.8])
    assert "Spearman's rank correlation" in report(first)


def test_the_same_gains_on_the_same_seeds_agree_wholly(composer: None) -> None:
    found = validate("measured=surrogate", "measured.eta=null").validation
    assert found.agreement.rmse.value == 0.0
    assert found.agreement.spearman.value == pytest.approx(1.0)


def messages(delay: float, seed: int) -> tuple[list[Message], float]:
    """A simulated run as a bag would hold it, and its AUC: commands bear the stamp of their pose, and come later.

    A loop that takes longer than the delay comes when it is done, as from a node that lets late commands pass.
    """
    scenario = Scenario(horizon=8.0)
    times = np.asarray(NET.draw(jax.random.key(seed), 160, 2, 0.05))
    run = qocjax.simulate(scenario, Design(tau=0.05, deadline=delay), times)
    found: list[Message] = []
    for k, time in enumerate(np.asarray(run.time)):
        for robot in (0, 1):
            place = [float(each) for each in run.pose[k, robot]]
            found.append((float(time), f"/robot{robot}/amcl_pose", AMCL, pose(AMCL, float(time), *place)))
            if k < len(times):
                arrives = float(time) + max(delay, float(times[k, robot]))
                found.append((arrives, f"/robot{robot}/cmd_vel", STAMPED, stamped(float(time), 0.1, 0.0)))
    return sorted(found, key=lambda each: each[0]), float(np.mean(run.auc))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[float, list[float]]]:
    """A folder of bags at three delays, two of each, one that cannot be read; and their AUC."""
    pytest.importorskip("rosbags")
    root, auc = tmp_path_factory.mktemp("runs"), {}
    for delay in (0.16, 0.3, 0.6):
        for repeat in (0, 1):
            content, value = messages(delay, 7 * repeat + int(1e3 * delay))
            write_bag(root / f"delay_{round(1e3 * delay)}_{repeat}", content)
            auc.setdefault(delay, []).append(value)
    (root / "broken").mkdir()
    (root / "broken" / "bag.db3").write_bytes(b"nothing")
    return root, auc


def test_recorded_runs_are_points_at_the_delays_that_their_stamps_tell(
    recorded: tuple[Path, dict[float, list[float]]], composer: None
) -> None:
    root, auc = recorded
    where = ["measured=recorded", f"measured.path={root}"]
    outcome = validate(*where, "validation.delay_ms=[160,200,300,600]")
    found = outcome.validation.measured
    np.testing.assert_allclose(found.delays, [0.16, 0.3, 0.6])
    np.testing.assert_array_equal(found.repetitions, [2, 2, 2])
    for own, true in zip(found.values, auc.values(), strict=True):
        np.testing.assert_allclose(sorted(own), sorted(true), rtol=0.01)
    points = outcome.points
    assert points is not None
    reads = points[points["left_out"] == ""]
    np.testing.assert_allclose(reads["d_cfg"], reads["delay"], atol=0.002)
    late = reads.groupby("delay")["late_share"].mean()
    np.testing.assert_allclose(late, 1.0 - NET.reliability(np.array([0.17, 0.31, 0.61])).share, atol=0.06)
    assert (points["left_out"] != "").sum() == 1
    binned = validate(*where, "validation.delay_ms=null", "measured.bin_ms=20").validation.measured
    np.testing.assert_allclose(binned.delays, [0.16, 0.3, 0.6])


def test_runs_far_from_every_configured_delay_are_told(
    recorded: tuple[Path, dict[float, list[float]]], composer: None
) -> None:
    root, _ = recorded
    where = ["measured=recorded", f"measured.path={root}"]
    with pytest.raises(ValueError, match="got 2 common"):
        validate(*where, "validation.delay_ms=[160,200,300,700]")
    with pytest.raises(ValueError, match=r"no run with a configured delay and an AUC \(.*of no configured delay\)"):
        validate(*where, "validation.delay_ms=[100,200,400]", "measured.tolerance_ms=1")
    labelled = ["measured.label=d_cfg_ms", "measured.labels.pattern='delay_{d_cfg_ms}_*'"]
    found = validate(*where, *labelled, "validation.delay_ms=null").validation.measured
    np.testing.assert_allclose(found.delays, [0.16, 0.3, 0.6])


def test_a_delay_is_placed_at_the_nearest_or_in_a_bin() -> None:
    near = Grouping(delays=[0.1, 0.2], tolerance=0.02)
    assert (near.place(0.115), near.place(0.15), near.place(0.199)) == (0.1, None, 0.2)
    assert Grouping(bin=0.05).place(0.26) == pytest.approx(0.25)


BAD = {
    "no delays for a simulated curve": (["measured=surrogate", "validation.delay_ms=null"],
                                        "validation.delay_ms: got null, expected delays"),
    "two delays": (["measured=surrogate", "validation.delay_ms=[100,200]"], "expected three delays or more"),
    "one seed": (["measured=surrogate", "validation.seeds=1"], "validation.seeds: got 1, expected at least 2"),
    "no file": (["measured=csv"], "measured.path: got nothing, expected a value; measured.unit: got nothing"),
    "missing file": (["measured=csv", "measured.path=none.csv", "measured.unit=ms"], "none.csv: no such file"),
    "no runs": (["measured=recorded", "measured.path=nowhere"], "path: got nowhere, which is not there"),
    "another actuation": (["measured=surrogate", "loop.actuation=arrival"], "actuation: got 'arrival'"),
    "another controller for S": (["controller=navigation"], "controller: got navigation, expected apf, which is S"),
    "unknown kind": (["measured=surrogate", "+measured.mass=1"], "measured.mass: got an unknown option"),
    "share": (["measured=surrogate", "validation.regime_share=1.5"], "regime_share: got 1.5, expected a share between"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_options_are_refused_in_one_line(case: str, composer: None) -> None:
    options, message = BAD[case]
    with pytest.raises(ValueError) as caught:
        validate(*options)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_command_ends_with_its_tables_or_one_line(tmp_path: Path) -> None:
    def command(*options: str) -> subprocess.CompletedProcess[str]:
        environment = os.environ | {"PYTHONPATH": str(ROOT), "JAX_PLATFORMS": "cpu"}
        return subprocess.run([sys.executable, "-m", "qocjax.validate", *options], cwd=tmp_path, env=environment,
                              capture_output=True, encoding="utf-8", timeout=300)  # fmt: skip

    done = command(*FAST, "measured=surrogate", f"hydra.run.dir={tmp_path / 'out'}")
    assert done.returncode == 0, done.stderr
    assert "delay-dominant" in done.stdout and "Traceback" not in done.stderr
    assert {"curve.csv", "agreement.csv", "regimes.csv", "record.json"} <= {
        p.name for p in (tmp_path / "out").iterdir()
    }
    (tmp_path / "auc.csv").write_text("delay,auc\n100,3\n200,x\n")
    bad = command("measured=csv", "measured.path=auc.csv", "measured.unit=ms")
    assert (bad.returncode, bad.stdout) == (2, "")
    assert bad.stderr == "error: auc.csv, line 3, column 'auc': got 'x', expected a number\n"
