"""The navigation stack in the closed loop."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest
import xarray as xr

from qocjax import (
    Acceleration,
    Design,
    Rules,
    Scenario,
    evaluate,
    one_at_a_time,
    paper_network,
    replay,
    run_study,
    simulate,
)
from qocjax._math import EXACT
from qocjax.closed_loop import Plan
from qocjax.controllers import Apf
from qocjax.controllers.held import held
from qocjax.navigation import (
    STACK_MPPI,
    Disc,
    Grid,
    Inflation,
    MppiConfig,
    NavigationStack,
    Planner,
    Rectangle,
    StaticMap,
    map_of_shapes,
    open_floor,
    snapshot,
)
from qocjax.navigation.cycle import _back_up
from qocjax.network import Constant, LoopNetwork
from qocjax.robots import Command, Pose, Unicycle, arc
from qocjax.single import _simulate

TAU = 0.05
SMALL = replace(STACK_MPPI, batch_size=64, time_steps=14)
SHORT = Scenario(horizon=1.0)
FLOOR = open_floor(SHORT)
STACK = NavigationStack(FLOOR, mppi=SMALL)
AT_ONCE = LoopNetwork(name="at once", compute=Constant(0.0))


def design(deadline: float = 0.2, **values: object) -> Design:
    return Design(tau=TAU, deadline=deadline, **values)  # type: ignore[arg-type]


def times(ticks: int = 20, robots: int = 2, value: float = 0.0) -> np.ndarray:
    return np.full((ticks, robots), value)


def test_open_floor_holds_starts_and_goals() -> None:
    x_from, x_to, y_from, y_to = FLOOR.grid.extent
    assert (x_from, y_from) == pytest.approx((-3.0, -2.5)) and (x_to, y_to) == pytest.approx((3.0, 2.5))
    assert not FLOOR.cost.any()


def test_reaches_the_goal_without_delay() -> None:
    stack = NavigationStack(FLOOR, mppi=replace(STACK_MPPI, batch_size=300))
    scenario = Scenario(horizon=15.0, start=[[-2.0, -1.5, 0.3]], normaliser="goal_distance")
    run = simulate(scenario, design(0.0), times(300, 1), controller=stack)
    assert np.hypot(*(np.asarray(run.pose)[-1, 0, :2] - scenario.goal)) <= stack.xy_goal_tolerance * 1.05
    assert float(run.arrival_time[0]) < 9.0
    assert np.all(np.asarray(run.command)[-1] == 0.0)
    # With nothing in the way the robot drives near its cap: the path is hardly longer than the straight line.
    assert float(run.path_length[0]) < 1.1 * np.hypot(4.0, 1.5)
    assert float(run.report["no_path_share"][0]) == float(run.report["blocked_share"][0]) == 0.0


def test_a_run_takes_what_is_made_of_the_map_as_arguments() -> None:
    """So that a large map is not traced, lowered and compiled with it; what its program holds is smaller than a map."""
    scenario = replace(SHORT, start=np.asarray(SHORT.start))
    room = open_floor(SHORT, resolution=0.02)
    cost = room.cost.copy()
    cost[:2], cost[7, ::3] = 254, 254
    stack = NavigationStack(StaticMap(room.grid, cost), mppi=SMALL)
    plan = Plan(Rules(), EXACT, 8, None, record=True, controller=stack)
    args = scenario, design(), times(), jax.random.key_data(jax.random.key(0)), held(stack)
    lines = jax.jit(_simulate, static_argnums=5).lower(*args, plan).as_text().splitlines()
    assert any("stablehlo.constant" in line for line in lines) and max(map(len, lines)) < cost.size
    assert held(Apf()) == ()


CAPS = np.array([0.4, 0.7])
SEEDS = (3, 8, 9)


@pytest.fixture(scope="module")
def batch() -> xr.Dataset:
    return evaluate(SHORT, design(v_max=CAPS), paper_network(), SEEDS, controller=STACK, dtype=np.float64)


def test_batch_equals_single_runs(batch: xr.Dataset) -> None:
    for g, cap in enumerate(CAPS):
        for s, seed in enumerate(SEEDS):
            single = replay(SHORT, design(v_max=cap), paper_network(), seed, controller=STACK)
            for name in ("auc", "path_length", "effort"):
                np.testing.assert_allclose(batch[name].values[g, s], getattr(single, name), rtol=1e-6)
            np.testing.assert_allclose(batch["blocked_share"].values[g, s], single.report["blocked_share"])
    assert batch["auc"].dims == batch["no_path_share"].dims == ("design", "seed", "robot")
    # The seeds differ: they draw starts, loop times and rollouts of their own.
    assert len(np.unique(batch["effort"].values)) == 12


def test_float32_agrees_with_float64_over_a_short_run(batch: xr.Dataset) -> None:
    narrow = evaluate(SHORT, design(v_max=CAPS), paper_network(), SEEDS, controller=STACK)
    assert narrow["auc"].dtype == np.float32
    np.testing.assert_allclose(narrow["auc"], batch["auc"], rtol=1e-3)


@pytest.mark.parametrize("deadline", [pytest.param(0.2, marks=pytest.mark.slow), 0.23])
def test_prediction_is_where_the_robot_is_when_its_command_takes_effect(deadline: float) -> None:
    run = simulate(SHORT, design(deadline), times(), controller=replace(STACK, predict=True))
    x, y, heading = np.moveaxis(np.asarray(run.pose)[4:20], -1, 0)
    nu, omega = np.moveaxis(np.asarray(run.command)[4:], -1, 0)
    # Between sampling instants the command before it is still in force.
    there = arc(Pose(x, y, np.cos(heading), np.sin(heading), heading), Command(nu, omega), deadline - 0.2, EXACT)
    np.testing.assert_allclose(
        np.asarray(run.view.begin)[:16], np.stack([there.x, there.y, there.heading], -1), atol=1e-9
    )


@pytest.mark.slow
def test_prediction_knows_that_speeds_take_time_to_change() -> None:
    slow = replace(SHORT, robot=Unicycle(Acceleration(0.8, -1.0, 1.5)))
    run = simulate(slow, design(0.2), times(), controller=replace(STACK, predict=True))
    np.testing.assert_allclose(np.asarray(run.view.begin)[:16], np.asarray(run.pose)[4:20], atol=1e-9)
    begin = np.stack([np.asarray(run.view.speed.nu), np.asarray(run.view.speed.omega)], -1)
    np.testing.assert_allclose(begin[:16], np.asarray(run.speed)[4:20], atol=1e-9)


def test_predictions_of_other_robots_leave_one_period_unknown_without_loss() -> None:
    run = simulate(SHORT, design(0.2), times(), controller=replace(STACK, predict=True))
    begin, discs, sent = np.asarray(run.view.begin), run.view.obstacles, np.asarray(run.command)[..., 0]
    for robot, other in ((0, 1), (1, 0)):
        np.testing.assert_array_equal(np.asarray(discs.x)[:, robot, 0], begin[:, other, 0])
        np.testing.assert_array_equal(np.asarray(discs.y)[:, robot, 0], begin[:, other, 1])
        # From the fifth instant on a robot applies the command of four sampling periods ago.
        np.testing.assert_allclose(np.asarray(discs.speed)[5:, robot, 0], np.abs(sent[5:, other]) * TAU, atol=1e-9)


def test_without_prediction_rollouts_start_where_the_robot_was_sampled() -> None:
    run = simulate(SHORT, design(0.2), times(), controller=STACK)
    np.testing.assert_array_equal(run.view.begin, np.asarray(run.pose)[:-1])


@pytest.mark.parametrize("deadline", [0.0, 0.2, 0.23])
def test_rollouts_start_at_the_speed_that_the_robot_drives(deadline: float) -> None:
    run = simulate(SHORT, design(deadline), times(), controller=STACK)
    for seen, told in ((run.view.speed.nu, 0), (run.view.speed.omega, 1)):
        assert np.all(np.asarray(seen)[0] == 0.0)
        driven = np.asarray(run.command)[..., told]
        if deadline == 0.23:  # commands change 30 ms after an instant: what is in force at it already was before
            driven = np.append(driven[1:], driven[-1:], axis=0)
        np.testing.assert_array_equal(np.asarray(seen)[1:-1], driven[:-2])


@pytest.mark.slow
def test_a_robot_that_holds_nothing_stands_when_it_is_sampled() -> None:
    lost = np.zeros((20, 2))
    lost[8:] = np.inf
    run = simulate(SHORT, design(0.0), lost, hold="zero", controller=STACK)
    assert np.all(np.asarray(run.view.speed.nu)[8] != 0.0) and np.all(np.asarray(run.view.speed.nu)[9:] == 0.0)


@pytest.mark.parametrize("deadline", [pytest.param(0.2, marks=pytest.mark.slow), 0.23])
def test_predicted_rollouts_start_at_the_speed_of_the_command_before(deadline: float) -> None:
    run = simulate(SHORT, design(deadline), times(), controller=replace(STACK, predict=True))
    later = 3 if deadline == 0.2 else 4  # sampling instants until the last command is in force at one
    for seen, told in ((run.view.speed.nu, 0), (run.view.speed.omega, 1)):
        np.testing.assert_allclose(
            np.asarray(seen)[1 : 20 - later], np.asarray(run.command)[1 + later :, :, told], atol=1e-12
        )


def test_other_robots_are_seen_where_they_were_an_age_ago() -> None:
    run = simulate(SHORT, design(0.2), times(), controller=STACK)
    pose, age = np.asarray(run.pose), np.asarray(run.age)
    for tick in (0, 2, 4, 5, 13, 19):
        for robot, other in ((0, 1), (1, 0)):
            then = tick - round(age[tick, other] / TAU)
            seen = np.asarray(run.view.obstacles.x)[tick, robot, 0], np.asarray(run.view.obstacles.y)[tick, robot, 0]
            np.testing.assert_allclose(seen, pose[then, other, :2], atol=1e-12)
            # At the speed that it was last told, in that command: it takes effect four sampling periods later.
            speed = abs(np.asarray(run.command)[then + 4, other, 0]) if tick else 0.0
            wide = np.asarray(run.view.obstacles.speed)[tick, robot, 0]
            assert wide == pytest.approx(speed * age[tick, other], abs=1e-9)


@pytest.mark.slow
def test_widening_is_capped() -> None:
    lost = np.full((60, 2), np.inf)
    lost[10] = 0.0  # one command, held for the rest of the run
    run = simulate(replace(SHORT, horizon=3.0), design(0.0), lost, controller=replace(STACK, max_widening=0.12))
    wide = np.asarray(run.view.obstacles.speed)
    assert wide.max() == 0.12 and np.all(np.diff(wide[12:], axis=0) >= 0)


@pytest.mark.slow
def test_plans_at_its_own_rate() -> None:
    stack = replace(STACK, planner_period=0.25)
    run = simulate(SHORT, design(), times(), controller=stack)
    changed = np.any(np.diff(np.asarray(run.view.path), axis=0) != 0, axis=(1, 2, 3))
    assert set(np.flatnonzero(changed) + 1) <= {5, 10, 15} and changed.any()


@pytest.mark.slow
def test_goal_that_no_path_leads_to_is_reported_and_the_robot_stays() -> None:
    # A ring of walls around the goal.
    ring = [Rectangle((2.0, y), (1.6, 0.1)) for y in (-0.8, 0.8)] + [
        Rectangle((x, 0.0), (0.1, 1.6)) for x in (1.2, 2.8)
    ]
    walled = replace(STACK, static_map=map_of_shapes(FLOOR.grid, ring))
    run = simulate(SHORT, design(0.0), times(), controller=walled)
    np.testing.assert_array_equal(run.report["no_path_share"], 1.0)
    np.testing.assert_array_equal(np.asarray(run.command), 0.0)


@pytest.mark.parametrize(
    ("walls", "speed"),
    [((), -0.15), ((0.3,), -0.15), ((-0.3,), 0.15), ((-0.3, 0.3), 0.0)],
    ids=["open", "wall ahead", "wall behind", "both"],
)
def test_recovery_goes_back_and_ahead_only_where_it_cannot(walls: tuple[float, ...], speed: float) -> None:
    grid = Grid.covering((-1.0, -1.0), (1.0, 1.0), 0.05)
    room = map_of_shapes(grid, [Rectangle((x, 0.0), (0.1, 2.0)) for x in walls])
    dear_behind = np.where(grid.centres()[0] < 0, 200.0, 0.0)  # costly, not closed
    cost = np.maximum(room.cost, dear_behind)
    assert float(_back_up(replace(STACK, static_map=room), np.zeros(3), cost)) == pytest.approx(speed)


@pytest.mark.slow
def test_backs_up_where_every_rollout_collides() -> None:
    # A wall just ahead, so near that the robot is in the closed zone that uncertainty adds to it.
    grid = Grid.covering((-1.0, -1.0), (1.0, 1.0), 0.05)
    wall = map_of_shapes(grid, [Rectangle((0.35, 0.0), (0.1, 2.0))])
    sure = NavigationStack(wall, Inflation(), mppi=replace(SMALL, vx_min=0.0))
    scenario = Scenario(start=[[0.15, 0.0, 0.0]], goal=[-0.7, 0.6], horizon=0.5, normaliser="goal_distance")
    unsure = replace(sure, inflation=Inflation(localisation_sigma=0.05))
    with pytest.raises(ValueError, match="start: got .* nearer to an obstacle than the robot's radius"):
        simulate(scenario, design(0.0), times(10, 1), controller=unsure)
    # Two robots that stand closer than their uncertainty allows; the second one blocks the first.
    floor = NavigationStack(map_of_shapes(grid), unsure.inflation, mppi=replace(SMALL, vx_min=0.0))
    facing = Scenario(
        start=[[-0.12, 0.0, 0.0], [0.12, 0.0, np.pi]], goal=[[0.7, 0.0], [-0.7, 0.0]], horizon=0.5,
        normaliser="goal_distance", reference_per_robot=True,
    )  # fmt: skip
    run = simulate(facing, design(0.0), times(10), controller=floor)
    assert np.asarray(run.report["blocked_share"]).min() > 0
    assert np.asarray(run.command)[0, :, 0] == pytest.approx(-floor.backup_speed)
    assert np.abs(np.diff(np.asarray(run.pose)[[0, -1], :, 0], axis=0)).min() > 0.02


def test_snapshot_shows_what_the_cycle_had_before_it() -> None:
    run = simulate(SHORT, design(0.2), times(), controller=STACK)
    shot = snapshot(STACK, run, 7, 1)
    assert shot.layers.total().shape == FLOOR.grid.shape
    np.testing.assert_array_equal(shot.begin, np.asarray(run.pose)[7, 1])
    assert shot.rollouts.x.shape == (64, 14) and shot.rollouts.weight.sum() == pytest.approx(1.0)
    # Rollouts leave from there, and the other robot is an obstacle where it was seen.
    reach = np.hypot(shot.rollouts.x[:, 0] - shot.begin[0], shot.rollouts.y[:, 0] - shot.begin[1])
    assert reach.max() <= 0.7 * SMALL.model_dt * (1 + 1e-6)
    row, col, inside = (np.asarray(v) for v in shot.grid.cell(*shot.obstacles[0]))
    assert inside and shot.layers.obstacles[row, col] == 254.0
    for wrong, text in (((20, 0), "tick: got 20, expected below 20"), ((0, 2), "robot: got 2, expected below 2")):
        with pytest.raises(ValueError, match=text):
            snapshot(STACK, run, *wrong)
    with pytest.raises(ValueError, match="run: got one of another controller"):
        snapshot(STACK, simulate(SHORT, design(), times()), 0, 0)


def test_design_caps_the_stack() -> None:
    run = simulate(SHORT, design(v_max=0.3, omega_max=0.4), times(), controller=STACK)
    command = np.asarray(run.command)
    assert 0.15 < command[..., 0].max() and np.abs(command[..., 0]).max() <= 0.3 + 1e-9
    assert np.abs(command[..., 1]).max() <= 0.4 + 1e-9


def test_study_of_the_stack_chooses_and_judges() -> None:
    grid = one_at_a_time(design(), {"v_max": [0.3, 0.7]}, [0.1, 0.2])
    study = run_study(SHORT, grid, AT_ONCE, [0, 1], [2, 3], controller=STACK)
    assert list(study.policies["policy"]) == ["Co-design", "MinDelay", "MaxRel"]
    assert set(study.results["v_max"]) == {0.3, 0.7} and len(study.results) == 4


@pytest.mark.slow
def test_eight_robots() -> None:
    angle = np.arange(8) * np.pi / 4
    ring = 2 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    scenario = Scenario(
        start=np.concatenate([ring, angle[:, None] + np.pi], axis=1), goal=-ring, horizon=0.5,
        normaliser="goal_distance", reference_per_robot=True,
    )  # fmt: skip
    run = simulate(scenario, design(0.1), times(10, 8), controller=replace(STACK, static_map=open_floor(scenario)))
    assert run.view.obstacles.x.shape == (10, 8, 7) and np.isfinite(run.auc).all()


WALL = map_of_shapes(FLOOR.grid, [Disc((2.0, 0.0), 0.3)])


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: simulate(SHORT, design(), times(), controller=replace(STACK, static_map=WALL)),
         "goal: got .2, 0. for robot 0, which is in an obstacle"),
        (lambda: simulate(replace(SHORT, start=[[-2.0, -1.5, 0], [9.0, 1.5, 0]]), design(), times(), controller=STACK),
         "start: got .9, 1.5. for robot 1, which is beside the map, expected x from -3 to 3"),
        (lambda: simulate(replace(SHORT, start=[[-2.0, 1.4, 0], [-2.0, 1.5, 0]]), design(), times(), controller=STACK),
         "start: got robots 0 and 1 at a distance of 0.1 m, which is a collision, expected at least two robot radii"),
        (lambda: simulate(SHORT, design(omega_max=2.5), times(), controller=STACK),
         "omega_max: got 2.5, expected at most the stack's wz_max 1.9"),
        (lambda: evaluate(SHORT, design(eta=np.array([0.1, 0.2])), AT_ONCE, [0], controller=STACK),
         "eta: got several values, but the navigation stack does not read it"),
        (lambda: evaluate(SHORT, design(), AT_ONCE, [0], rules=Rules("arrival"),
                          controller=replace(STACK, predict=True)),
         "actuation: got 'arrival' with predict=True, expected 'deadline'"),
        (lambda: evaluate(replace(SHORT, start_jitter=(3.0, 0.1)), design(), AT_ONCE, range(8), controller=STACK),
         "start of seed 0: got .* beside the map"),
        (lambda: replace(STACK, planner_period=0.0), "planner_period: got 0.0, expected > 0"),
        (lambda: replace(STACK, max_widening=-0.1), "max_widening: got -0.1, expected >= 0"),
        (lambda: MppiConfig(batch_size=0), "batch_size: got 0, expected at least 1"),
        (lambda: MppiConfig(time_steps=1), "time_steps: got 1, expected at least 2"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_before_anything_runs(make: object, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        make()  # type: ignore[operator]


def test_wrong_types() -> None:
    with pytest.raises(TypeError, match="static_map: got NoneType, expected a StaticMap"):
        NavigationStack(None)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="predict: got 1, expected True or False"):
        NavigationStack(FLOOR, predict=1)  # type: ignore[arg-type]


def test_runs_under_the_keys_that_it_is_given() -> None:
    runs = [simulate(SHORT, design(), times(), controller=STACK, key=jax.random.key(k)) for k in (0, 0, 1)]
    np.testing.assert_array_equal(runs[0].pose, runs[1].pose)
    assert np.abs(np.asarray(runs[0].pose) - np.asarray(runs[2].pose)).max() > 1e-4
    assert Planner(tolerance=0.5) == STACK.planner
