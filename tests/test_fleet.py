"""Fleets: where they start, where they leave what is asked, and a small study from end to end."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hydra import compose, initialize_config_dir
from matplotlib.collections import QuadMesh
from scipy import stats
from test_report import Visit, browser  # noqa: F401 - a fixture

from qocjax.commands.fleet import fleet_text, run
from qocjax.config import conf_dir, load
from qocjax.config.fleet import FleetConfig
from qocjax.figures.fleet import draw_fleet, fleet_figure
from qocjax.figures.fleet_loops import completion_figure, steps_figure
from qocjax.figures.fleet_maps import maps_figure
from qocjax.fleets import Asked, Crossing, Layout, Point, crossing, largest_fleet
from qocjax.fleets.tables import (
    FleetStudy,
    answers,
    find_limit,
    map_table,
    need_table,
    points_table,
    steps_table,
)
from qocjax.network import Edge
from qocjax.network.interface import Load
from qocjax.quality import QocScale
from qocjax.statistics.estimates import share
from qocjax.study.capacity import edge_text, offered_load
from qocjax.study.engine import LocalEngine
from qocjax.study.reliability import reliability_of

ROOT = Path(__file__).parents[1]
SMALL = [
    "fleet.robots=[1,2]", "fleet.horizon=3", "loop.tau=0.1", "fleet.deadline_ms=[100,200,300]", "fleet.seeds=3",
    "fleet.evaluation_seeds=3", "fleet.grids.kappa=[1,2]", "fleet.map.robots=[2]", "fleet.map.prbs=[5,40]",
    "fleet.map.workers=[]", "fleet.steps=false", "figures=false", "report=false", "network.compute.mean=0.05",
    "network.compute.std=0.01",
]  # fmt: skip


def config(*options: str) -> FleetConfig:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return load(FleetConfig, compose("fleet", [*SMALL, *options]))


# Where robots start and go


@pytest.mark.parametrize("kind", ["lanes", "circle", "apart"])
@pytest.mark.parametrize("robots", [1, 2, 3, 8, 64])
def test_each_robot_looks_to_a_goal_of_its_own_at_the_length(kind: str, robots: int) -> None:
    start, goal = Layout(kind, 1.5, 5.0).place(robots)
    assert start.shape == (robots, 3) and goal.shape == (robots, 2)
    way = goal - start[:, :2]
    np.testing.assert_allclose(np.linalg.norm(way, axis=1), 5.0)
    np.testing.assert_allclose(way / 5.0, np.stack([np.cos(start[:, 2]), np.sin(start[:, 2])], axis=1), atol=1e-12)
    assert len(np.unique(goal.round(6), axis=0)) == robots


@pytest.mark.parametrize("robots", [2, 7, 40])
def test_lanes_lie_side_by_side_and_meet(robots: int) -> None:
    """As dense whatever their number; neighbours go the other way."""
    start, goal = Layout("lanes", 1.3, 4.0).place(robots)
    np.testing.assert_allclose(np.diff(start[:, 1]), 1.3)
    np.testing.assert_allclose(start[:, 1], goal[:, 1])
    np.testing.assert_allclose(start[1:, 0], -start[:-1, 0])


@pytest.mark.parametrize("robots", [16, 17, 100])
def test_a_circle_grows_with_its_robots(robots: int) -> None:
    start, _ = Layout("circle", 1.3, 4.0).place(robots)
    radius = np.linalg.norm(start[:, :2], axis=1)
    np.testing.assert_allclose(2 * np.pi * radius / robots, 1.3)  # of the circle for each robot
    small, goal = Layout("circle", 1.3, 4.0).place(2)
    np.testing.assert_allclose(goal, -small[:, :2], atol=1e-12)  # where that is too small, its diameter is the length


@pytest.mark.parametrize("robots", [2, 9])
def test_robots_that_are_apart_never_meet(robots: int) -> None:
    start, goal = Layout("apart", 0.1, 4.0).place(robots)
    ways = start[:, None, :2] + np.linspace(0, 1, 50)[:, None] * (goal - start[:, :2])[:, None]
    for i in range(robots):
        for j in range(i):
            assert np.linalg.norm(ways[i][:, None] - ways[j][None], axis=-1).min() >= 12.0 - 1e-9


# Where a fleet leaves what is asked


def point(robots: int, scores: Any, collided: Any = None, selection: Any = None, **row: Any) -> Point:
    scores = np.asarray(scores, float)
    close = np.zeros(scores.size, bool) if collided is None else np.asarray(collided, bool)
    hits = share(close)
    error = scores.std(ddof=1) / np.sqrt(scores.size)
    found = {
        "robots": robots, "tau": 0.05, "deadline": 0.2, "qoc": scores.mean(), "qoc_se": error,
        "qoc_low": scores.mean() - 2 * error, "qoc_high": scores.mean() + 2 * error, "auc": 1.0, "auc_se": 0.1,
        "reliability": 0.5, "reliability_se": 0.01, "collision_share": close.mean(), "collision_low": hits.low,
        "collision_high": hits.high, "seeds": scores.size,
    }  # fmt: skip
    chosen = scores if selection is None else np.asarray(selection, float)
    return Point(robots, 0.2, chosen, scores, close, np.arange(scores.size), found | row)


def test_crossing_is_linear_in_the_logarithm() -> None:
    flat = [np.full(5, score) for score in (0.9, 0.8, 0.4)]
    found = crossing([1, 4, 16], flat, 0.6)
    assert (found.value, found.low, found.high, found.beyond) == (*[pytest.approx(8.0)] * 3, "")
    assert crossing([1, 4, 16], flat, 0.85).value == pytest.approx(2.0)
    assert crossing([1, 4, 16], flat, 0.95) == Crossing(None, None, None, "below")
    assert crossing([1, 4, 16], flat, 0.4) == Crossing(None, None, None, "above")
    again = [np.full(5, score) for score in (0.9, 0.5, 0.9)]
    assert crossing([1, 4, 16], again, 0.7).value == pytest.approx(2.0)  # the first time
    with pytest.raises(ValueError, match="expected the same at every value"):
        crossing([1, 2], [np.ones(3), np.ones(4)], 0.5)


@pytest.mark.parametrize("common", [0.0, 0.05])
def test_interval_of_a_crossing_holds_it_as_often_as_it_says(common: float) -> None:
    """95 % of the time, of few seeds too; also where values share what they owe to their seeds."""
    rng, held, mean = np.random.default_rng(3), 0, np.array([0.9, 0.8, 0.5, 0.2])
    for k in range(300):
        scores = mean[:, None] + rng.normal(0, 0.05, (4, 10)) + common * rng.normal(size=10)
        found = crossing([1, 2, 4, 8], list(scores), 0.65, random=k)
        assert found.low is not None and found.high is not None
        held += found.low <= 2 * np.sqrt(2) <= found.high
    assert 0.91 <= held / 300 <= 0.985  # three standard errors


def test_one_end_beyond_the_axis_is_unknown() -> None:
    rng = np.random.default_rng(0)
    found = crossing([1, 2], [0.9 + 0.1 * rng.normal(size=20), 0.5 + 0.01 * rng.normal(size=20)], 0.88)
    assert found.low is None and found.high is not None and found.value is not None


def test_largest_fleet_ends_at_the_first_that_fails() -> None:
    asked = Asked(0.8, 0.1)
    good, bad, close = [0.9, 0.85], [0.7, 0.75], [True, False]
    assert largest_fleet([point(1, good), point(2, good), point(4, bad), point(8, good)], asked) == 2
    assert largest_fleet([point(1, good), point(2, good, close)], asked) == 1
    assert largest_fleet([point(1, bad)], asked) is None
    with pytest.raises(ValueError, match=r"fleet\.target: got 1\.2, expected <= 1"):
        Asked(1.2, 0.1)


def test_collisions_are_held_to_their_limit_by_their_upper_end_where_seeds_can_show_it() -> None:
    asked = Asked(0.5, 0.05)

    def fleet(robots: int, seeds: int, hits: int) -> Point:
        policies = dict.fromkeys(("co_design_qoc", "mindelay_qoc", "maxrel_qoc"), 0.9)
        return point(robots, 0.9 + 0.01 * (np.arange(seeds) % 2), np.arange(seeds) < hits, **policies)

    assert asked.least_seeds == 72
    assert fleet(2, 72, 0).row["collision_high"] <= 0.05 < fleet(2, 71, 0).row["collision_high"]
    for seeds, hits, kept, shown in ((72, 0, 2, True), (72, 1, None, False), (71, 0, 2, False), (71, 3, 2, False),
                                     (71, 4, None, False), (200, 6, None, False), (400, 8, 2, True)):  # fmt: skip
        found = fleet(2, seeds, hits)
        assert largest_fleet([found], asked) == kept, (seeds, hits)
        assert bool(asked.not_shown(found.row)) == (kept is not None and not shown)
    few = study_of_points([fleet(2, 16, 0), fleet(4, 16, 0)], asked)
    said = "That collisions keep within 5% is not shown with 16 seeds, 72 without one would (fleet.evaluation_seeds)."
    assert "0% [0%, 21%]. " + said in answers(few)[0] and said.replace("16", "2") in answers(few)[2]
    assert fleet_text(few).count("0% [0%, 21%] ?") == 2
    many = study_of_points([fleet(2, 72, 0), fleet(4, 72, 1)], asked)
    assert "not shown" not in answers(many)[0] and "4 do not (collisions: 0.9050, 1% [0%, 7%])" in answers(many)[0]
    assert fleet_text(many).count("1% [0%, 7%] !") == 1
    assert "nor with any number" in answers(study_of_points([fleet(2, 72, 0)], Asked(0.5, 0.0)))[0]


def test_share_interval_is_exact() -> None:
    """Clopper and Pearson: of no event in n, the upper end is 1 - (alpha / 2)^(1 / n)."""
    never, always = share(np.zeros(16)), share(np.ones(16))
    assert (never.low, never.high) == (0.0, pytest.approx(1 - 0.025 ** (1 / 16)))
    assert (always.low, always.high) == (pytest.approx(0.025 ** (1 / 16)), 1.0)
    for hits in (1, 7, 15):
        found, exact = share(np.arange(16) < hits), stats.binomtest(hits, 16).proportion_ci()
        assert (found.low, found.high) == (pytest.approx(exact.low), pytest.approx(exact.high))


def cells(scores: dict[tuple[int, int], list[float]]) -> dict[tuple[int, int], Point]:
    return {cell: point(cell[0], found) for cell, found in scores.items()}


def test_needs_lie_between_what_was_tried() -> None:
    found = need_table(
        cells({(2, 10): [0.5, 0.5], (2, 40): [0.9, 0.9], (4, 10): [0.1, 0.1], (4, 40): [0.2, 0.2],
               (1, 10): [0.9, 0.9], (1, 40): [0.9, 0.9]}), "prbs", Asked(0.7, 0.05),
    ).set_index("robots")  # fmt: skip
    assert found.loc[2, "need"] == 40
    for end in ("crossing", "crossing_low", "crossing_high"):
        assert found.loc[2, end] == pytest.approx(20.0)
    assert np.isnan(found.loc[4, "need"]) and found.loc[4, "beyond"] == "more than the axis"
    assert found.loc[1, "need"] == 10 and found.loc[1, "beyond"] == "less than the axis"


def test_needs_keep_collisions_too() -> None:
    found = {(2, 10): point(2, [0.9, 0.9], [True, True]), (2, 20): point(2, [0.9, 0.9])}
    assert need_table(found, "prbs", Asked(0.7, 0.05))["need"].tolist() == [20]


def test_needs_have_ordered_ends() -> None:
    rng = np.random.default_rng(1)
    given = {(2, 10): point(2, 0.5 + 0.05 * rng.normal(size=9)), (2, 40): point(2, 0.9 + 0.05 * rng.normal(size=9))}
    row = need_table(given, "prbs", Asked(0.7, 0.05)).iloc[0]
    assert 10 < row["crossing_low"] < row["crossing"] < row["crossing_high"] < 40


def study_of_points(points: list[Point], asked: Asked, steps: dict[str, Point] | None = None) -> FleetStudy:
    """A study of which only numbers are known."""
    given = {(n, w): point(n, [0.3 + 0.3 * w - 0.05 * n] * 2) for n in (1, 2, 4) for w in (1, 2)}
    given[2, 1] = point(2, [0.5, 0.5], [True, True])
    axis = np.linspace(0, 0.4, 9)
    completion = pd.concat(
        pd.DataFrame({"robots": each.robots, "deadline": axis, "reliability": axis, "reliability_se": 0.01})
        for each in points
    )
    largest, limit = find_limit(points, asked)
    return FleetStudy(
        points_table(points), completion, {"workers": map_table(given, "workers")},
        {"workers": need_table(given, "workers", asked)}, steps_table(points[-1], steps or {}), asked, largest, limit,
        QocScale(1.0, 2.0),
    )  # fmt: skip


USED = {"uplink_usage_se": 0.01, "edge_usage": 0.5, "edge_usage_se": 0.01}
FALLING = [point(1, [0.9, 0.92], uplink_usage=0.1, **USED), point(4, [0.7, 0.74], uplink_usage=0.4, **USED),
           point(16, [0.1, 0.12], uplink_usage=0.99, **USED)]  # fmt: skip


def test_answers_say_what_follows() -> None:
    steps = {"8 workers": point(16, [0.5, 0.56]), "τ 100 ms": point(16, [0.0, 0.3])}
    study = study_of_points(FALLING, Asked(0.5, 0.05), steps)
    first, admit, needs, change = answers(study)
    assert first.startswith("4 robots keep a QoC of at least 0.5000 and collisions in at most 5% of the runs: 0.7200")
    assert "16 do not (QoC: 0.1100" in first and "only fleets between those simulated would show" in first
    assert admit.startswith("Admit a robot while there are fewer than 4: with 4, F(200 ms) = 0.500;")
    assert "more than 40% of the uplink in use" in admit and "edge" not in admit  # which is as busy with any
    assert needs.startswith("Workers: 1 needs at most 1") and "4 need 2" in needs
    assert change.startswith("With N = 16 change first: 8 workers, +0.4200 [")
    none = study_of_points(FALLING, Asked(0.95, 0.05))
    assert answers(none)[0].startswith("No fleet that was simulated keeps a QoC of at least 0.9500")
    whole = study_of_points(FALLING[:1], Asked(0.5, 0.05), {"8 workers": point(1, [0.8, 0.98])})
    assert answers(whole)[0].endswith("That is the largest fleet simulated.")
    assert "8 workers, is not shown to help on fresh ones" in answers(whole)[-1]


@pytest.mark.parametrize(
    ("edge", "shared", "said"),
    [
        (Edge(4, discipline="skip"), 1.0, "With N = 16 limit: edge: 4 erlang per robot offered to 4 workers, "
         "100% of what it can serve; offered to the others: uplink 30%."),
        (Edge(4, False, "skip"), 16.0, "limit: edge: 64 erlang offered to 4 workers, 1600% of what it can serve"),
        (Edge(1, False, "skip"), 0.25, "nothing is offered as much as it can serve: most is uplink: 30% of its"),
    ],
)  # fmt: skip
def test_what_limits_is_named(edge: Edge, shared: float, said: str) -> None:
    fleets = [point(n, [q, q], edge_offered=shared, uplink_offered=0.3) for n, q in ((1, 0.9), (16, 0.1))]
    study = replace(study_of_points(fleets, Asked(0.5, 0.05)), edge=edge)
    assert any(said in line for line in answers(study))
    own = f"edge: {edge.workers} workers for each robot ({16 * edge.workers} in all)." if edge.per_robot else "shared."
    assert any(line.endswith(own) for line in answers(study))
    whose = " for each robot" if edge.per_robot else ", shared"
    assert any(line.startswith(f"Workers{whose}: 1 needs") for line in answers(study))


def test_offered_load_is_what_samples_ask_over_what_is_there() -> None:
    """Model, section 12: N / tau samples a second, each of its mean slots and seconds of a worker."""
    cell = config("network.compute.mean=0.2", "network.compute.std=0.001", "network.edge.workers=4").study(16, None)
    network: Any = cell.build_network()
    load = Load(30, 16, 0.1)
    found = offered_load(network, load)
    assert found["edge"] == pytest.approx(0.2 / 0.1 / 4, rel=1e-3)
    slots = network.uplink.mean_size(network.harq_max)
    assert found["uplink"] == pytest.approx(160 * slots / network.free_slots_per_s("uplink"))
    few = config("network.compute.mean=0.2", "network.compute.std=0.001", "network.edge.per_robot=false")
    shared: Any = few.study(16, None).build_network()
    crowded = offered_load(shared, load)
    assert crowded["edge"] == pytest.approx(32.0, rel=1e-3)
    assert crowded["downlink"] == pytest.approx(found["downlink"] / 32, rel=1e-3)  # only what is computed goes down
    assert edge_text(network.edge, 16) == "edge: 4 workers for each robot (64 in all)"
    assert edge_text(shared.edge, 16) == "edge: 1 worker shared"
    free = config("network=paper", "network.edge.discipline=unlimited").study(2, None)
    assert offered_load(free.build_network(), load) == {}


def test_a_target_on_a_scale_of_its_own_prints_that_for_what_ifs() -> None:
    study = study_of_points(FALLING, Asked(0.5, 0.05))
    assert not any("fleet.j_med" in line for line in answers(study))
    own = replace(study, absolute=True, scale=QocScale(0.1 + 0.2, 2.5))
    options = re.findall(r"fleet\.\S+=\S+", answers(own)[-1])
    given = config("fleet.target=0.5", *options)
    assert given.scale() == own.scale  # to the bit


def test_the_step_to_change_first_is_chosen_on_other_seeds_than_it_is_judged_on() -> None:
    base = point(4, [0.5, 0.52, 0.48])
    lucky = point(4, [0.9, 0.9, 0.92], selection=[0.5, 0.5, 0.5])
    sound = point(4, [0.7, 0.73, 0.68], selection=[0.7, 0.7, 0.7])
    steps = steps_table(base, {"lucky": lucky, "sound": sound})
    assert steps["step"].tolist() == ["sound", "lucky"] and steps["gain"].is_monotonic_increasing
    assert steps["gain_told"].tolist() == [1, 1]
    study = study_of_points([base], Asked(0.45, 0.05), {"lucky": lucky, "sound": sound})
    assert "change first: sound, +0.2033 [" in answers(study)[-1]


# Figures


@pytest.mark.parametrize("which", [FALLING, FALLING[:1], FALLING[2:]], ids=["all", "one", "below"])
def test_fleets_are_drawn(which: list[Point]) -> None:
    study = study_of_points(which, Asked(0.5, 0.05), {"8 workers": point(16, [0.5, 0.56])})
    score, load, close = fleet_figure(study).axes
    line = next(each for each in score.get_lines() if each.get_marker() == "D")
    np.testing.assert_allclose(np.asarray(line.get_xydata(), float), study.points[["robots", "qoc"]].to_numpy(float))
    bold = [text.get_text() for text in close.get_xticklabels() if text.get_fontweight() == "bold"]
    assert bold == ([] if study.largest is None else [str(study.largest)])
    np.testing.assert_allclose(np.asarray(load.get_lines()[0].get_ydata(), float), 100 * study.points["uplink_usage"])
    assert completion_figure(study.completion, study.points).axes[0].get_ylim()[1] > 0.4
    bars = steps_figure(study.steps).axes[0].patches
    np.testing.assert_allclose([bar.get_width() for bar in bars], study.steps["gain"])  # type: ignore[attr-defined]


def test_maps_show_cells_hatches_and_the_target() -> None:
    study = study_of_points(FALLING, Asked(0.5, 0.05))
    (axes, _) = maps_figure(study.maps, study.asked).axes
    mesh = next(each for each in axes.collections if isinstance(each, QuadMesh))
    table = study.maps["workers"].pivot(index="workers", columns="robots", values="qoc")
    np.testing.assert_allclose(np.ravel(np.asarray(mesh.get_array())), table.to_numpy().ravel())
    assert [each.get_xy() for each in axes.patches] == [(0.5, -0.5)]  # type: ignore[attr-defined]  # two robots, one worker
    assert [text.get_text() for text in axes.get_yticklabels()] == ["1", "2"]
    with pytest.raises(ValueError, match="column 'qoc' is missing"):
        maps_figure({"workers": study.maps["workers"].drop(columns="qoc")}, study.asked)


# A small study


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fleet")


@pytest.fixture(scope="module")
def study(folder: Path) -> FleetStudy:
    return run(config("report=true"), folder)


def tables(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.csv")}


def test_tables_hold_a_row_for_each_fleet_and_cell(study: FleetStudy, folder: Path) -> None:
    assert set(tables(folder)) == {"fleet.csv", "completion.csv", "map_prbs.csv", "need_prbs.csv"}
    points = pd.read_csv(folder / "fleet.csv")
    assert points["robots"].tolist() == [1, 2] and not points.isna().to_numpy().any()
    for name in ("qoc", "co_design_qoc", "mindelay_qoc", "maxrel_qoc"):
        assert (points[f"{name}_low"] <= points[name]).all() and (points[name] <= points[f"{name}_high"]).all()
    for name in ("uplink_usage", "edge_usage", "downlink_usage"):
        assert points[name].between(0, 1).all() and (points[f"{name}_se"] >= 0).all()
    assert (points["collision_low"] <= points["collision_share"]).all() and (points["seeds"] == 3).all()
    assert list(zip(study.maps["prbs"]["robots"], study.maps["prbs"]["prbs"], strict=True)) == [(2, 5), (2, 40)]
    assert set(study.completion["robots"]) == {1, 2}
    record = json.loads((folder / "record.json").read_text(encoding="utf-8"))
    assert record["answers"] == answers(study) and record["target"] == study.asked.qoc
    assert study.asked.qoc == pytest.approx(0.95 * points["qoc"].iloc[0])  # of the first fleet
    assert (folder / "parts" / "robots-2-prbs-40" / "study.json").exists()
    assert "robots" in fleet_text(study) and answers(study)[0] in fleet_text(study)


def test_f_at_the_best_deadline_is_that_of_the_curve(study: FleetStudy) -> None:
    for row in study.points.to_dict("records"):
        curve = study.completion[study.completion["robots"] == row["robots"]]
        share = np.interp(row["deadline"], curve["deadline"], curve["reliability"])
        assert share == pytest.approx(row["reliability"], abs=1e-9)
        assert (np.diff(curve["reliability"]) >= 0).all()


def test_a_finished_study_is_not_computed_again(
    study: FleetStudy, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nothing(_: Any, problem: Any, chunks: Any) -> Iterator[Any]:
        assert not chunks
        yield from ()

    before = tables(folder)
    monkeypatch.setattr(LocalEngine, "run", nothing)
    run(config(), folder)
    assert tables(folder) == before


def test_what_was_lost_is_computed_to_the_same_bytes(study: FleetStudy, folder: Path) -> None:
    before, part = tables(folder), folder / "parts" / "robots-2-prbs-5"
    shutil.rmtree(part)
    (folder / "fleet.csv").unlink()
    run(config(), folder)
    assert tables(folder) == before and part.exists()


def test_another_study_has_no_place_in_the_folder(study: FleetStudy, folder: Path) -> None:
    with pytest.raises(ValueError, match="holds another study .*key: 0 there, 1 here"):
        run(config("key=1"), folder)


def test_own_scale_given_is_the_own_scale(study: FleetStudy) -> None:
    scale, few = study.scale, ["fleet.map.prbs=[]"]
    again = run(config(f"fleet.j_med={scale.median!r}", f"fleet.j_max={scale.largest!r}", *few))
    given = [name for name in study.points if "_whole_" not in name]  # a scale that is given has no error
    pd.testing.assert_frame_equal(again.points[given], study.points[given], check_exact=True)
    assert (again.points["qoc_whole_se"] < study.points["qoc_whole_se"]).all()
    other = run(config(f"fleet.j_med={3 * scale.median!r}", f"fleet.j_max={scale.largest!r}", *few))
    assert (other.points["qoc"] > study.points["qoc"]).all() and other.scale != scale


def test_a_cell_that_is_overloaded_says_so_once(study: FleetStudy, capsys: pytest.CaptureFixture[str]) -> None:
    """And the more robots share it, the fewer loops complete."""
    found = run(config("network.prbs=5", "network.uplink.message_bytes=4000", "fleet.map.prbs=[]"))
    one, two = (found.completion[found.completion["robots"] == n]["reliability"].to_numpy() for n in (1, 2))
    assert (two <= one).all() and two.max() < one.max() < study.completion["reliability"].max()
    said = capsys.readouterr().err
    assert said.count("delay grows without bound") == 1 and "2 robots: the uplink of the cell" in said


def test_more_blocks_never_lower_f() -> None:
    few = None
    for blocks in (5, 20, 100):
        problem = (
            config().study(2, None, {"network.prbs": blocks, "network.edge.discipline": "unlimited"}).build_problem()
        )
        share = reliability_of(problem.network, problem.scenario, np.linspace(0, 0.3, 31), 0.1).share
        assert few is None or (share >= few).all()
        few = share
    assert few is not None and few[-1] > 0.9


@pytest.mark.slow
def test_dask_computes_the_same_bits(study: FleetStudy) -> None:
    pytest.importorskip("distributed", reason="the extra cluster (Dask) is not installed")
    found = run(config("engine=dask", "engine.workers=1"))
    pd.testing.assert_frame_equal(found.points, study.points, check_exact=True)
    pd.testing.assert_frame_equal(found.maps["prbs"], study.maps["prbs"], check_exact=True)


def test_steps_are_of_one_option_each() -> None:
    steps = config("network.prbs=50").steps()
    assert steps["100 PRBs"] == {"network.prbs": 100} and steps["τ 200 ms"] == {"loop.tau": 0.2}
    assert steps["2 workers"] == {"network.edge.workers": 2} and "discipline latest" in steps
    assert not any("workers" in step for step in config("network.edge.discipline=unlimited").steps())
    assert set(config("network=paper").axes()) == set()
    assert set(config("network=paper", "fleet.map.workers=[1,2]").axes()) == {"workers"}


# The page


def test_page_is_one_small_file_with_the_answers(study: FleetStudy, folder: Path) -> None:
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert len(text) < 4e6
    own = re.sub(r'<script type="text/plain" id="plotly">.*?</script>', "", text, flags=re.DOTALL)
    assert set(re.findall(r"https?://[^\s\"']+", own)) <= {"http://www.w3.org/2000/svg"}
    assert "Computations at once" in text and answers(study)[0].split(":")[0] in text
    data = json.loads(re.findall(r'id="data">(.*?)</script>', text)[0])
    assert [len(each["x"]) for each in data["replay"]["runs"]] == [2] if study.largest == 2 else [1, 2]
    assert set(data["charts"]) == {"qoc", "uses", "completion", "map-prbs"}


def test_page_works_in_a_browser(browser: Any, study: FleetStudy, folder: Path) -> None:  # noqa: F811
    visit = Visit(browser, folder / "report.html", width=390, scheme="dark")
    assert visit.said == [] and visit.value("document.documentElement.scrollWidth") <= 390
    assert visit.page.locator("table.compared").first.locator("tbody tr").count() == 2
    visit.page.focus("#chart-map-prbs")
    visit.page.keyboard.press("ArrowUp")
    assert "2 robots with 40 resource blocks: QoC" in visit.page.locator("#needs .readout").first.inner_text()
    visit.page.select_option("#replayed", "2 robots")
    assert visit.page.locator(".stage:not([hidden]) circle.body").count() == 2
    assert visit.said == []


def test_figures_are_files(study: FleetStudy, tmp_path: Path) -> None:
    names = {path.name for path in draw_fleet(study, tmp_path)}
    assert names == {f"{name}.{kind}" for name in ("fleet", "completion", "maps") for kind in ("png", "pdf")}


# Bad input

BAD_INPUT = {
    "trace": (["network=trace", "network.path=a.csv", "network.column=rtt", "network.unit=ms"], "network: got a trace"),
    "stack": (["controller=navigation"], "controller: got navigation, expected apf"),
    "descending": (["fleet.robots=[1,4,2]"], "fleet.robots: got [1, 4, 2], expected whole numbers that ascend"),
    "none": (["fleet.robots=[]"], "fleet.robots: got [], expected"),
    "too many blocks": (["fleet.map.prbs=[5,200]"], "prbs: got 200, expected at most 106, all of 40 MHz"),
    "no worker": (["network.edge.workers=0"], "workers: got 0, expected at least 1"),
    "no worker on the map": (["fleet.map.workers=[0,1]"], "fleet.map.workers: got 0, expected at least 1"),
    "target": (["fleet.target=1.5"], "fleet.target: got 1.5, expected <= 1"),
    "share": (["fleet.target_share=1.5"], "fleet.target_share: got 1.5, expected <= 1"),
    "collisions": (["fleet.max_collision_share=2"], "fleet.max_collision_share: got 2.0, expected <= 1"),
    "tau": (["+fleet.grids.tau=[0.05]"], "fleet.grids: got tau, expected other parameters"),
    "one of two": (["fleet.j_med=0.2"], "fleet.j_med, fleet.j_max: got 0.2 and None, expected both or neither"),
    "layout": (["fleet.layout.kind=heap"], "fleet.layout.kind: got 'heap', expected one of lanes, circle, apart"),
    "dead network": (
        ["network.compute.mean=40", "fleet.robots=[1]"],
        "fleet.deadline_ms: got 800 ms at most, by which 0 of the loops of 1 robot complete on",
    ),
    "nearly dead": (
        ["network=paper", "fleet.deadline_ms=[20]", "fleet.robots=[2]", "fleet.min_reliability=0.5"],
        "of the loops of 2 robots complete on paper, expected at least 0.5 (fleet.min_reliability)",
    ),
    "one seed": (["fleet.seeds=1"], "fleet.seeds: got 1, expected at least 2"),
}
ONE_BY_ONE = """
import contextlib, io, json, sys
import qocjax.commands.fleet, qocjax.fleet
def compiles(*_, **__): raise SystemExit("went on")
qocjax.commands.fleet.study_of = compiles
for options in json.loads(sys.argv[1]):
    sys.argv = ["qocjax.fleet", *options]
    out, err, code = io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            qocjax.fleet.main()
        except SystemExit as stop:
            code = stop.code
    print(json.dumps([code, out.getvalue(), err.getvalue()]))
"""


@pytest.fixture(scope="module")
def refusals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Any, str, str]]:
    options = json.dumps([options for options, _ in BAD_INPUT.values()])
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{ONE_BY_ONE}", options],
        cwd=tmp_path_factory.mktemp("refused"), capture_output=True, encoding="utf-8", timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return {case: json.loads(line) for case, line in zip(BAD_INPUT, done.stdout.splitlines(), strict=True)}


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_input_ends_with_one_line_that_names_it(case: str, refusals: dict[str, tuple[Any, str, str]]) -> None:
    code, out, err = refusals[case]
    assert (code, out) == (2, "")
    (line,) = err.splitlines()
    assert line.startswith("error: ") and BAD_INPUT[case][1] in line
