"""Robots that take time to reach the speed they are told: against many small steps, and at the limits."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import DEADLINES, HOLD_OPTIONS, MODES, GivenNetwork, a_case, assert_same_run
from hydra import compose, initialize_config_dir
from scipy.integrate import solve_ivp

from qocjax import Acceleration, Design, Scenario, Unicycle, evaluate, gradient, paper_network, simulate
from qocjax._math import EXACT
from qocjax.config import conf_dir, load
from qocjax.config.study import StudyConfig
from qocjax.robots import Command, Pose, arc, pose_from
from qocjax.robots.acceleration import drive, parts

SLOW = Acceleration(ax_max=1.0, ax_min=-1.7, az_max=2.5)
RNG = np.random.default_rng(3)


def at(nu: float, omega: float) -> Command:
    """Speeds of one robot."""
    return Command(jnp.array([nu]), jnp.array([omega]))


def followed(limits: Acceleration, speed: Command, command: Command, h: float) -> tuple[Pose, Command]:
    """Pose and speeds after h seconds, from the origin."""
    pose = pose_from(jnp.zeros((1, 3)))
    for part in parts(speed, command, jnp.asarray(h), limits):
        pose, speed = drive(pose, part, EXACT), part.end
    return pose, speed


@pytest.mark.parametrize("k", range(12))
def test_motion_solves_its_differential_equation(k: int) -> None:
    """Speeds up, down and through standstill; pieces that end on the way, and long after."""
    speed, command = RNG.uniform(-1, 1, (2, 2))
    up, down, turn = RNG.uniform(0.5, 4, 3)
    h = float(RNG.choice([0.01, 0.05, 0.1]))

    def slope(t: float, y: np.ndarray) -> list[float]:
        gap, rate = command - y[3:], (down if y[3] * (command[0] - y[3]) < 0 else up, turn)
        return [y[3] * np.cos(y[2]), y[3] * np.sin(y[2]), y[4],
                *(np.clip(g / 1e-7, -r, r) for g, r in zip(gap, rate, strict=True))]  # fmt: skip

    times = np.linspace(0, h, 2001)
    y = solve_ivp(slope, (0, h), [0, 0, 0, *speed], "LSODA", rtol=1e-10, atol=1e-12, max_step=times[1]).y[:, -1]
    pose, end = followed(Acceleration(up, -down, turn), at(*speed), at(*command), h)
    got = [float(each[0]) for each in (pose.x, pose.y, pose.heading, end.nu, end.omega)]
    np.testing.assert_allclose(got, y, atol=2e-6)
    assert float(pose.cos[0]) == pytest.approx(np.cos(y[2]), abs=2e-6)


@pytest.mark.parametrize("k", [0, 5, 7, 10], ids=lambda k: "-".join(MODES[k]))
def test_the_loop_like_the_slow_loop(k: int) -> None:
    for n, kind in enumerate(DEADLINES):
        case = a_case(np.random.default_rng(10 * k + n), kind, num_robots=2, ticks=12, horizon=1.3, choice=k)
        case = replace(case, scenario=replace(case.scenario, robot=Unicycle(SLOW)))
        run, slow = (
            simulate(case.scenario, case.design, case.loop_times, *MODES[k], **HOLD_OPTIONS),
            case.slow(*MODES[k]),
        )
        assert_same_run(run, slow, rtol=2e-5)
        np.testing.assert_allclose(run.auc, slow["auc"], rtol=5e-3)  # a curved reference counts as straight


def test_the_area_like_the_slow_loop() -> None:
    case = a_case(np.random.default_rng(2), "typical", num_robots=2, ticks=65, horizon=1.3)
    case = replace(case, scenario=replace(case.scenario, robot=Unicycle(SLOW)))
    run = simulate(case.scenario, case.design, case.loop_times)
    np.testing.assert_allclose(run.auc, case.slow()["auc"], rtol=2e-5)


def test_limits_are_kept_and_infinite_ones_are_none() -> None:
    scenario, design = Scenario(horizon=9.0), Design(deadline=0.2)
    times = np.random.default_rng(1).uniform(0.1, 0.3, (900, 2))
    free, unlimited, slow = (
        simulate(replace(scenario, robot=Unicycle(each)), design, times) for each in (None, Acceleration(), SLOW)
    )
    np.testing.assert_allclose(unlimited.pose, free.pose, atol=1e-6)
    np.testing.assert_allclose(unlimited.auc, free.auc, rtol=1e-6)
    assert np.array_equal(free.speed, free.command)
    change = np.diff(np.asarray(slow.speed), axis=0) / 0.01
    assert change[..., 0].max() == pytest.approx(1.0) and change[..., 0].min() == pytest.approx(-1.7)
    assert np.abs(change[..., 1]).max() == pytest.approx(2.5)
    assert np.all(np.asarray(slow.auc) > np.asarray(free.auc))
    only_turns = simulate(replace(scenario, robot=Unicycle(Acceleration(az_max=0.5))), design, times)
    assert np.abs(np.diff(np.asarray(only_turns.speed)[..., 1], axis=0)).max() == pytest.approx(0.005)
    assert np.diff(np.asarray(only_turns.speed)[..., 0], axis=0).max() > 0.1


@pytest.mark.slow
def test_batches_and_float32_are_the_single_run() -> None:
    scenario = Scenario(robot=Unicycle(SLOW), start_jitter=(0.0, 0.0), horizon=8.0)
    designs = Design(kappa=np.array([1.0, 2.0]), deadline=np.array([0.2, 0.25]))
    both = [evaluate(scenario, designs, paper_network(), [0, 1, 2], dtype=dtype) for dtype in ("float64", "float32")]
    for name in ("auc", "path_length", "effort", "min_distance"):
        np.testing.assert_allclose(both[1][name], both[0][name], rtol=2e-3, err_msg=name)
    free = evaluate(replace(scenario, robot=Unicycle()), designs, paper_network(), [0, 1, 2], dtype="float64")
    assert (both[0]["auc"] > free["auc"]).all()


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["forward", "reverse"])
def test_gradients(mode: str) -> None:
    scenario, at, step = (
        Scenario(robot=Unicycle(SLOW), horizon=1.5, start_jitter=(0.0, 0.0)),
        np.array([0.1, 2.1]),
        1e-6,
    )

    def designs(points: np.ndarray) -> Design:
        return Design(kappa=points[:, 0], gamma=points[:, 1], tau=0.1, deadline=0.17)

    found = gradient(scenario, designs(at[None]), GivenNetwork(), [0], mode=mode, dtype=jnp.float64)
    slope = [float(found[f"d_auc_{name}"].sum()) for name in ("kappa", "gamma")]
    ends = at + step * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    auc = evaluate(scenario, designs(ends), GivenNetwork(), [0], dtype=jnp.float64)["auc"].values.mean(axis=(1, 2))
    np.testing.assert_allclose(slope, (auc[::2] - auc[1::2]) / (2 * step), rtol=1e-5, atol=1e-6)


def test_an_arc_is_the_limit_of_a_drive() -> None:
    command = at(0.6, 1.2)
    pose, _ = followed(Acceleration(), command, command, 0.1)
    exact = arc(pose_from(jnp.zeros((1, 3))), command, 0.1, EXACT)
    jax.tree.map(lambda one, other: np.testing.assert_allclose(one, other, rtol=1e-9), pose, exact)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"ax_max": 0.0}, r"ax_max: got 0.0, expected a number above 0"),
        ({"ax_min": 2.5}, r"ax_min: got 2.5, expected a number below 0"),
        ({"az_max": float("nan")}, r"az_max: got nan, expected a number above 0"),
        ({"az_max": [1.0, 2.0]}, r"az_max: got \[1.0, 2.0\], expected a number above 0"),
    ],
)
def test_wrong_limits(limits: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Scenario(robot=Unicycle(Acceleration(**limits)))
    with pytest.raises(TypeError, match="acceleration: got 2.5, expected an Acceleration or None"):
        Scenario(robot=Unicycle(2.5))  # type: ignore[arg-type]


def test_the_robot_of_the_configuration() -> None:
    with initialize_config_dir(str(conf_dir().resolve()), version_base="1.3"):
        built = [
            load(StudyConfig, compose("sweep", list(options))).build_scenario().robot
            for options in ((), ("robot=turtlebot3_burger",), ("robot.az_max=2.0",))
        ]
        assert built == [Unicycle(each) for each in (None, Acceleration(3.0, -2.5, 3.2), Acceleration(az_max=2.0))]
        with pytest.raises(ValueError, match=r"ax_min: got 2.5, expected a number below 0"):
            load(StudyConfig, compose("sweep", ["robot.ax_min=2.5"])).build_scenario()
