"""Figures: what they show is what the tables hold, bad tables are named, and files appear whole or not at all."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import matplotlib
import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from scipy import special

from qocjax.figures import (
    DOUBLE_COLUMN,
    SINGLE_COLUMN,
    auc_against_deadline,
    policy_bars,
    qoc_map,
    save,
    trajectories,
)
from qocjax.figures.advice import advice_figure
from qocjax.figures.colliding import BREAKS, HATCHES, OPEN, collision_cells
from qocjax.figures.margins import delay_reliability_map
from qocjax.figures.paths import closest_approach

DEADLINES = np.array([0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8])
RELIABILITY = np.array([0.0, 0.0, 0.02, 0.16, 0.5, 0.98, 1.0, 1.0, 1.0])
GRIDS = {"v_max": [0.5, 0.7, 0.9], "eta": [0.0, 0.6, 1.2, 1.6], "tau": [0.01, 0.05]}
BASELINE = {"v_max": 0.7, "eta": 0.6, "tau": 0.01}
NAMES = ("Co-design", "MinDelay", "MaxRel")


def results_table(cliff: float = 210.0) -> pd.DataFrame:
    """AUC with the paper's shape: a cliff where few loops complete, then a slow rise with deadline and value."""
    rows = []
    for sweep, values in GRIDS.items():
        for rank, value in enumerate(values):
            auc = 3.0 + 0.2 * rank + 4.0 * DEADLINES**2 + cliff * np.maximum(0.0, 1.0 - DEADLINES / 0.15) ** 2
            for deadline, reliability, one in zip(DEADLINES, RELIABILITY, auc, strict=True):
                point = BASELINE | {sweep: value}
                row = {"sweep": sweep, "value": value, **point, "deadline": deadline, "reliability": reliability}
                rows.append(row | {"auc": one, "auc_se": 0.02 * one, "qoc": 1 / (1 + one / 4), "arrival_time": np.inf})
    return pd.DataFrame(rows)


def policies_table(results: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for sweep in GRIDS:
        table = results[results["sweep"] == sweep]
        parts = (table, table[table["deadline"] == 0.1], table[table["deadline"] == 0.8])
        for name, part in zip(NAMES, parts, strict=True):
            best = part.loc[part["qoc"].idxmax()]
            gap = 0.0 if name == "Co-design" else best["qoc"] - table["qoc"].max()
            rows.append(
                {"sweep": sweep, "policy": name, "value": best["value"], "deadline": best["deadline"]}
                | {"qoc": best["qoc"], "qoc_low": best["qoc"] - 0.01, "qoc_high": best["qoc"] + 0.02}
                | {"difference_low": gap - 0.01, "difference_high": gap + 0.01}
            )
    return pd.DataFrame(rows)


def a_run(robots: int = 2, instants: int = 121) -> SimpleNamespace:
    """Robots from a circle straight to their common goal, which they reach after 2/3 of the time."""
    time = np.linspace(0.0, 12.0, instants)
    angle = 2 * np.pi * np.arange(robots) / max(robots, 2) + 0.3
    radius = 3.0 * np.maximum(1.0 - time / 8.0, 0.05)[:, None]
    pose = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * radius + angle + np.pi], axis=-1)
    gap = np.inf if robots == 1 else 2 * 0.15 * np.sin(np.pi / robots)
    return SimpleNamespace(
        time=time, pose=pose, reference=np.outer(1 - time / 12, [1.0, 0.5]), goal=np.zeros(2), d_safe=0.5,
        robot_radius=0.105, deadline=0.2, auc=np.linspace(3.0, 4.0, robots), min_distance=gap,
    )  # fmt: skip


RESULTS = results_table()
POLICIES = policies_table(RESULTS)


def texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def points_of(line: Line2D) -> np.ndarray:
    return np.asarray(line.get_xydata(), dtype=float)


def legend_texts(owner: Axes | Figure) -> list[str]:
    legend = owner.get_legend() if isinstance(owner, Axes) else owner.legends[0]
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


def test_bars_have_the_height_the_interval_and_the_choice_of_their_row() -> None:
    figure = policy_bars(POLICIES)
    axes = figure.axes[0]
    bars = [container for container in axes.containers if isinstance(container, BarContainer)]
    whiskers = [container for container in axes.containers if isinstance(container, ErrorbarContainer)]
    assert len(bars) == 3 and all(len(container) == len(GRIDS) for container in bars)
    for name, container, whisker in zip(NAMES, bars, whiskers, strict=True):
        rows = POLICIES[POLICIES["policy"] == name]
        np.testing.assert_allclose([bar.get_height() for bar in container], rows["qoc"])
        ends = np.array(whisker.lines[2][0].get_segments())[:, :, 1]
        np.testing.assert_allclose(ends, rows[["qoc_low", "qoc_high"]])
    assert legend_texts(figure) == list(NAMES)
    written = texts(axes)
    assert {r"$\nu^\mathrm{max}$ (m/s)", r"$\eta$", r"$\tau$ (ms)"} <= set(written)
    assert written.count("800") == len(GRIDS)  # MaxRel's deadline in each group
    assert "10" in written  # tau in milliseconds


def test_bars_mark_only_differences_whose_interval_holds_zero() -> None:
    assert "n.s." not in texts(policy_bars(POLICIES).axes[0])
    table = POLICIES.copy()
    table.loc[1, ["difference_low", "difference_high"]] = [-0.1, 0.0]
    assert texts(policy_bars(table).axes[0]).count("n.s.") == 1


def test_bars_tell_policies_apart_without_colour() -> None:
    axes = policy_bars(POLICIES).axes[0]
    hatches = {bar.patches[0].get_hatch() for bar in axes.containers if isinstance(bar, BarContainer)}
    assert len(hatches) == 3


def test_bars_of_an_incomplete_table_stand_at_their_own_sweep() -> None:
    table = POLICIES[~((POLICIES["sweep"] == "eta") & (POLICIES["policy"] == "Co-design"))]
    axes = policy_bars(table).axes[0]
    first = next(bar for bar in axes.containers if isinstance(bar, BarContainer))
    centres = [bar.get_x() + bar.get_width() / 2 for bar in first]
    assert len(centres) == 2 and centres[1] - centres[0] == pytest.approx(2.0)


def test_auc_lines_hold_the_table_and_emphasise_the_baseline() -> None:
    figure = auc_against_deadline(RESULTS, ("eta", "tau"))
    assert figure.get_figwidth() == DOUBLE_COLUMN
    for panel, sweep in zip((axes for axes in figure.axes if axes.get_legend()), ("eta", "tau"), strict=True):
        for line, value in zip(panel.lines[: len(GRIDS[sweep])], GRIDS[sweep], strict=True):
            row = RESULTS[(RESULTS["sweep"] == sweep) & (RESULTS["value"] == value)]
            np.testing.assert_allclose(points_of(line), np.c_[1e3 * row["deadline"], row["auc"]])
        labels = legend_texts(panel)
        assert len(labels) == len(GRIDS[sweep])
        heaviest = max(panel.lines, key=lambda line: line.get_linewidth())
        assert "(baseline)" in str(heaviest.get_label()) and sum("baseline" in text for text in labels) == 1


def test_auc_has_reliability_on_a_second_axis() -> None:
    figure = auc_against_deadline(RESULTS, "eta")
    assert figure.get_figwidth() == SINGLE_COLUMN
    panel, second = figure.axes
    assert panel.get_xlabel() == r"Deadline $\Delta$ (ms)" and panel.get_ylabel() == "AUC (s)"
    np.testing.assert_allclose(points_of(second.lines[0]), np.c_[1e3 * DEADLINES, RELIABILITY])
    assert "F(" in second.get_ylabel()


def heights(panel: Axes, values: np.ndarray) -> np.ndarray:
    pixels = panel.transData.transform(np.c_[np.zeros(len(values)), values])
    return panel.transAxes.inverted().transform(pixels)[:, 1]


def test_auc_axis_gives_the_reliable_region_most_of_the_height() -> None:
    panel = auc_against_deadline(RESULTS, "eta").axes[0]
    reliable = RESULTS[(RESULTS["sweep"] == "eta") & (RESULTS["reliability"] >= 0.5)]["auc"]
    low, high, cliff = heights(panel, np.array([reliable.min(), reliable.max(), 213.0]))
    assert high - low > 0.5 and 0.0 <= low < high < cliff < 1.0
    steps = np.diff(heights(panel, np.linspace(reliable.min(), reliable.max(), 5)))
    np.testing.assert_allclose(steps, steps[0])  # linear there
    decades = np.diff(heights(panel, np.array([10.0, 20.0, 40.0])))
    assert decades[0] == pytest.approx(decades[1])  # logarithmic above


def test_auc_axis_is_linear_without_a_cliff_and_logarithmic_where_all_spread() -> None:
    assert auc_against_deadline(results_table(cliff=0.0), "eta").axes[0].get_yscale() == "linear"
    spread = RESULTS.assign(auc=RESULTS["auc"] * np.where(RESULTS["value"] == 0.0, 30.0, 1.0))
    assert auc_against_deadline(spread, "eta").axes[0].get_yscale() == "log"


def test_auc_baseline_can_be_given_and_is_not_guessed() -> None:
    alone = RESULTS[RESULTS["sweep"] == "eta"]
    assert not any("baseline" in text for text in legend_texts(auc_against_deadline(alone, "eta").axes[0]))
    given = auc_against_deadline(alone, "eta", baseline={"eta": 1.2}).axes[0]
    assert legend_texts(given) == ["0", "0.6", "1.2 (baseline)", "1.6"]


def test_map_cells_hold_the_table_and_points_the_policies() -> None:
    figure = qoc_map(RESULTS, POLICIES, "eta")
    axes = figure.axes[0]
    mesh = next(item for item in axes.collections if isinstance(item, QuadMesh))
    expected = RESULTS[RESULTS["sweep"] == "eta"].pivot(index="value", columns="deadline", values="qoc")
    np.testing.assert_allclose(np.asarray(mesh.get_array()).reshape(expected.shape), expected)
    edges = np.asarray(mesh.get_coordinates(), dtype=float)[0, :, 0]
    assert np.all((edges[:-1] < 1e3 * DEADLINES) & (1e3 * DEADLINES < edges[1:]))
    assert len({line.get_marker() for line in axes.lines}) == 3
    for line in axes.lines:
        row = POLICIES[(POLICIES["sweep"] == "eta") & (POLICIES["policy"] == line.get_label())].iloc[0]
        x, y = points_of(line)[0]
        assert x == pytest.approx(1e3 * row["deadline"])
        assert float(axes.get_yticklabels()[int(y)].get_text()) == row["value"]
    bold = [label.get_text() for label in axes.get_yticklabels() if label.get_fontweight() == "bold"]
    assert bold == ["0.6"]


def test_map_shows_what_ties_with_co_design() -> None:
    table = POLICIES.copy()
    own = table[(table["sweep"] == "eta") & (table["policy"] == "Co-design")].iloc[0]
    ends = sorted([own["deadline"], DEADLINES[0] if own["deadline"] > DEADLINES[0] else DEADLINES[1]])
    table["tied_values"], table["tied_deadline_low"], table["tied_deadline_high"] = "0 0.6", ends[0], ends[1]
    axes = qoc_map(RESULTS, table, "eta").axes[0]
    names = [label.get_text() for label in axes.get_yticklabels()]
    marks = next(line for line in axes.lines if line.get_marker() == ">")
    assert [float(names[int(y)]) for _, y in points_of(marks)] == [0.0, 0.6]
    span = next(line for line in axes.lines if line.get_marker() == "|")
    np.testing.assert_allclose(points_of(span)[:, 0], 1e3 * np.array(ends))
    assert float(names[int(points_of(span)[0][1])]) == own["value"]
    table["tied_values"], table["tied_deadline_low"], table["tied_deadline_high"] = "0.6", 0.2, 0.2
    assert len(qoc_map(RESULTS, table, "eta").axes[0].lines) == 3


def test_map_hatches_what_collides_too_often() -> None:
    """Of 40 seeds: all that collide break 5 % for sure, one leaves it open, none leaves the cell clear."""
    shares = np.where(RESULTS["deadline"] >= 0.6, 1.0, np.where(RESULTS["deadline"] == 0.4, 1 / 40, 0.0))
    results = RESULTS.assign(collision_share=shares, seeds=40)
    rows = results[results["sweep"] == "eta"]
    cells = collision_cells(rows, 0.05)
    low, high = (special.betaincinv(*ends) for ends in ((1, 40, 0.025), (2, 39, 0.975)))
    assert low < 0.05 < high
    np.testing.assert_array_equal(cells, np.tile([0] * 6 + [OPEN, BREAKS, BREAKS], (4, 1)))
    assert (collision_cells(rows, 0.5)[:, 6] == 0).all()
    figure = qoc_map(results, POLICIES, "eta", limit=0.05)
    hatched = {patch.get_hatch(): patch.get_path() for patch in figure.axes[0].patches}
    assert set(hatched) == set(HATCHES.values())
    for kind, hatch in HATCHES.items():  # each covers its own cells, and nothing else
        covered = [
            [hatched[hatch].contains_point((1e3 * at, k)) for at in np.unique(rows["deadline"])] for k in range(4)
        ]
        np.testing.assert_array_equal(covered, cells == kind)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts[-2:] == ["collisions above 5%", "not shown to be below"]
    assert not qoc_map(results, POLICIES, "eta").axes[0].patches


def test_advice_figure_says_what_collides() -> None:
    ends = {f"{what}_{who}{end}": value for what, value in (("qoc", 0.5), ("collision", 0.2))
            for who in ("recommended", "current") for end in ("", "_low", "_high")}  # fmt: skip
    axis = np.array([0.05, 0.1, 0.2])
    rows = pd.DataFrame({"what": ["current", "current gains, recommended deadline", "best by the mean alone",
                                  "recommended"], "qoc": 0.5, "qoc_low": 0.49, "qoc_high": 0.51, "change_low": -0.01,
                         "change_high": 0.01, "collision_share": [0.0, 0.3, 0.02, 0.0], "collision_low": 0.0,
                         "collision_high": 0.4})  # fmt: skip
    for share, label in ((np.array([0.5, 0.9, 0.999]), "Missed loops"), (np.array([0.1, 0.2, 0.3]), "completion")):
        curve = pd.DataFrame({"deadline": axis, "reliability": share} | ends)
        for margin in ((0.05, 0.1), None):
            figure = advice_figure(curve, rows, rows, margin, (0.1, 0.2), limit=0.01)
            assert any(label in axes.get_ylabel() for axes in figure.axes)
        texts = [text.get_text() for axes in figure.axes for text in axes.texts]
        assert texts.count("0.500, 30% collide") == 2 and texts.count("0.500, 2.0% collide") == 2
    with pytest.raises(ValueError, match="collision_share"):
        advice_figure(curve, rows.drop(columns="collision_share"), rows, None, (0.1, 0.2))


def test_hatches_of_the_plane_follow_the_interval() -> None:
    delay, share = np.meshgrid([0.1, 0.2, 0.4], [0.1, 0.5, 1.0])
    plane = pd.DataFrame({"delay": delay.ravel(), "reliability": share.ravel(), "qoc": 0.6 - 0.5 * delay.ravel(),
                          "collision_low": delay.ravel() - 0.1, "collision_high": delay.ravel() + 0.1})  # fmt: skip
    curve = pd.DataFrame({"deadline": [0.1, 0.4], "reliability": [0.1, 1.0]})

    def texts(limit: float | None) -> list[str]:
        figure = delay_reliability_map(plane, curve, limit=limit)
        return [text.get_text() for text in figure.legends[0].get_texts()][1:]

    assert texts(None) == [] and texts(1.0) == []
    assert texts(0.25) == ["collisions above 25.0%", "not shown to be below"]
    assert texts(0.45) == ["not shown to be below"]
    with pytest.raises(ValueError, match="collision_low"):
        delay_reliability_map(plane.drop(columns="collision_low"), curve, limit=0.1)


def test_map_refuses_a_choice_outside_its_grid() -> None:
    table = POLICIES.copy()
    table.loc[table["sweep"] == "eta", "value"] = 0.7
    with pytest.raises(ValueError, match="Co-design.*value 0.7.*results does not have"):
        qoc_map(RESULTS, table, "eta")


def test_trajectories_draw_each_path_in_its_colour_with_discs_of_true_size() -> None:
    run = a_run()
    figure = trajectories(run, mark_every=2.0)
    overview, closest, end = figure.axes
    for robot in range(2):
        pieces = [line for line in overview.lines if line.get_linestyle() == "-" and len(points_of(line)) > 1]
        path = run.pose[:, robot, :2]
        (under_way,) = [line for line in pieces if np.allclose(points_of(line)[0], path[0])]
        (arrived,) = [line for line in pieces if np.allclose(points_of(line)[-1], path[-1])]
        assert under_way.get_color() == arrived.get_color()
        np.testing.assert_allclose(np.r_[points_of(under_way), points_of(arrived)[1:]], path)
    radii = {round(patch.get_radius(), 4) for patch in closest.patches if isinstance(patch, Circle)}
    assert radii == {0.105, 0.25}
    assert {"2 s", "4 s"} <= set(texts(overview))
    assert "0.30 m" in closest.get_title() and "12 s" in end.get_title()
    assert all(axes.get_aspect() == 1.0 for axes in figure.axes)
    assert any(text.startswith("robot 2, AUC 4.00 s") for text in legend_texts(figure))


def test_closest_approach_is_that_of_all_pairs_and_instants() -> None:
    pose = np.random.default_rng(3).normal(size=(40, 5, 3))
    gaps = np.linalg.norm(pose[:, :, None, :2] - pose[:, None, :, :2], axis=-1)
    gaps[:, np.arange(5), np.arange(5)] = np.inf
    found = closest_approach(pose)
    assert found is not None and found[1] < found[2]
    assert gaps[found] == gaps.min()
    assert closest_approach(pose[:, :1]) is None


@pytest.mark.parametrize("robots", [1, 64])
def test_trajectories_of_one_and_of_many_robots(robots: int) -> None:
    figure = trajectories(a_run(robots))
    assert len(figure.axes) == (1 if robots == 1 else 3)
    figure.draw_without_rendering()
    assert len(legend_texts(figure)) == 5  # many robots share one line


@pytest.mark.filterwarnings("error")
def test_trajectories_without_motion_and_without_a_safety_distance(tmp_path: Path) -> None:
    run = a_run()
    run.pose, run.min_distance, run.d_safe = np.zeros((121, 2, 3)), 0.0, 0.0
    save(trajectories(run), tmp_path / "still")


def test_time_marks_in_single_precision_are_at_the_nearest_instant() -> None:
    run = a_run()
    run.time = np.arange(121, dtype=np.float32) * np.float32(0.1)
    assert texts(trajectories(run, mark_every=2.0).axes[0]) == ["2 s", "4 s"]


def test_trajectories_take_a_reference_and_a_goal_per_robot() -> None:
    run = a_run(3)
    run.reference, run.goal = run.pose[..., :2] + 0.1, run.pose[-1, :, :2]
    overview = trajectories(run).axes[0]
    assert sum(line.get_linestyle() == "--" for line in overview.lines) == 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"auc": np.ones(3)}, r"auc: got shape \(3,\)"),
        ({"pose": np.zeros((121, 2, 2))}, r"pose: got shape \(121, 2, 2\)"),
        ({"goal": np.array([0.0, np.nan])}, "goal: got nan"),
        ({"time": np.zeros(121)}, "time: "),
        ({"min_distance": np.inf}, "min_distance: got inf"),
    ],
)
def test_trajectories_name_the_bad_attribute(change: dict[str, np.ndarray], message: str) -> None:
    run = a_run()
    vars(run).update(change)
    with pytest.raises(ValueError, match=message):
        trajectories(run)


def test_trajectories_refuse_a_mark_spacing_that_is_not_positive() -> None:
    with pytest.raises(ValueError, match="mark_every: got 0"):
        trajectories(a_run(), mark_every=0.0)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (RESULTS.drop(columns="auc_se"), "results: column 'auc_se' is missing"),
        (RESULTS.iloc[:0], "results: the table has no rows"),
        (RESULTS.assign(sweep="speed"), "results: unknown sweep 'speed'"),
        (RESULTS.assign(auc=np.where(RESULTS.index == 4, np.nan, RESULTS["auc"])), "column 'auc' .*got nan in row 4"),
        (RESULTS.assign(auc="3.2"), "column 'auc' must hold numbers"),
        (pd.concat([RESULTS, RESULTS]), "more than once"),
        (RESULTS[RESULTS["sweep"] == "tau"], "results has no row of 'eta'; it has tau"),
    ],
)
def test_bad_results_are_named_in_one_line(table: pd.DataFrame, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        auc_against_deadline(table, "eta")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (POLICIES.drop(columns="qoc_low"), "policies: column 'qoc_low' is missing"),
        (POLICIES.iloc[:0], "policies: the table has no rows"),
        (POLICIES.assign(policy="Random"), "policies: unknown policy 'Random'"),
        (pd.concat([POLICIES, POLICIES]), "policies: 'Co-design' occurs more than once"),
    ],
)
def test_bad_policies_are_named_in_one_line(table: pd.DataFrame, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        policy_bars(table)
    assert "\n" not in str(caught.value)


def test_an_unknown_sweep_and_no_sweep_are_errors() -> None:
    with pytest.raises(ValueError, match="sweep: unknown 'speed'; expected one of v_max, eta"):
        auc_against_deadline(RESULTS, ["eta", "speed"])
    with pytest.raises(ValueError, match="sweeps: "):
        auc_against_deadline(RESULTS, [])
    with pytest.raises(TypeError, match="results: expected a pandas DataFrame, got list"):
        auc_against_deadline([], "eta")  # type: ignore[arg-type]


def one_deadline(results: pd.DataFrame) -> pd.DataFrame:
    return results[results["deadline"] == 0.2]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "results",
    [
        one_deadline(RESULTS),
        RESULTS[RESULTS["value"].isin([0.6, 0.7, 0.01])],
        RESULTS[RESULTS["sweep"] == "eta"],
        RESULTS.assign(auc=4.0, auc_se=0.0, qoc=0.5),
        RESULTS.assign(auc_se=np.nan),
        RESULTS[RESULTS["reliability"] < 0.1],
    ],
    ids=["one deadline", "one value", "one sweep", "equal", "one seed", "unreliable"],
)
def test_corner_cases_draw_without_a_warning(results: pd.DataFrame) -> None:
    middle = results[results["sweep"] == "eta"].iloc[-1]
    points = POLICIES[POLICIES["sweep"] == "eta"].assign(value=middle["value"], deadline=middle["deadline"])
    points = points.assign(qoc_low=np.nan, qoc_high=np.nan)
    for figure in (auc_against_deadline(results, "eta"), qoc_map(results, points, "eta"), policy_bars(points)):
        figure.draw_without_rendering()


def test_save_writes_both_files_whole_and_nothing_else(tmp_path: Path) -> None:
    figure = policy_bars(POLICIES, width=SINGLE_COLUMN)
    paths = save(figure, tmp_path / "new" / "bars_0.7")
    assert paths == [tmp_path / "new" / "bars_0.7.png", tmp_path / "new" / "bars_0.7.pdf"]
    assert sorted(paths) == sorted((tmp_path / "new").iterdir())
    png, pdf = (path.read_bytes() for path in paths)
    assert png.startswith(b"\x89PNG") and int.from_bytes(png[16:20], "big") == round(300 * SINGLE_COLUMN)
    assert pdf.startswith(b"%PDF") and pdf.rstrip().endswith(b"%%EOF")
    assert b"/Subtype /Type3" not in pdf and b"/CIDFontType2" in pdf  # TrueType fonts, embedded
    assert b"/FontFile2" in pdf


def test_save_again_gives_the_same_bytes(tmp_path: Path) -> None:
    first = [path.read_bytes() for path in save(policy_bars(POLICIES), tmp_path / "bars")]
    assert [path.read_bytes() for path in save(policy_bars(POLICIES), tmp_path / "bars")] == first


def test_a_failed_save_leaves_the_old_file_and_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figure = policy_bars(POLICIES)
    (tmp_path / "bars.png").write_bytes(b"old")

    def fail(partial: Path, **options: object) -> None:
        Path(partial).write_bytes(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(figure, "savefig", fail)
    with pytest.raises(OSError, match="disk full"):
        save(figure, tmp_path / "bars")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"bars.png": b"old"}


def test_save_needs_a_name() -> None:
    with pytest.raises(ValueError, match="stem: "):
        save(Figure(), Path())


def test_global_settings_survive_threads() -> None:
    with matplotlib.rc_context({"font.size": 13.0}):
        before = dict(matplotlib.rcParams)
        with ThreadPoolExecutor(4) as pool:
            figures = list(pool.map(lambda _: policy_bars(POLICIES), range(8)))
        assert dict(matplotlib.rcParams) == before
    assert all(figure.axes[0].yaxis.label.get_fontsize() == 8.0 for figure in figures)  # not the caller's 13


def test_import_starts_no_window_system_and_changes_no_setting() -> None:
    code = (  # asking for the backend would itself start one
        "import sys, matplotlib; start = matplotlib.rcParams.copy(); import qocjax.figures; "
        "now = matplotlib.rcParams; same = all(now[key] == start[key] for key in start if key != 'backend'); "
        "print('matplotlib.pyplot' in sys.modules, same)"
    )
    root = Path(__file__).parents[1]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root)
    assert done.stdout.split() == ["False", "True"]
