"""Robots: each against the slow loop and closed forms, a user's own one, and what is refused."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import DEADLINES, HOLD_OPTIONS, MODES, GivenNetwork, a_case, assert_same_run
from hydra import compose, initialize_config_dir

from qocjax import Design, Run, Scenario, evaluate, gradient, paper_network, replay, simulate
from qocjax._math import EXACT
from qocjax.config import StudyConfig, conf_dir, load
from qocjax.controllers import Cbf
from qocjax.figures.animation import film_of
from qocjax.figures.scene import Scene
from qocjax.robots import Ackermann, Command, Holonomic, Robot, Unicycle, pose_from

ROOT = Path(__file__).parents[1]
CAR = Ackermann(0.3, 0.5)
KINDS = [Holonomic(), CAR]


def config(*options: str) -> StudyConfig:
    with initialize_config_dir(str(conf_dir().resolve()), version_base="1.3"):
        return load(StudyConfig, compose("sweep", list(options)))


def at(nu: float, omega: float, nu_y: float | None = None) -> Command:
    """Command of one robot."""
    return Command(*(None if each is None else jnp.array([each]) for each in (nu, omega, nu_y)))  # type: ignore[arg-type]


def alone(robot: Robot, heading: float = 0.4, **options: object) -> Run:
    """One robot on its way to (2, 0) with every loop at once."""
    scenario = Scenario(start=[[-1.0, 0.5, heading]], horizon=4.0, robot=robot, normaliser="goal_distance")
    design = Design(deadline=0.0, tau=0.1, **options)  # type: ignore[arg-type]
    return simulate(scenario, design, np.zeros((40, 1)))


# --- motion


@pytest.mark.parametrize("robot", KINDS, ids=lambda each: type(each).__name__)
@pytest.mark.parametrize("k", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2, 3, 5, 7, 10))],
                         ids=lambda k: "-".join(MODES[k]))  # fmt: skip
def test_the_loop_like_the_slow_loop(robot: Robot, k: int) -> None:
    for n, kind in enumerate(DEADLINES):
        case = a_case(np.random.default_rng(10 * k + n), kind, num_robots=2, ticks=12, horizon=1.3, choice=k)
        case = replace(case, scenario=replace(case.scenario, robot=robot))
        run = simulate(case.scenario, case.design, case.loop_times, *MODES[k], **HOLD_OPTIONS)
        slow = case.slow(*MODES[k])
        assert_same_run(run, slow)
        np.testing.assert_allclose(run.auc, slow["auc"], rtol=1e-2, atol=1e-4)  # a curved reference counts as straight


@pytest.mark.slow
@pytest.mark.parametrize("robot", KINDS, ids=lambda each: type(each).__name__)
def test_the_area_like_the_slow_loop(robot: Robot) -> None:
    case = a_case(np.random.default_rng(2), "typical", num_robots=2, ticks=130, horizon=1.3)
    case = replace(case, scenario=replace(case.scenario, robot=robot))
    run = simulate(case.scenario, case.design, case.loop_times)
    np.testing.assert_allclose(run.auc, case.slow()["auc"], rtol=1e-5)


def test_a_holonomic_body_that_turns_drives_an_exact_arc() -> None:
    command, pose = at(0.3, 1.1, -0.5), pose_from(jnp.array([[0.2, -0.1, 0.7]]))
    steps = Holonomic().move(pose, None, command, jnp.array([0.4]), EXACT)
    assert len(steps) == 1
    t = np.linspace(0, 0.4, 200_001)
    heading = 0.7 + 1.1 * t
    x = 0.2 + np.trapezoid(0.3 * np.cos(heading) + 0.5 * np.sin(heading), t)
    y = -0.1 + np.trapezoid(0.3 * np.sin(heading) - 0.5 * np.cos(heading), t)
    end = steps[0].pose
    np.testing.assert_allclose([end.x[0], end.y[0], end.heading[0]], [x, y, heading[-1]], atol=1e-10)
    np.testing.assert_allclose([end.cos[0], end.sin[0]], [np.cos(heading[-1]), np.sin(heading[-1])], atol=1e-12)
    assert float(steps[0].length[0]) == pytest.approx(0.4 * np.hypot(0.3, 0.5))
    assert float(steps[0].effort[0]) == pytest.approx(0.4 * (0.3**2 + 0.5**2 + 1.1**2))


def test_a_holonomic_robot_alone_is_the_sampled_integrator() -> None:
    """Straight at the cap, then p_{k+1} - p* = (1 - kappa tau)(p_k - p*): whatever its heading, which stays."""
    run = alone(Holonomic(), heading=2.5, v_max=0.7, kappa=2.0)
    place, goal, found = np.array([-1.0, 0.5]), np.array([2.0, 0.0]), []
    for _ in range(41):
        found.append(place)
        wanted = 2.0 * (goal - place)
        place = place + 0.1 * wanted * min(1.0, 0.7 / np.hypot(*wanted))
    np.testing.assert_allclose(np.asarray(run.pose)[:, 0, :2], found, atol=1e-12)
    assert np.all(np.asarray(run.pose)[..., 2] == 2.5)
    np.testing.assert_allclose(np.hypot(*np.asarray(run.command)[:20, 0, [0, 2]].T), 0.7)
    assert float(run.path_length[0]) == pytest.approx(np.hypot(*(found[-1] - found[0])))
    assert list(run.to_pandas().columns) == ["time", "robot", "x", "y", "heading", "nu", "omega", "nu_y", "age"]


def test_a_car_drives_on_its_tightest_circle_and_backs_up() -> None:
    """It stands across its goal: no turn is tighter than its steering allows, and behind it is reached backwards."""
    run = alone(CAR, heading=1.8, gamma=50.0, omega_max=50.0)
    nu, omega = np.moveaxis(np.asarray(run.command)[:, 0], -1, 0)
    radius = 0.3 / np.tan(0.5)
    assert np.all(np.abs(omega) <= np.abs(nu) / radius * (1 + 1e-12))
    assert float(CAR.min_turning_r) == pytest.approx(radius)
    gap = np.hypot(*(np.asarray(run.pose)[-1, 0, :2] - (2.0, 0.0)))
    back = alone(CAR, heading=np.pi, v_max=2.0)
    assert np.all(np.asarray(back.command)[:20, 0, 0] < 0)
    assert gap < radius  # nearer than that to its side no circle leads there
    assert np.hypot(*(np.asarray(back.pose)[-1, 0, :2] - (2.0, 0.0))) < 0.05
    free = alone(Ackermann(1e-9, 1.0), heading=0.2)  # so tight that its steering is none
    np.testing.assert_allclose(free.pose, alone(Unicycle(), heading=0.2).pose, atol=1e-9)


@pytest.mark.parametrize("robot", KINDS, ids=lambda each: type(each).__name__)
def test_a_robot_told_more_than_it_can_does_what_it_can(robot: Robot) -> None:
    told = at(0.5, 3.0, 0.1 if robot.holonomic else None)
    (piece,) = robot.move(pose_from(jnp.zeros((1, 3))), None, told, jnp.array([0.1]), EXACT)
    most = 3.0 if robot.holonomic else 0.5 / float(CAR.min_turning_r)
    assert float(piece.pose.heading[0]) == pytest.approx(0.1 * most) == pytest.approx(0.1 * float(piece.speed.omega[0]))


# --- batches and gradients


@pytest.mark.parametrize("robot", [KINDS[0], pytest.param(CAR, marks=pytest.mark.slow)])
def test_batches_and_float32_are_the_single_run(robot: Robot) -> None:
    scenario = Scenario(robot=robot, start_jitter=(0.0, 0.0), horizon=2.0)
    designs = Design(kappa=np.array([1.0, 2.0]), deadline=0.25, tau=0.05)
    both = [evaluate(scenario, designs, GivenNetwork(), [0, 1], dtype=dtype) for dtype in ("float64", "float32")]
    times = np.asarray(GivenNetwork().draw(jax.random.key(0), 40, 2, 0.05))
    for row, kappa in enumerate((1.0, 2.0)):
        run = simulate(scenario, Design(kappa=kappa, deadline=0.25, tau=0.05), times)
        for name in ("auc", "path_length", "effort", "min_distance"):
            np.testing.assert_allclose(both[0][name].values[row, 0], getattr(run, name), rtol=1e-9, err_msg=name)
            np.testing.assert_allclose(both[1][name].values[row, 0], getattr(run, name), rtol=2e-3, err_msg=name)


@pytest.mark.parametrize("mode", ["forward", pytest.param("reverse", marks=pytest.mark.slow)])
@pytest.mark.parametrize("robot", [CAR, pytest.param(KINDS[0], marks=pytest.mark.slow)])
def test_gradients(robot: Robot, mode: str) -> None:
    scenario, point, step = Scenario(robot=robot, horizon=1.5, start_jitter=(0.0, 0.0)), np.array([0.1, 0.5]), 1e-6

    def designs(points: np.ndarray) -> Design:
        return Design(kappa=points[:, 0], v_max=points[:, 1], tau=0.1, deadline=0.17)

    names = ("kappa", "v_max")
    found = gradient(scenario, designs(point[None]), GivenNetwork(), [0], names, mode=mode, dtype=jnp.float64)
    slope = [float(found[f"d_auc_{name}"].sum()) for name in names]
    ends = point + step * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    auc = evaluate(scenario, designs(ends), GivenNetwork(), [0], dtype=jnp.float64)["auc"].values.mean(axis=(1, 2))
    np.testing.assert_allclose(slope, (auc[::2] - auc[1::2]) / (2 * step), rtol=1e-5, atol=1e-6)


def test_the_barrier_keeps_holonomic_robots_apart() -> None:
    """They move as they are told, which the barrier is made for: without delay none comes nearer than d_safe."""
    scenario, design = Scenario(robot=Holonomic(), horizon=8.0), Design(deadline=0.0, tau=0.01)
    run = simulate(scenario, design, np.zeros((800, 2)), controller=Cbf())
    assert float(run.min_distance) > 0.5 - 1e-6 and float(run.report["squeezed"].sum()) == 0


# --- bags and films


def test_bags_and_films_have_the_speed_to_the_left(tmp_path: Path) -> None:
    """linear.y of the commands and of odometry, on the axes of the body; the arrow of a film points where it drives."""
    rosbags = pytest.importorskip("rosbags.highlevel")
    run = jax.tree.map(np.asarray, alone(Holonomic(), heading=1.0))
    found: dict[str, list[list[float]]] = {"/robot0/cmd_vel": [], "/robot0/odom": []}
    with rosbags.AnyReader([run.to_bag(tmp_path / "bag")]) as reader:
        for connection, _, data in reader.messages():
            if connection.topic in found:
                twist = reader.deserialize(data, connection.msgtype).twist
                twist = getattr(twist, "twist", twist)
                found[connection.topic].append([twist.linear.x, twist.angular.z, twist.linear.y])
    np.testing.assert_allclose(found["/robot0/cmd_vel"], run.command[:, 0])  # another each tick
    np.testing.assert_allclose(found["/robot0/odom"][:-1], run.speed[:, 0])
    scene = Scene(film_of(run), None, "")
    scene.at(5)
    step = run.pose[6, 0, :2] - run.pose[5, 0, :2]
    np.testing.assert_allclose([float(scene.speed.U[0]), float(scene.speed.V[0])], step / 0.1, atol=1e-9)


# --- one of a user's own


def write_example(folder: Path) -> None:
    """The file of the guide."""
    (text,) = re.findall(r"```python\n(# lag\.py\n.*?)```", (ROOT / "docs" / "robots.md").read_text(), re.DOTALL)
    assert len([line for line in text.splitlines() if line.strip()]) <= 30
    (folder / "lag.py").write_text(text)


def test_the_example_of_the_guide(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_example(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    kind = import_module("lag").Lag
    assert config("robot._target_=lag.Lag", "+robot.time_constant=0.1").build_scenario().robot == kind(0.1)
    scenario, design = Scenario(horizon=5.0, start_jitter=(0.0, 0.0)), Design(deadline=0.2)
    times = np.full((500, 2), 0.1)
    quick, slow = (simulate(replace(scenario, robot=kind(lag)), design, times) for lag in (1e-3, 0.3))
    np.testing.assert_allclose(quick.pose, simulate(scenario, design, times).pose, atol=0.02)
    assert np.all(np.asarray(slow.auc) > np.asarray(quick.auc))
    speed = np.asarray(slow.speed)[:, 0, 0]
    told = np.asarray(slow.command)[:-1, 0, 0]
    np.testing.assert_allclose(speed[1:], told + np.exp(-0.01 / 0.3) * (speed[:-1] - told), atol=1e-12)
    with pytest.raises(ValueError, match=r"time_constant: got 0.0, expected a number above 0"):
        Scenario(robot=kind(0.0))


@pytest.mark.slow
def test_the_example_in_batches_and_from_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_example(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    scenario, design = Scenario(horizon=5.0, robot=import_module("lag").Lag(0.3)), Design(deadline=0.2)
    runs = evaluate(scenario, design, paper_network(), [0, 1], dtype="float64")
    single = replay(scenario, design, paper_network(), 1)
    np.testing.assert_allclose(runs["auc"].values[0, 1], single.auc, rtol=1e-9)
    line = [sys.executable, "-m", "qocjax.sweep", "robot._target_=lag.Lag", "+robot.time_constant=0.1", "sweep=kappa",
            "sweep.grids.kappa=[1,2]", "sweep.deadline_ms=[200]", "sweep.seeds=2", "sweep.evaluation_seeds=2",
            "hydra.run.dir=out"]  # fmt: skip
    environment = os.environ | {"PYTHONPATH": str(ROOT), "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, encoding="utf-8", timeout=300)
    assert done.returncode == 0, done.stderr
    again = [*line[:3], "resume=out"]
    done = subprocess.run(again, cwd=tmp_path, env=environment, capture_output=True, encoding="utf-8", timeout=300)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "lag.py").open("a") as file:
        file.write("# another robot\n")
    done = subprocess.run(again, cwd=tmp_path, env=environment, capture_output=True, encoding="utf-8", timeout=300)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr


# --- the configuration, and what is refused


def test_the_robots_of_the_configuration() -> None:
    built = [config(f"robot={name}", *more).build_scenario().robot for name, *more in (
        ("paper",), ("holonomic",), ("ackermann",), ("f1tenth", "robot.max_steering=0.6"))]  # fmt: skip
    assert float(Ackermann().min_turning_r) == pytest.approx(0.2, abs=1e-4)
    assert built == [Unicycle(), Holonomic(), Ackermann(), Ackermann(0.3302, 0.6)]
    known = config("robot=ackermann")
    assert StudyConfig.model_validate(known.model_dump()).build_scenario().robot == Ackermann()
    assert known.model_dump()["robot"]["_target_"] == "qocjax.robots.Ackermann"


def test_a_study_leaves_out_what_a_robot_does_not_read() -> None:
    study = config("robot=holonomic")
    assert set(study.build_grid().sweep) == {"v_max", "eta", "tau", "kappa", "c_miss"}
    assert study.beyond() == ["sweep.grids.gamma: left out, a Holonomic does not read it"]
    assert config().beyond() == []
    with pytest.raises(
        ValueError, match=r"sweep.grids: got gamma, which a Holonomic does not read, expected something"
    ):
        config("robot=holonomic", "sweep=gamma").build_grid()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ["robot=holonomic", "robot.ax_max=1.0"],
            r"robot.ax_max: got 1, but Holonomic obeys commands at once, expected n",
        ),
        (
            ["robot=ackermann", "robot.az_max=1.0"],
            r"robot.az_max: got 1, but Ackermann obeys commands at once, expected n",
        ),
        (["+robot.wheelbase=1.0"], r"robot.wheelbase: got an unknown option of Unicycle, expected none of its own"),
        (
            ["robot=ackermann", "+robot.whelbase=1"],
            r"robot.whelbase: got an unknown option of Ackermann, expected one of wh",
        ),
        (["robot=ackermann", "robot.wheelbase=0"], r"wheelbase: got 0, expected > 0"),
        (["robot=ackermann", "robot.max_steering=2"], r"max_steering: got 2, expected <= 1.5"),
        (["robot=ackermann", "robot.wheelbase=long"], r"wheelbase: got 'long' \(str\), expected a real number"),
        (
            ["robot._target_=my.own.Robot"],
            r"robot._target_: got my.own.Robot, but there is no module my, expected one that Python finds",
        ),
        (["robot._target_=Robot"], r"robot._target_: got 'Robot', expected a class by its full name"),
        (["robot._target_=qocjax.robots.Robots"], r"robot._target_: .* has no Robots, expected a class"),
        (["robot._target_=qocjax.robots.Pose"], r"robot._target_: got qocjax.robots.Pose, .* a Robot and a dataclass"),
        (
            ["robot._target_=qocjax.robots.Robot"],
            r"robot._target_: got qocjax.robots.Robot, .* a Robot and a dataclass",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(options: list[str], message: str) -> None:
    with pytest.raises((ValueError, TypeError), match=message):
        config(*options).build_scenario()


def test_values_that_a_robot_does_not_read_are_not_varied() -> None:
    scenario, designs = Scenario(robot=Holonomic()), Design(gamma=np.array([1.0, 2.0]))
    for law in (None, Cbf()):
        with pytest.raises(
            ValueError, match=r"gamma: got several values, but the robot \(Holonomic\) does not read it"
        ):
            evaluate(scenario, designs, paper_network(), [0], controller=law)
    with pytest.raises(ValueError, match=r"wrt: got gamma, which the robot \(Holonomic\) does not read"):
        gradient(scenario, Design(), paper_network(), [0])
    with pytest.raises(TypeError, match=r"robot: got 3, expected a Robot that is registered as a pytree"):
        Scenario(robot=3)  # type: ignore[arg-type]
