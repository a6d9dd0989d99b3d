"""The local controller for robots that move sideways and for cars: Nav2's Omni and Ackermann."""

from __future__ import annotations

import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hydra import compose, initialize_config_dir

from qocjax import Design, Scenario, paper_network, simulate
from qocjax.config import StudyConfig, conf_dir, load
from qocjax.navigation import (
    STACK_MPPI,
    ConstraintCritic,
    MapCosts,
    MppiConfig,
    NavigationStack,
    initial_state,
    open_floor,
    step,
)
from qocjax.navigation.critics import Point, Scene
from qocjax.navigation.feasible import feasible
from qocjax.robots import Ackermann, Command, Holonomic, Unicycle
from qocjax.study import replay

OMNI = MppiConfig(batch_size=8, time_steps=22, motion_model="Omni", sgf_order=0, gamma=0.0)
CAR = replace(OMNI, motion_model="Ackermann", min_turning_r=0.5)
KEY = jax.random.key(3)
PATH, GOAL = jnp.stack([jnp.linspace(-3, 3, 20), jnp.zeros(20)], axis=1), jnp.array([3.0, 0.0, 0.0])
FLOOR = MapCosts(jnp.zeros((60, 80)), 0.1, (-4.0, -3.0))
RNG = np.random.default_rng(5)

cycle = jax.jit(step, static_argnames=("config", "record"))


def scene(config: MppiConfig) -> Scene:
    """One of which only the caps are read."""
    caps = (jnp.array(each) for each in (0.6, -0.3, 1.5, 0.4))
    radius = config.min_turning_r if config.motion_model == "Ackermann" else None
    return Scene(*(jnp.zeros(0),) * 5, 0.05, 0.05, *caps, radius)  # type: ignore[arg-type, misc]


def test_the_price_of_what_is_beyond_the_caps() -> None:
    """As constraint_critic.cpp has it: the signed length of the velocity, or the radius that a circle lacks."""
    vx, vy, wz = RNG.uniform(-1.2, 1.2, (3, 50))
    wz[:5], vx[5:8] = 0.0, 0.0
    nothing, critic = jnp.zeros(50), ConstraintCritic(cost_weight=3.0)
    omni = critic.cost(critic.term(Point(*(nothing,) * 4, vx, wz, vy), scene(OMNI)), None, None)  # type: ignore[arg-type]
    car = critic.cost(critic.term(Point(*(nothing,) * 4, vx, wz, None), scene(CAR)), None, None)  # type: ignore[arg-type]
    for k in range(50):
        length = math.copysign(math.hypot(vx[k], vy[k]), vx[k])
        excess = max(length - math.hypot(0.6, 0.4), 0) + max(-math.hypot(0.3, 0.4) - length, 0)
        assert float(omni[k]) == pytest.approx(3.0 * 0.05 * excess)
        tight = max(0.5 - abs(vx[k]) / max(abs(wz[k]), 1e-6), 0)
        excess = max(vx[k] - 0.6, 0) + max(-0.3 - vx[k], 0) + tight
        assert float(car[k]) == pytest.approx(3.0 * 0.05 * excess)


def test_sequences_keep_the_caps_and_limits_of_each_model() -> None:
    now = Command(jnp.array(0.1), jnp.array(0.1), jnp.array(-0.1))
    drawn = Command(*(jnp.asarray(each) for each in RNG.uniform(-2, 2, (3, 200))))
    config = replace(OMNI, ax_max=1.0, ax_min=-2.0, ay_max=1.5, ay_min=-1.5, az_max=None)
    found = feasible(config, now, drawn, scene(config))
    nu, left = np.asarray(found.nu), np.asarray(found.nu_y)
    assert (nu[0], left[0]) == (0.1, -0.1) and nu.max() <= 0.6 and nu.min() >= -0.3 and np.abs(left).max() <= 0.4
    away = np.where(nu[:-1] > 0, 1, -1) * np.diff(nu)  # from standstill
    assert away.max() <= 0.05 + 1e-12 and away.min() >= -0.1 - 1e-12 and np.abs(np.diff(left)).max() <= 0.075 + 1e-12
    told = feasible(replace(config, motion_model="Ackermann", min_turning_r=0.5), replace(now, nu_y=None),
                    replace(drawn, nu_y=None), scene(CAR))  # fmt: skip
    nu, omega = np.asarray(told.nu), np.asarray(told.omega)
    assert np.all(np.abs(omega) <= np.abs(nu) / 0.5 + 1e-12) and np.any(np.abs(omega) > 0.9 * np.abs(nu) / 0.5)


def test_rollouts_move_sideways() -> None:
    """Without noise all are the sequence itself, by many small steps; and that to be sent is its second command."""
    config = replace(OMNI, vx_std=0.0, vy_std=0.0, wz_std=0.0, vy_max=0.45)
    t = np.linspace(0, 1, 22)
    vx, vy, wz = (jnp.asarray(each) for each in (0.3 - 0.1 * t, 0.2 * t, 0.5 * t))
    state = replace(initial_state(config), vx=vx, vy=vy, wz=wz)
    begin = jnp.array([0.3, 0.2, 0.4])
    command, after, rollouts = cycle(config, state, begin, FLOOR, PATH, GOAL, KEY, record=True)
    x, y, theta = (float(each) for each in begin)
    for k in range(22):
        row = max(k - 1, 0)  # a sample is driven a step after its place
        ahead, left, turn = (float(each[row]) for each in (vx, vy, wz))
        for _ in range(2000):
            middle = theta + turn * 0.05 / 4000
            x += (ahead * math.cos(middle) - left * math.sin(middle)) * 0.05 / 2000
            y += (ahead * math.sin(middle) + left * math.cos(middle)) * 0.05 / 2000
            theta += turn * 0.05 / 2000
        np.testing.assert_allclose([rollouts.x[:, k], rollouts.y[:, k]], [[x] * 8, [y] * 8], atol=1e-8)
    np.testing.assert_allclose([command.nu, command.nu_y, command.omega], [vx[1], vy[1], wz[1]])
    assert after.vy is not None and after.past_vy is not None


@pytest.mark.slow
def test_speeds_to_the_side_are_drawn_too() -> None:
    """Independent of the others, with their own spread; what is averaged follows the weights."""
    config = replace(OMNI, batch_size=2000, vx_std=0.0, wz_std=0.0, vy_std=0.1, ax_max=None, ax_min=None, ay_max=None,
                     ay_min=None, az_max=None)  # fmt: skip
    _, _, rollouts = cycle(config, initial_state(config), jnp.zeros(3), FLOOR, PATH, GOAL, KEY, record=True)
    ends = np.asarray(rollouts.y)[:, -1]
    assert np.all(np.asarray(rollouts.x) == 0.0) and ends.std() == pytest.approx(0.05 * 0.1 * math.sqrt(20), rel=0.06)


# --- in the closed loop

TAU = 0.05


def stack(scenario: Scenario, **values: object) -> NavigationStack:
    robot = scenario.robot
    radius = {"min_turning_r": float(np.asarray(robot.min_turning_r))} if isinstance(robot, Ackermann) else {}
    mppi = replace(STACK_MPPI, batch_size=64, time_steps=14, motion_model=robot.motion_model, **radius)
    return NavigationStack(open_floor(scenario), mppi=mppi, **values)  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("robot", [Holonomic(), Ackermann(0.3, 0.5)])
def test_prediction_is_where_the_robot_is_when_its_command_takes_effect(robot: Holonomic | Ackermann) -> None:
    scenario = Scenario(horizon=1.0, robot=robot)
    run = simulate(scenario, Design(tau=TAU, deadline=0.2), np.zeros((20, 2)), controller=stack(scenario, predict=True))
    np.testing.assert_allclose(np.asarray(run.view.begin)[:16], np.asarray(run.pose)[4:20], atol=1e-9)
    assert np.any(np.asarray(run.command) != 0, axis=(0, 1)).all()


@pytest.mark.slow
@pytest.mark.parametrize("robot", [Holonomic(), Ackermann(0.3, 0.5)])
def test_each_drives_to_its_goal(robot: Holonomic | Ackermann) -> None:
    scenario = Scenario(horizon=15.0, start=[[-2.0, -1.0, 0.3]], normaliser="goal_distance", robot=robot)
    own = stack(scenario)
    own = replace(own, mppi=replace(own.mppi, batch_size=300, time_steps=56))
    run = simulate(scenario, Design(tau=TAU, deadline=0.0), np.zeros((300, 1)), controller=own)
    assert np.hypot(*(np.asarray(run.pose)[-1, 0, :2] - scenario.goal)) <= own.xy_goal_tolerance * 1.05
    assert float(run.path_length[0]) < 1.15 * np.hypot(4.0, 1.0)
    if isinstance(robot, Ackermann):
        nu, omega = np.moveaxis(np.asarray(run.command)[:, 0], -1, 0)
        assert np.all(np.abs(omega) <= np.abs(nu) / float(robot.min_turning_r) + 1e-9)


@pytest.mark.slow
def test_a_replay_of_the_configuration() -> None:
    for name, model in (("holonomic", "Omni"), ("f1tenth", "Ackermann")):
        with initialize_config_dir(str(conf_dir().resolve()), version_base="1.3"):
            options = [f"robot={name}", "controller=navigation", "loop.tau=0.05", "scenario.horizon=2",
                       "controller.mppi.batch_size=50"]  # fmt: skip
            config = load(StudyConfig, compose("sweep", options))
        found = config.build_controller()
        assert isinstance(found, NavigationStack) and found.mppi.motion_model == model
        assert found.mppi.min_turning_r == pytest.approx(0.3302 / math.tan(0.4189) if name == "f1tenth" else 0.2)
        design = replace(config.baseline(), deadline=0.2)
        run = replay(config.build_scenario(), design, paper_network(), 0, controller=found)
        assert np.isfinite(np.asarray(run.auc)).all()


def test_rollouts_of_another_robot_are_refused() -> None:
    scenario = Scenario(horizon=1.0, robot=Holonomic())
    with pytest.raises(ValueError, match=r"mppi.motion_model: got DiffDrive for the robot Holonomic, expected Omni"):
        simulate(scenario, Design(tau=TAU), np.zeros((20, 2)), controller=NavigationStack(open_floor(scenario)))

    class Strange(Unicycle):
        motion_model = None

    jax.tree_util.register_static(Strange)
    with pytest.raises(ValueError, match=r"robot: got Strange, whose motion the navigation stack does not know"):
        simulate(replace(scenario, robot=Strange()), Design(tau=TAU), np.zeros((20, 2)),
                 controller=NavigationStack(open_floor(scenario)))  # fmt: skip
    with pytest.raises(ValueError, match=r"motion_model: got 'Legs', expected one of DiffDrive, Omni, Ackermann"):
        MppiConfig(motion_model="Legs")
    with pytest.raises(ValueError, match=r"min_turning_r: got 0, expected > 0"):
        MppiConfig(min_turning_r=0)
