"""What a robot was seen to do: known drives give their caps, accelerations and sizes, and no noise."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from bags import AMCL, ODOM, PLACED, POLYGON, TWIST, Message, outline, pose, speeds, write_bag
from hydra import compose, initialize_config_dir

from qocjax.commands.ingest import run as ingest_run
from qocjax.commands.robot_seen import robot_seen
from qocjax.config import conf_dir, load
from qocjax.config.ingest import IngestConfig
from qocjax.config.robot import RobotConfig
from qocjax.config.robots import presets
from qocjax.config.trace import TraceConfig
from qocjax.recorded import RecordedRun
from qocjax.recorded.accelerations import accelerations
from qocjax.recorded.findings import Findings
from qocjax.recorded.footprint import Outline, footprint_of
from qocjax.recorded.limits import driven_speeds
from qocjax.recorded.limits import speeds as largest_speeds
from qocjax.recorded.nearest import Preset, nearest_preset
from qocjax.recorded.series import Cleaning, Series
from qocjax.recorded.text import run_lines

ROOT = Path(__file__).parents[1]
RATE = 0.05  # s
PAPER = RobotConfig(v_max=0.7, omega_max=1.4, radius=0.105)
SQUARE = [(0.2, 0.1), (-0.2, 0.1), (-0.2, -0.1), (0.2, -0.1)]


def series(time: np.ndarray, *columns: np.ndarray, frame: str = "odom") -> Series:
    none = np.full(time.size, np.nan)
    values = np.column_stack([*columns, *[0.0 * time] * (3 - len(columns))])
    return Series(time, time, time, none, values, ODOM, frame)


def ramps(
    rate: float, up: float, down: float, top: float = 0.4, seconds: float = 200.0
) -> tuple[np.ndarray, np.ndarray]:
    """Times, and speeds that rise at `up` and fall at `down` every 10 s."""
    time = np.arange(0.0, seconds, 1.0 / rate)
    return time, np.clip(np.minimum(up * (time % 10 - 1), down * (8 - time % 10)), 0.0, top)


# --- speeds and accelerations


@pytest.mark.parametrize(("rate", "noise"), [(20, 0.0), (20, 0.005), (50, 0.01), (100, 0.01), (12, 0.005)])
def test_accelerations_of_ramps_are_found(rate: float, noise: float) -> None:
    time, nu = ramps(rate, 0.5, 0.8)
    rng = np.random.default_rng(1)
    told = nu + noise * rng.normal(size=time.size), -2.0 * nu + 2.0 * noise * rng.normal(size=time.size)
    found = accelerations(series(time, *told))
    assert found is not None and found.ax_max is not None and found.ax_min is not None and found.az_max is not None
    assert 0.2 <= found.window <= 5.0 / rate + 0.2
    assert found.ax_max == pytest.approx(0.5, rel=0.1) and found.ax_min == pytest.approx(-0.8, rel=0.1)
    assert found.az_max == pytest.approx(1.6, rel=0.1)
    assert found.ax_noise < 0.5 and (found.ax_noise > 0) == (noise > 0)


@pytest.mark.parametrize("noise", [1e-4, 0.01, 0.1])
def test_noise_of_steady_driving_is_no_acceleration(noise: float) -> None:
    rng = np.random.default_rng(3)
    time = np.arange(0.0, 1000.0, RATE)
    steady = [0.3 + noise * rng.normal(size=time.size) for _ in range(2)]
    found = accelerations(series(time, *steady))
    assert found is not None and (found.ax_max, found.ax_min, found.az_max) == (None, None, None)


def test_the_noise_is_that_of_driving() -> None:
    """A robot that stands most of the time, without noise, and drives with it, did not accelerate as its noise does."""
    rng = np.random.default_rng(4)
    time = np.arange(0.0, 400.0, RATE)
    driving = time > 300.0
    omega = np.where(driving, 1.0 + 0.1 * rng.normal(size=time.size), 0.0)
    ramp = np.clip(0.5 * (time - 299.0), 0.0, 1.0)
    found = accelerations(series(time, 0.2 * ramp, np.where(time > 301.0, omega, ramp)))
    assert found is not None and found.ax_max == pytest.approx(0.1) and found.ax_noise < 0.01
    assert found.az_noise > 1.0 and found.az_max is None


def test_single_spikes_and_gaps_are_no_accelerations() -> None:
    time, nu = ramps(20, 0.5, 0.5)
    nu[[700, 1500]] += 1.0
    kept = np.ones(time.size, bool)
    kept[1000:1085] = False  # from standing to full speed
    found = accelerations(series(time[kept], nu[kept]))
    assert found is not None and found.ax_max == pytest.approx(0.5, rel=0.05)
    assert found.ax_min == pytest.approx(-0.5, rel=0.05)


def test_too_little_says_nothing() -> None:
    time, nu = ramps(20, 0.5, 0.5)
    assert accelerations(series(time[:4], nu[:4])) is None
    assert accelerations(series(time, 0 * nu)) is None  # it stands
    assert accelerations(series(np.zeros(50), np.full(50, 0.2))) is None  # no time passes
    seldom, slow = ramps(1, 0.5, 0.5)
    assert accelerations(series(seldom, slow)) is None
    assert largest_speeds(np.full((3, 3), 9.0), Cleaning()) is None  # outliers all


def test_speeds_count_ways_apart() -> None:
    nu = np.concatenate([np.full(400, 0.2), [0.25], np.full(50, -0.1), np.zeros(500), [9.0]])
    omega = np.concatenate([np.full(300, -0.5), np.zeros(nu.size - 300)])
    found = largest_speeds(np.column_stack([nu, omega]), Cleaning())
    assert found is not None
    assert (found.forward, found.forward_max) == (0.2, 0.25)  # 99 % of 401
    assert (found.backward, found.backward_max) == (0.1, 0.1) and (found.turn, found.turn_max) == (0.5, 0.5)


def test_twists_that_a_driver_leaves_empty_are_those_of_the_poses() -> None:
    time = np.arange(0.0, 40.0, RATE)
    poses = series(time, np.sin(0.2 * time), 1.0 - np.cos(0.2 * time), 0.2 * time)  # a circle of 1 m at 0.2 m/s
    findings = Findings()
    found = driven_speeds(series(time, 0 * time), poses, "speeds of a", Cleaning(), findings)
    assert found is not None and "its twists are 0 although it moves" in findings.notes[0]
    np.testing.assert_allclose(found.values[:, :2], 0.2, rtol=1e-3)
    still = driven_speeds(series(time, 0 * time), series(time, 0 * time), "speeds of a", Cleaning(), Findings())
    assert still is not None and not still.values.any()


# --- footprints


def test_circles_of_footprints() -> None:
    found = footprint_of([Outline(0, "base_link", SQUARE)] * 3, [], 0, "footprint", Findings())
    assert found is not None and (found.centre, found.corners, found.messages) == ("base", 4, 3)
    assert found.radius == pytest.approx(np.hypot(0.2, 0.1)) and found.inscribed == pytest.approx(0.1)
    ahead = [(x + 0.1, y) for x, y in SQUARE]
    for frame, centre, radius in (
        ("a/base_footprint", "base", np.hypot(0.3, 0.1)),
        ("odom", "middle", np.hypot(0.2, 0.1)),
    ):
        found = footprint_of([Outline(0, frame, ahead)], [], 0, "footprint", Findings())
        assert found is not None and found.centre == centre and found.radius == pytest.approx(radius)


def test_a_footprint_where_the_robot_is_goes_about_its_pose() -> None:
    """Nav2 publishes it in the frame of the costmap: a footprint that is not centred keeps its radius only so."""
    time = np.arange(0.0, 10.0, RATE)
    poses = series(time, 5.0 + 0.2 * time, 0.0 * time, 0.3 + 0.0 * time)
    ahead, begin = np.array(SQUARE) + (0.1, 0.0), 1_700_000_000_000_000_000
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    messages = [
        Outline(
            begin + round(1e9 * at), "odom", [(float(x), float(y)) for x, y in ahead @ turn.T + (5.0 + 0.2 * at, 0.0)]
        )
        for at in (1.0, 4.0, 8.5)
    ]
    found = footprint_of(messages, [poses], begin, "footprint", Findings())
    assert found is not None and found.centre == "pose"
    assert found.radius == pytest.approx(np.hypot(0.3, 0.1)) and found.inscribed == pytest.approx(0.1)
    other = footprint_of(messages, [replace(poses, frame="map")], begin, "footprint", Findings())
    assert other is not None and other.centre == "middle" and other.radius == pytest.approx(np.hypot(0.2, 0.1))


@pytest.mark.parametrize(
    "corners",
    [[], [(0.0, 0.0), (1.0, 0.0)], [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)], [(0.0, 0.0), (1.0, 0.0), (0.5, np.nan)]],
)
def test_what_is_no_area_is_no_footprint(corners: list[tuple[float, float]]) -> None:
    findings = Findings()
    assert footprint_of([Outline(0, "base_link", corners)], [], 0, "footprint", findings) is None
    assert findings.total("no_footprint") == 1 and "expected 3 finite corners or more" in findings.notes[0]
    good = footprint_of([Outline(0, "base_link", corners), Outline(0, "", SQUARE)], [], 0, "footprint", Findings())
    assert good is not None and good.messages == 1


# --- presets

KNOWN = (Preset("slow", 0.2, 2.0, 0.1), Preset("quick", 1.0, 1.0, 0.3))


@pytest.mark.parametrize(
    ("seen", "name", "near"),
    [
        ((0.2, 2.0, 0.1), "slow", True),
        ((0.19, 0.3, None), "slow", True),  # it hardly turned, which says nothing of its cap
        ((0.21, None, None), "slow", True),
        ((0.2, 2.5, None), "slow", False),  # no robot turns faster than it can
        ((0.25, 1.0, None), "slow", False),
        ((0.95, 1.05, 0.3), "quick", True),
        ((1.0, 1.0, 0.1), "quick", False),  # too small
    ],
)
def test_the_nearest_preset(seen: tuple[float, float | None, float | None], name: str, near: bool) -> None:
    found = nearest_preset(*seen, KNOWN)
    assert found is not None and (found.name, found.near) == (name, near)


def test_every_preset_is_nearest_to_itself() -> None:
    assert {"turtlebot3_burger", "turtlebot3_waffle_pi", "turtlebot4"} <= {each.name for each in presets()}
    for each in presets():
        found = nearest_preset(each.v_max, each.omega_max, each.radius, presets())
        assert found is not None and found.near and found.name == each.name and found.v_max == found.radius == 0.0
    assert nearest_preset(None, 1.0, 0.1, presets()) is None


# --- bags


def drive(
    robot: str = "", seconds: float = 60.0, top: float = 0.3, twists: bool = True, bad: float = 0.0
) -> list[Message]:
    """A robot that is told 20 times a second to go, back and turn, and does so 0.1 s later."""
    name = f"/{robot}" if robot else ""
    time = np.arange(0.0, seconds, RATE)
    nu = np.clip(np.minimum(0.6 * (time % 8 - 1), 0.6 * (6 - time % 8)), 0.0, top) - 0.1 * (time % 8 > 7)
    omega = 0.9 * np.sign(np.sin(0.7 * time)) * (nu > 0)
    done = [np.interp(time - 0.1, time, each) for each in (nu, omega)]
    heading = np.cumsum(done[1]) * RATE
    x, y = np.cumsum(done[0] * np.cos(heading)) * RATE, np.cumsum(done[0] * np.sin(heading)) * RATE
    messages: list[Message] = []
    for k, at in enumerate(time.tolist()):
        driven = (float(done[0][k]) if k % 50 or not bad else bad, float(done[1][k])) if twists else (0.0, 0.0)
        placed = pose(ODOM, at, float(x[k]), float(y[k]), float(heading[k]), "odom", driven)
        messages.append((at, f"{name}/odom", ODOM, placed))
        messages.append((at + 1e-3, f"{name}/cmd_vel", TWIST, speeds(float(nu[k]), float(omega[k]))))
    return messages


def read(path: Path, *options: str, folder: Path | None = None) -> RecordedRun:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        config = load(IngestConfig, compose("ingest", [f"path='{path}'", "figures=false", *options]))
    return ingest_run(config, folder, quiet=True).runs[0]


def test_a_bag_says_what_its_robot_did(tmp_path: Path) -> None:
    messages = drive()
    messages += [(at, "/footprint", POLYGON, outline(POLYGON, at, SQUARE)) for at in (1.0, 2.0, 3.0)]
    path = write_bag(tmp_path / "bag", sorted(messages, key=lambda each: each[0]))
    run = read(path, folder=tmp_path / "out")
    seen = run.limits["robot"]
    assert seen.commanded is not None and seen.driven is not None and seen.accelerations is not None
    assert seen.commanded.forward == pytest.approx(0.3) and seen.commanded.backward == pytest.approx(0.1)
    assert seen.driven.turn == pytest.approx(0.9) and seen.v_max == pytest.approx(0.3)
    assert seen.accelerations.ax_max == pytest.approx(0.6, rel=0.35)  # a step back to standing is in it too
    assert seen.footprint is not None and seen.footprint.radius == pytest.approx(np.hypot(0.2, 0.1), abs=1e-6)
    assert seen.nearest is not None and seen.nearest.name in ("turtlebot4", "turtlebot3_waffle_pi")
    report = run.commands["robot"]
    assert report.period_low == pytest.approx(RATE) and report.period_high == pytest.approx(RATE)
    text = "\n".join(run_lines(run, None))
    for words in ("told to drive: up to 0.3 m/s forwards, 0.1 m/s backwards, 0.9 rad/s", "5 and 95 %: 50, 50 ms",
                  "footprint of 4 corners, in its own frame: within 0.224 m", "it can do at least v_max 0.3 m/s",
                  "nearest preset: "):  # fmt: skip
        assert words in text
    written = yaml.safe_load((tmp_path / "out" / "runs" / "bag" / "limits.yaml").read_text())
    assert written["robot"]["v_max"] == pytest.approx(0.3) and written["robot"]["footprint"]["corners"] == 4
    row = pd.read_csv(tmp_path / "out" / "robots.csv").iloc[0]
    assert row["told_backward"] == pytest.approx(0.1) and row["seen_omega_max"] == pytest.approx(0.9)


def test_two_robots_are_told_apart(tmp_path: Path) -> None:
    both = sorted(drive("a") + drive("b", top=0.2), key=lambda each: each[0])
    run = read(write_bag(tmp_path / "bag", both))
    assert {name: round(seen.v_max or 0.0, 3) for name, seen in run.limits.items()} == {"a": 0.3, "b": 0.2}
    seen = robot_seen(run, PAPER, "paper", chosen=False)
    assert seen.options == {} and "the bag shows several, a, b" in seen.text
    with pytest.raises(ValueError, match="delays from commands to motion of 2 robots, a, b; expected"):
        TraceConfig(kind="trace", path=str(tmp_path / "bag")).build()


def test_dirt_is_counted_and_left_out(tmp_path: Path) -> None:
    counts = {}
    for name, bad in (("nan", np.nan), ("inf", np.inf), ("fast", 40.0)):
        run = read(write_bag(tmp_path / name, drive(bad=bad)))
        assert run.limits["robot"].v_max == pytest.approx(0.3)
        assert run.quality is not None and run.quality.time.size > 1190  # no pose is lost for it
        counts[name] = {each.cause: each.count for each in run.findings if each.where == "speeds of robot"}
    assert counts == {"nan": {"not_finite": 24}, "inf": {"not_finite": 24}, "fast": {"outlier_speeds": 24}}


def test_bags_that_show_less_say_less(tmp_path: Path) -> None:
    only_told = [each for each in drive() if each[2] == TWIST]
    seen = read(write_bag(tmp_path / "told", only_told)).limits["robot"]
    assert seen.driven is None and seen.accelerations is None and seen.v_max == pytest.approx(0.3)
    only_odometry = [each for each in drive() if each[2] == ODOM]
    seen = read(write_bag(tmp_path / "driven", only_odometry)).limits["robot"]
    assert seen.commanded is None and seen.v_max == pytest.approx(0.3, rel=0.01)
    with pytest.raises(ValueError, match="holds no commands, whose stamps or motion tell how long loops take"):
        TraceConfig(kind="trace", path=str(tmp_path / "driven")).build()
    empty = read(write_bag(tmp_path / "empty", drive(twists=False)))
    assert any("its twists are 0 although it moves" in note for note in empty.findings.notes)
    assert empty.limits["robot"].driven is not None
    assert empty.limits["robot"].driven.forward == pytest.approx(0.3, rel=0.02)
    located = [(RATE * k, "/amcl_pose", AMCL, pose(AMCL, RATE * k, 0.01 * k, 0.0, 0.0)) for k in range(100)]
    assert read(write_bag(tmp_path / "located", located)).limits == {}


def test_odometry_counts_beside_other_poses(tmp_path: Path) -> None:
    located = [(1.0 * k, "/amcl_pose", AMCL, pose(AMCL, 1.0 * k, 0.1 * k, 0.0, 0.0)) for k in range(60)]
    shown = [(3.0, "/local_costmap/published_footprint", PLACED, outline(PLACED, 3.0, [(1.0, 1.0), (1.1, 1.0)]))]
    run = read(write_bag(tmp_path / "bag", sorted(drive() + located + shown, key=lambda each: each[0])))
    assert run.quality is not None and run.limits["robot"].driven is not None
    assert run.limits["robot"].footprint is None and run.findings.total("no_footprint") == 1


# --- advice


def test_advice_takes_what_a_bag_shows_and_says_so(tmp_path: Path) -> None:
    shown = [(1.0, "/footprint", POLYGON, outline(POLYGON, 1.0, SQUARE))]
    write_bag(tmp_path / "bag", sorted(drive() + shown, key=lambda each: each[0]))
    run = TraceConfig(kind="trace", path=str(tmp_path / "bag")).read()
    seen = robot_seen(run, PAPER, "paper", chosen=False)
    rates = {name: pytest.approx(value, rel=0.1) for name, value in (("ax_max", 0.6), ("ax_min", -0.6), ("az_max", 11))}
    assert seen.options == {"v_max": 0.3, "omega_max": 0.9, "radius": 0.224, **rates}
    assert "as the bag shows it: v_max 0.3 m/s, omega_max 0.9 rad/s, radius 0.224 m" in seen.text
    assert "it can do that at least" in seen.text and "robot.v_max=... say otherwise" in seen.text
    given = robot_seen(run, PAPER.model_copy(update={"v_max": 0.2}), "paper", chosen=True)
    assert given.options == {} and "as given. The bag shows more: v_max 0.3 m/s." in given.text
    nothing = robot_seen(replace(run, limits={}), PAPER, "paper", chosen=False)
    assert nothing.options == {} and nothing.text == ""


def test_a_robot_that_hardly_turned_keeps_the_preset_s_turn_rate(tmp_path: Path) -> None:
    straight = [(RATE * k, "/cmd_vel", TWIST, speeds(0.2, 0.01 * (k % 2))) for k in range(200)]
    run = read(write_bag(tmp_path / "bag", straight))
    seen = robot_seen(run, PAPER, "paper", chosen=False)
    assert seen.options == {"v_max": 0.2}
    assert "Of robot=paper, as the bag does not show them: omega_max 1.4 rad/s, radius 0.105 m" in seen.text


def test_the_command_line_advises_on_the_robot_of_the_bag(tmp_path: Path) -> None:
    """It stops at bounds beyond the caps that it took, before it simulates."""
    write_bag(tmp_path / "bag", drive())
    line = [sys.executable, "-m", "qocjax.advise", "path=bag", "advise.bounds.v_max=[0.1,0.5]", "hydra.run.dir=out"]
    done = called(line, tmp_path)
    assert "ROBOT  as the bag shows it: v_max 0.3 m/s, omega_max 0.9 rad/s, ax_max" in done.stdout
    assert done.returncode == 2 and "expected at most the robot's 0.3" in done.stderr


@pytest.mark.slow
def test_the_command_line_keeps_a_robot_that_was_chosen(tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", drive())
    line = [sys.executable, "-m", "qocjax.advise", "path=bag", "advise.bounds.v_max=[0.1,0.8]", "robot=paper"]
    done = called([*line, "hydra.run.dir=out"], tmp_path)
    assert "ROBOT  v_max 0.7 m/s, omega_max 1.4 rad/s, radius 0.105 m, as given." in done.stdout
    assert done.returncode == 2 and "expected at most the robot's 0.7" in done.stderr


def called(line: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "JAX_PLATFORMS": "cpu"}
    return subprocess.run(line, cwd=folder, env=environment, capture_output=True, encoding="utf-8", timeout=300)


def test_measured_robots_are_known(shared_data: Path) -> None:
    for name, robot, preset in (
        ("turtlebot3-bags", "robot", "turtlebot3_burger"),
        ("turtlebot4-bags", "turtle01", "turtlebot4"),
    ):
        if not (shared_data / name).is_dir():
            pytest.skip(f"no {name} among the measured data")
        seen = read(shared_data / name).limits[robot].nearest
        assert seen is not None and seen.near and seen.name == preset
