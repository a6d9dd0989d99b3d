"""What `qocjax.show` draws: costmaps, animations, maps under trajectories, and the command from options to files."""

from __future__ import annotations

import json
import shutil
import stat
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import numpy as np
import pandas as pd
import pytest
from hydra import compose, initialize_config_dir
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle
from PIL import Image

import qocjax
from qocjax.commands.show import report, run
from qocjax.config import conf_dir, load
from qocjax.config.show import ShowConfig
from qocjax.figures import trajectories
from qocjax.figures.animation import animate, film_of, frames
from qocjax.figures.cells import Cells
from qocjax.figures.costmap import CostmapView, costmap_layers_figure, costmaps
from qocjax.figures.film import write_film
from qocjax.figures.scene import Scene, age_scale
from qocjax.navigation import Grid, Rectangle, StaticMap, map_of_shapes
from qocjax.scenario import Design, Scenario

GRID = Grid(0.1, (-2.0, -1.0), (20, 40))
ROOM: StaticMap = map_of_shapes(GRID, [Rectangle((0.0, 0.8), (0.4, 0.4))])
SAMPLES, STEPS = 60, 12


def view(robot: int = 0, **changes: Any) -> CostmapView:
    """A wall, another robot as it was seen, and a fan of rollouts; the weights run over six decades."""
    static, obstacles, inflation = ROOM.cost.astype(float), np.zeros(GRID.shape), np.zeros(GRID.shape)
    obstacles[8:10, 30:32] = 254
    inflation[7:11, 28:30] = 253
    inflation[5:7, 28:34] = 100
    angle = np.linspace(-0.5, 0.5, SAMPLES)[:, None]
    along = np.linspace(0.05, 0.8, STEPS)
    poses = np.array([[-1.5, 0, 0.1], [1.2, -0.1, 3.0]])
    values = {
        "grid": GRID, "static": static, "obstacles": obstacles, "inflation": inflation,
        "total": np.maximum(np.maximum(static, obstacles), inflation),
        "path": np.stack([np.linspace(-1.5, 1.5, 31), np.zeros(31)], axis=1),
        "rollout_x": -1.5 + along * np.cos(angle), "rollout_y": along * np.sin(angle),
        "weight": 10.0 ** np.linspace(-6, 0, SAMPLES) / 4.5, "poses": poses,
        "robot": robot, "begin": poses[min(robot, 1)], "goal": np.array([1.5, 0.0]), "robot_radius": 0.1,
        "time": 2.5,
    }  # fmt: skip
    return CostmapView(**values | changes)


def a_run(robots: int = 2, held: float = 0.0) -> SimpleNamespace:
    """Robots on straight lines to goals of their own, which they reach after 4 of 6 s; some of the loops are missed."""
    time, tau = np.linspace(0.0, 6.0, 121), 0.05
    begin = np.stack([np.full(robots, -1.5), np.linspace(-0.6, 0.6, robots)], axis=-1)
    goal = begin + (3.0, 0.0)
    share = np.minimum(time / 4.0, 1.0)[:, None, None]
    place = (1 - share) * begin + share * goal
    pose = np.concatenate([place, np.zeros((121, robots, 1))], axis=-1)
    command = np.zeros((120, robots, 2))
    command[:80, :, 0] = 0.75
    missed = np.random.default_rng(0).random((120, robots)) < held
    missed[:10] = False
    age = np.zeros((120, robots))
    for tick in range(120):
        before = age[tick - 1] if tick else 0.0
        age[tick] = np.where(missed[tick], before + tau, 0.1)
    return SimpleNamespace(
        time=time, pose=pose, command=command, age=age, missed=missed, reference=place, goal=goal, d_safe=0.5,
        robot_radius=0.105, deadline=0.1, auc=np.ones(robots), min_distance=0.1 if robots > 1 else np.inf,
    )  # fmt: skip


def image_of(panel: Axes) -> np.ndarray:
    (cells,) = panel.images
    assert isinstance(cells, Cells) and cells.origin == "lower"
    np.testing.assert_allclose(cells.get_extent(), GRID.extent)
    return cells.table[cells.cost] / 255


def test_costmap_cells_have_the_colours_of_their_layers() -> None:
    figure = costmap_layers_figure(view())
    close, static, obstacles, inflation, total = (axes for axes in figure.axes if axes.images)
    black, white, blue = (0, 0, 0), (1, 1, 1), (0x56 / 255, 0xB4 / 255, 0xE9 / 255)
    wall, seen = ROOM.cost == 254, view().obstacles == 254  # type: ignore[union-attr]
    np.testing.assert_allclose(image_of(static)[wall][:, :3], np.tile(black, (wall.sum(), 1)))
    np.testing.assert_allclose(image_of(static)[~wall][:, :3], 1.0)
    np.testing.assert_allclose(image_of(obstacles)[8:10, 30:32, :3].reshape(-1, 3), np.tile(blue, (4, 1)))
    np.testing.assert_allclose(image_of(obstacles)[~np.asarray(seen)][:, :3], 1.0)
    closed, open_ = image_of(inflation)[8, 28, :3], image_of(inflation)[6, 30, :3]
    assert closed[1] < open_[1] < 1.0  # the dearer, the darker
    for panel in (close, total):
        cells = image_of(panel)
        for there, colour in (((19, 20), black), ((9, 31), blue), ((0, 0), white)):
            np.testing.assert_allclose(cells[there][:3], colour)
        np.testing.assert_allclose(cells[8, 28, :3], closed)
    assert [panel.get_title().split(" $")[0] for panel in (static, obstacles, inflation, total)] == [
        "static map", "obstacles", "inflation", "sum",
    ]  # fmt: skip


def test_costmaps_hold_path_rollouts_and_robots() -> None:
    figure = costmaps([view(0), view(1)])
    panels = [axes for axes in figure.axes if axes.images]
    assert [panel.get_title() for panel in panels] == ["robot 1 at 2.5 s", "robot 2 at 2.5 s"]
    for panel in panels:
        (rollouts,) = (item for item in panel.collections if isinstance(item, LineCollection))
        weight = np.asarray(rollouts.get_array(), float)
        assert len(rollouts.get_segments()) == SAMPLES
        np.testing.assert_allclose(weight, np.sort(np.asarray(view().weight)) / np.max(view().weight))
        np.testing.assert_allclose(rollouts.get_segments()[-1][:, 0], np.asarray(view().rollout_x)[-1])
        path, mean, _ = (np.asarray(line.get_xydata()) for line in panel.lines)
        np.testing.assert_allclose(path, view().path)
        np.testing.assert_allclose(mean[:, 1], np.asarray(view().weight) @ np.asarray(view().rollout_y))
        bodies = [patch for patch in panel.patches if isinstance(patch, Circle)]
        np.testing.assert_allclose([body.center for body in bodies], np.asarray(view().poses)[:, :2])
        np.testing.assert_allclose(panel.get_xlim() + panel.get_ylim(), GRID.extent)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "global path" in labels and "predicted place" not in labels


def test_a_prediction_is_drawn_where_the_rollouts_begin() -> None:
    ahead = view(begin=np.array([-1.2, 0.05, 0.1]))
    figure = costmaps([ahead])
    circles = [patch.center for patch in figure.axes[0].patches if isinstance(patch, Circle)]
    assert len(circles) == 3 and (-1.2, 0.05) in circles
    assert "predicted place" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_many_rollouts_are_thinned_and_the_heaviest_stays() -> None:
    turn = np.linspace(0, 1, 3000)[:, None] * np.ones(STEPS)
    many = view(rollout_x=turn, rollout_y=turn, weight=np.linspace(1, 2, 3000) / 4500)
    (rollouts,) = (item for item in costmaps([many]).axes[0].collections if isinstance(item, LineCollection))
    assert len(rollouts.get_segments()) == 400
    assert np.asarray(rollouts.get_array())[-1] == 1.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"inflation": np.zeros((3, 3))}, r"inflation: got shape \(3, 3\), expected \(20, 40\)"),
        ({"weight": np.ones(3)}, r"rollout_x: got shape \(60, 12\)"),
        ({"robot": 2}, "robot: got 2, expected 0 to 1"),
        ({"goal": np.zeros(3)}, r"goal: got shape \(3,\)"),
    ],
)
def test_a_bad_view_is_named(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        view(**changes)


def test_costmaps_need_a_view_and_a_positive_reach() -> None:
    with pytest.raises(ValueError, match="views: got none"):
        costmaps([])
    with pytest.raises(ValueError, match="reach: got 0"):
        costmap_layers_figure(view(), reach=0.0)


def test_trajectories_lie_on_the_map_with_goals_in_their_robots_colours() -> None:
    figure = trajectories(a_run(), static_map=ROOM)
    overview = figure.axes[0]
    cells = image_of(overview)
    assert (cells[ROOM.cost == 254][:, 3] == 1.0).all() and (cells[ROOM.cost == 0][:, 3] == 0.0).all()
    figure.draw_without_rendering()
    np.testing.assert_allclose(overview.get_xlim() + overview.get_ylim(), GRID.extent)
    stars = [line for line in overview.lines if line.get_marker() == "*"]
    colours = [line.get_color() for line in overview.lines if line.get_linestyle() == "-" and len(line.get_xdata()) > 9]
    np.testing.assert_allclose([np.ravel(star.get_xydata()) for star in stars], a_run().goal)
    assert [star.get_markerfacecolor() for star in stars] == list(dict.fromkeys(colours))


def test_unknown_cells_are_light_and_costs_are_faint() -> None:
    cost = np.zeros(GRID.shape, int)
    cost[0], cost[1] = 255, 127
    cells = image_of(trajectories(a_run(), static_map=StaticMap(GRID, cost)).axes[0])
    assert (cells[0, :, :3] > 0.8).all() and (cells[0, :, 3] == 1).all()
    np.testing.assert_allclose(cells[1, :, 3], 0.5, atol=1 / 255)


def test_an_animation_has_a_frame_for_each_instant_and_moves() -> None:
    shown = list(frames(a_run(), static_map=ROOM, fps=5.0, until=3.0))
    assert len(shown) == 16 and {frame.shape for frame in shown} == {shown[0].shape}
    height, width, channels = shown[0].shape
    assert channels == 3 and height % 2 == width % 2 == 0  # as films want it
    ground = (np.abs(np.diff(np.stack(shown).astype(int), axis=0)).max(axis=-1) > 0).mean(axis=(1, 2))
    assert (ground > 0.002).all() and (ground < 0.2).all()  # robots move, the rest stands still


def test_an_animation_ends_three_seconds_after_all_have_arrived() -> None:
    close = 1.0  # m, twice the safety distance: reached 1 m before the goal at 4 s
    ends = 4.0 * (1 - close / 3.0) + 3.0
    assert len(list(frames(a_run(), fps=2.0))) == pytest.approx(2 * ends + 1, abs=1)
    assert len(list(frames(a_run(), fps=2.0, until=99.0))) == 13


@pytest.mark.parametrize(("robots", "tick"), [(1, 40), (8, 100)])
def test_a_frame_shows_places_ages_and_commands(robots: int, tick: int) -> None:
    given = a_run(robots, held=0.4)
    film = film_of(given, until=6.0)
    np.testing.assert_array_equal(film.held[1:], given.missed[1:])
    scene = Scene(film, None, "title")
    scene.at(tick)
    for number, robot in enumerate(scene.robots):
        place = given.pose[tick, number, :2]
        for patch, radius in ((robot.disc, 0.25), (robot.body, 0.105)):
            np.testing.assert_allclose(patch.center, place)
            assert patch.get_radius() == radius
        assert robot.ring.get_visible() == given.missed[tick, number]
        np.testing.assert_allclose(robot.body.get_facecolor(), scene.scale.to_rgba(given.age[tick, number]))
        np.testing.assert_allclose(np.asarray(robot.trail.get_xydata())[[0, -1]], given.pose[[0, tick], number, :2])
    np.testing.assert_allclose(scene.speed.get_offsets(), given.pose[tick, :, :2])
    np.testing.assert_allclose(scene.speed.U, given.command[tick, :, 0])
    assert scene.clock.get_text() == f"{0.05 * tick:.1f} s"
    assert scene.figure.legends[0].get_title().get_text() == r"title, $\Delta$ = 100 ms"


def test_the_arc_of_a_turn_is_what_it_turns_in_a_second() -> None:
    given = a_run(1)
    given.command[:, 0, 1] = -1.2
    scene = Scene(film_of(given, until=6.0), None, "")
    scene.at(10)
    x, y = np.asarray(scene.robots[0].turn.get_xydata()).T
    angle = np.arctan2(y - given.pose[10, 0, 1], x - given.pose[10, 0, 0])
    np.testing.assert_allclose(angle, np.linspace(0.0, -1.2, 16), atol=1e-12)


def test_robots_that_wait_for_their_first_command_hold_none() -> None:
    """Also where the first loop of one is lost and its first command comes a sampling period later."""
    times = np.full((80, 2), 0.02)
    times[0, 1] = np.inf
    scenario = Scenario(horizon=4.0, start_jitter=(0.0, 0.0))
    film = film_of(qocjax.simulate(scenario, Design(tau=0.05, deadline=0.12), times))
    assert film.waiting.sum(axis=0).tolist() == [3, 3]
    assert np.argwhere(film.held).tolist() == []


def test_held_commands_are_those_of_the_missed_loops() -> None:
    """Of a simulated run: a loop of tick p that is lost leaves the robot without a new command at p plus the lag."""
    scenario = Scenario(horizon=4.0, start_jitter=(0.0, 0.0))
    times = np.full((80, 2), 0.02)
    lost = [(10, 0), (11, 0), (30, 1), (60, 0)]
    for tick, robot in lost:
        times[tick, robot] = np.inf
    done = qocjax.simulate(scenario, Design(tau=0.05, deadline=0.1), times)
    film = film_of(done)
    expected = np.zeros((80, 2), bool)
    for tick, robot in lost:
        expected[tick + 2, robot] = True
    assert list(np.flatnonzero(film.waiting[:, 0])) == [0, 1]  # the first command takes effect at 0.1 s
    np.testing.assert_array_equal(film.held, expected)
    assert age_scale(film).norm.vmin == pytest.approx(0.1)  # without the ages before it


def test_a_gif_keeps_time_and_stays_small(tmp_path: Path) -> None:
    path = animate(a_run(held=0.3), tmp_path / "new" / "run.gif", static_map=ROOM, fps=12.0, until=4.0)
    with Image.open(path) as film:
        durations = []
        for number in range(film.n_frames):
            film.seek(number)
            durations.append(film.info["duration"])
        assert film.info["loop"] == 0
    assert sum(durations[:-1]) == pytest.approx(4000, abs=100) and durations[-1] == 1500
    assert len(durations) == 49 and path.stat().st_size < 300_000
    assert [each.name for each in path.parent.iterdir()] == ["run.gif"]


def test_a_gif_shows_the_frames_with_a_white_ground(tmp_path: Path) -> None:
    path = animate(a_run(8), tmp_path / "run.gif", until=2.0, fps=5.0)
    drawn = list(frames(a_run(8), until=2.0, fps=5.0))
    with Image.open(path) as film:
        film.seek(5)
        shown = np.asarray(film.convert("RGB"), int)
    assert (shown[drawn[5].min(axis=-1) == 255] == 255).all()
    assert np.abs(shown - drawn[5]).mean() < 1.0


def test_an_mp4_goes_to_ffmpeg_frame_by_frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tool = tmp_path / "ffmpeg"
    tool.write_text('#!/bin/sh\nfor last; do :; done\necho "$@" > "$0.args"\ncat > "$last"\n', encoding="utf-8")
    tool.chmod(tool.stat().st_mode | stat.S_IEXEC)
    monkeypatch.setattr(shutil, "which", lambda name: str(tool))
    path = write_film(frames(a_run(), fps=4.0, until=2.0), tmp_path / "run.mp4", 4.0)
    expected = list(frames(a_run(), fps=4.0, until=2.0))
    assert path.read_bytes() == np.stack(expected).tobytes()
    height, width = expected[0].shape[:2]
    assert f"-s {width}x{height} -r 4 " in (tmp_path / "ffmpeg.args").read_text(encoding="utf-8")
    tool.write_text("#!/bin/sh\necho no such codec >&2\nexit 1\n", encoding="utf-8")
    with pytest.raises(ValueError, match="ffmpeg could not write .*: no such codec"):
        write_film(frames(a_run(), fps=4.0, until=2.0), tmp_path / "other.mp4", 4.0)
    assert not (tmp_path / "other.mp4").exists()


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="no ffmpeg")
def test_ffmpeg_makes_an_mp4(tmp_path: Path) -> None:
    path = animate(a_run(), tmp_path / "run.mp4", until=2.0)
    assert b"ftyp" in path.read_bytes()[:12]


def test_a_film_of_another_kind_or_without_ffmpeg_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(ValueError, match="there is no ffmpeg on this machine"):
        animate(a_run(), tmp_path / "run.mp4")
    with pytest.raises(ValueError, match="got 'run.avi', expected a name that ends in gif or mp4"):
        animate(a_run(), tmp_path / "run.avi")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "change", "message"),
    [
        ({"fps": 0.0}, {}, "fps: got 0"),
        ({"until": -1.0}, {}, "until: got -1"),
        ({}, {"age": np.zeros((3, 2))}, r"age: got shape \(3, 2\), expected \(120, 2\)"),
        ({}, {"command": np.full((120, 2, 2), np.inf)}, "command: got inf"),
    ],
)
def test_a_bad_film_is_named(options: dict[str, float], change: dict[str, np.ndarray], message: str) -> None:
    given = a_run()
    vars(given).update(change)
    with pytest.raises(ValueError, match=message):
        frames(given, **options)  # type: ignore[arg-type]


@pytest.fixture
def composer() -> Iterator[None]:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        yield


def config(*options: str) -> ShowConfig:
    return load(ShowConfig, compose("show", list(options)))


def test_show_writes_the_run_and_its_figures(composer: None, tmp_path: Path) -> None:
    shown = run(config("scenario=crossing", "scenario.horizon=3", "show.until=1", "show.seed=4"), tmp_path)
    figures = {path.name for path in (tmp_path / "figures").iterdir()}
    assert figures == {"trajectories.png", "trajectories.pdf", "run.gif"}
    table = pd.read_csv(tmp_path / "run.csv")
    assert len(table) == 2 * 301
    np.testing.assert_allclose(table["x"], np.asarray(shown.run.pose)[..., 0].ravel(), rtol=1e-8)
    record = json.loads((tmp_path / "record.json").read_text(encoding="utf-8"))
    assert record["auc"] == pytest.approx(list(shown.run.auc)) and record["deadline"] == 0.22
    assert record["arrival_time"] == [None, None]
    lines = report(shown).splitlines()
    assert lines[1].startswith(f"robot 1: AUC {shown.run.auc[0]:.3f} s, does not stay") and len(lines) == 4
    assert not np.allclose(run(config("scenario=crossing", "scenario.horizon=3")).run.pose[0], shown.run.pose[0])


STACK = ("scenario=doorway", "controller=navigation", "loop.tau=0.05", "scenario.horizon=1.5", "show.at=1.0",
         "controller.mppi.batch_size=50", "show.robot=2", "show.until=0.5")  # fmt: skip


@pytest.mark.slow
def test_show_sees_what_each_stack_saw(composer: None) -> None:
    shown = run(config(*STACK))
    assert [each.robot for each in shown.views] == [0, 1]
    for number, each in enumerate(shown.views):
        assert each.time == pytest.approx(1.0)
        np.testing.assert_allclose(np.asarray(each.poses), shown.run.pose[20])
        assert np.shape(each.rollout_x) == (50, 56)
        np.testing.assert_allclose(np.asarray(each.path)[-1], np.asarray(shown.run.goal)[number], atol=0.05)
        other = np.asarray(each.obstacles) == 254
        x, y = each.grid.centres()  # type: ignore[attr-defined]
        seen = (np.broadcast_to(x, other.shape)[other].mean(), np.broadcast_to(y, other.shape)[other].mean())
        assert np.hypot(*(seen - shown.run.pose[20, 1 - number, :2])) < 0.4  # as old as it is known


@pytest.mark.slow
def test_show_draws_the_costmaps_of_the_stack(composer: None, tmp_path: Path) -> None:
    run(config(*STACK), tmp_path)
    figures = {path.name for path in (tmp_path / "figures").iterdir()}
    assert {"costmaps.png", "costmap_robot2.png", "run.gif", "trajectories.png"} <= figures


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["show.robot=3"], "show.robot: got 3, expected 1 to 2"),
        (["show.format=avi"], "show.format: got 'avi', expected one of gif, mp4"),
        (["show.format=mp4"], "there is no ffmpeg on this machine"),
        (["show.fps=0"], "show.fps: got 0.0, expected > 0"),
        (["show.at=31"], "show.at: got 31.0, expected <= 30"),
        (["show.until=0"], "show.until: got 0.0, expected > 0"),
        (["show.deadline_ms=-1"], "show.deadline_ms: got -1.0, expected >= 0"),
        (["scenario.map=nowhere.yaml"], "nowhere.yaml"),
    ],
)
def test_show_refuses_bad_options_before_it_simulates(
    options: list[str], message: str, composer: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with jax.disable_jit(), pytest.raises(ValueError, match=message):
        run(config(*options))


@pytest.mark.slow
def test_a_single_robot_has_costmaps_at_a_quarter_of_the_time(composer: None) -> None:
    options = ("scenario=single", "controller=navigation", "loop.tau=0.1", "scenario.horizon=2",
               "controller.mppi.batch_size=20")  # fmt: skip
    (only,) = run(config(*options)).views
    assert only.time == pytest.approx(0.5)
    assert not np.asarray(only.obstacles).any()
