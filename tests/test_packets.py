"""Packets of the next commands: against the slow loop, beside other holds, on its way through batches and files."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import Case, GivenNetwork, a_case, assert_same_run
from hydra import compose, initialize_config_dir

from qocjax import Design, Run, Scenario, evaluate, simulate
from qocjax.advice.advice import advise
from qocjax.batch.gradient import gradient
from qocjax.config import StudyConfig, conf_dir, load
from qocjax.config.codesign import CodesignConfig
from qocjax.config.show import ShowConfig
from qocjax.controllers import Apf, Cbf
from qocjax.navigation import MppiConfig, NavigationStack, Planner, open_floor
from qocjax.network.schedule import Rules
from qocjax.robots import Acceleration, Ackermann, Holonomic, Robot, Unicycle
from qocjax.ros import DeadlineGate

TAU, TICKS = 0.1, 20
SMALL = Scenario(start=[[-0.4, -0.3, 0.3], [-0.4, 0.3, 0.0]], goal=[1.0, 0.1], horizon=TAU * TICKS,
                 start_jitter=(0.0, 0.0))  # fmt: skip
RNG = np.random.default_rng(7)
TIMES = np.where(RNG.random((TICKS, 2)) < 0.5, RNG.uniform(0.05, 0.25, (TICKS, 2)), np.inf)


@cache
def traced(actuation: str, hold: str, length: int | None = None) -> partial:
    """A run whose numbers are all unknown to the compiler."""
    return jax.jit(partial(simulate, actuation=actuation, hold=hold, plan_length=length))


def missing(case: Case, rng: np.random.Generator) -> Case:
    """The case with rows of missed loops in it, one long one."""
    times = np.array(case.loop_times)
    for robot in range(times.shape[1]):
        first = rng.integers(8, 12)
        times[first : first + 7, robot] = np.inf
    return replace(case, loop_times=times)


@pytest.mark.parametrize(("length", "actuation"), [(3, "deadline"), (4, "instant")], ids=str)
def test_packets_like_the_slow_loop(length: int, actuation: str) -> None:
    """Deadlines of no, less than one, some whole and some broken sampling periods, with three robots."""
    rng, late = np.random.default_rng(length), 0.0
    for kind in ("zero", "below tau", "on grid", "off grid", "off grid", "typical", "above horizon"):
        case = missing(a_case(rng, kind, num_robots=3), rng)
        run = traced(actuation, "buffer", length)(case.scenario, case.design, case.loop_times)
        assert_same_run(run, case.slow(actuation, "buffer", plan_length=length))
        late += float(jnp.sum(~(run.command == 0).all(axis=-1) & (run.age > case.design.deadline + case.design.tau)))
    assert late > 10  # commands of a packet beyond its first were driven


@pytest.mark.slow
def test_packets_of_robots_that_take_time_to_follow() -> None:
    """What is under way is driven through, command by command, and the plan has their limits."""
    rng = np.random.default_rng(5)
    for kind in ("on grid", "off grid"):
        case = missing(a_case(rng, kind, num_robots=3), rng)
        limits = Acceleration(ax_max=0.8, ax_min=-1.2, az_max=2.0)
        case = replace(case, scenario=replace(case.scenario, robot=Unicycle(limits)))
        run = traced("deadline", "buffer", 3)(case.scenario, case.design, case.loop_times)
        assert_same_run(run, case.slow("deadline", "buffer", plan_length=3), rtol=2e-5)


@pytest.mark.parametrize(
    "robot",
    [pytest.param(Holonomic(), marks=pytest.mark.slow), Ackermann(0.3, 0.5)],
    ids=lambda each: type(each).__name__,
)
def test_packets_of_other_robots_like_the_slow_loop(robot: Robot) -> None:
    """A third component in plans and in what is under way; turn rates that the steering cuts."""
    rng = np.random.default_rng(11)
    for kind in ("zero", "on grid", "off grid"):
        case = missing(a_case(rng, kind, num_robots=2), rng)
        case = replace(case, scenario=replace(case.scenario, robot=robot))
        run = traced("deadline", "buffer", 3)(case.scenario, case.design, case.loop_times)
        assert_same_run(run, case.slow("deadline", "buffer", plan_length=3))


@pytest.mark.slow
@pytest.mark.parametrize("robot", [Unicycle(), Holonomic(), Ackermann(0.3, 0.5)], ids=lambda each: type(each).__name__)
def test_one_motion_of_what_is_under_way_is_that_of_each_command(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots that say nothing of their motion are driven through what was sent, command by command."""
    scenario = replace(SMALL, robot=robot)
    designs = [Design(tau=TAU, deadline=deadline) for deadline in (0.0, 0.07, 0.3, 0.45)]
    rules = {"hold": "buffer", "plan_length": 3}
    ones = [simulate(scenario, design, TIMES, **rules) for design in designs]
    jax.clear_caches()
    monkeypatch.setattr(type(robot), "left_invariant", False)
    for one, design in zip(ones, designs, strict=True):
        np.testing.assert_allclose(one.pose, simulate(scenario, design, TIMES, **rules).pose, rtol=1e-9, atol=1e-12)
    jax.clear_caches()


@pytest.mark.slow
def test_motion_of_what_is_under_way_is_that_of_each_command() -> None:
    """The one motion that is kept, against commands driven through one by one: limits that are hardly any."""
    steep = replace(SMALL, robot=Unicycle(Acceleration(1e8, -1e8, 1e8)))
    for deadline in (0.0, 0.07, 0.3, 0.45):
        design = Design(tau=TAU, deadline=deadline)
        one, other = (traced("deadline", "buffer", 3)(each, design, TIMES) for each in (SMALL, steep))
        np.testing.assert_allclose(one.pose, other.pose, atol=1e-6)


def test_packets_of_one_command_are_hold_zero() -> None:
    """They stand and drive at the same times; without delay they are the same run."""
    design = Design(tau=TAU, deadline=0.25)
    one, zero = (traced("deadline", *hold)(SMALL, design, TIMES) for hold in (("buffer", 1), ("zero",)))
    still = [(np.asarray(run.command) == 0).all(axis=-1) for run in (one, zero)]
    assert np.array_equal(*still) and 0.2 < still[0].mean() < 0.9
    assert np.abs(one.pose - zero.pose).max() > 0.01  # by predicted poses
    design, times = Design(tau=TAU, deadline=0.0), np.where(TIMES < 1, 0, np.inf)
    one, zero = (traced("deadline", *hold)(SMALL, design, times) for hold in (("buffer", 1), ("zero",)))
    np.testing.assert_allclose(one.pose, zero.pose, rtol=1e-12, atol=1e-12)


def test_without_misses_robots_drive_as_predicted() -> None:
    """Whatever M, as without delay from when the first command takes effect: c_miss = 0, as ages differ."""
    none, design = np.zeros((TICKS, 2)), Design(tau=TAU, deadline=0.3, c_miss=0.0)
    runs = [traced("deadline", "buffer", length)(SMALL, design, none) for length in (1, 3)]
    np.testing.assert_allclose(runs[0].pose, runs[1].pose, rtol=1e-12, atol=1e-12)
    free: Run = traced("instant", "hold")(SMALL, design, none)
    np.testing.assert_allclose(runs[0].pose[3:], free.pose[:-3], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("deadline", [0.2, 0.23])
def test_a_plan_bridges_a_gap_as_if_there_were_none(deadline: float) -> None:
    """Robots that do not mind each other drive through a gap no longer than their packets as they would without."""
    design, whole = Design(tau=TAU, deadline=deadline, eta=0.0), np.zeros((TICKS, 2))
    gap, longer = whole.copy(), whole.copy()
    gap[6:8], longer[6:10] = np.inf, np.inf
    runs = [traced("deadline", "buffer", 3)(SMALL, design, each) for each in (whole, gap, longer)]
    assert [float(run.completed_share) for run in runs] == [1.0, 0.9, 0.8]
    np.testing.assert_allclose(runs[0].pose, runs[1].pose, rtol=1e-9, atol=1e-9)
    stands = np.abs(runs[2].command[9:]).max(axis=-1) == 0
    assert np.array_equal(stands.sum(axis=0), [2, 2])  # used up two periods too soon


def test_batches_are_single_runs() -> None:
    designs = Design(tau=TAU, deadline=np.array([0.15, 0.15, 0.2]), kappa=np.array([1.0, 2.0, 2.0]))
    rules = Rules(hold="buffer", plan_length=3)
    found = evaluate(SMALL, designs, GivenNetwork(), [0], rules=rules, dtype=jnp.float64)
    times = np.asarray(GivenNetwork().draw(jax.random.key(0), TICKS, 2, TAU))
    for k in range(3):
        design = Design(tau=TAU, deadline=designs.deadline[k], kappa=designs.kappa[k])
        run = traced("deadline", "buffer", 3)(SMALL, design, times)
        np.testing.assert_allclose(found["auc"].values[k, 0], run.auc, rtol=1e-9)


@pytest.mark.slow
def test_gradients_go_through_packets_both_ways() -> None:
    designs, rules = Design(tau=TAU, deadline=0.25), Rules(hold="buffer", plan_length=3)
    modes = [gradient(SMALL, designs, GivenNetwork(), [0], ("kappa",), mode=mode, rules=rules, dtype=jnp.float64)
             for mode in ("forward", "reverse")]  # fmt: skip
    np.testing.assert_allclose(*(each["d_auc_kappa"].values for each in modes), rtol=1e-7)


@pytest.mark.slow
def test_barrier_makes_plans_too() -> None:
    """Rolled like any law; it counts the cycles in which nothing was admissible, not the commands of a plan."""
    run = simulate(SMALL, Design(tau=TAU, deadline=0.2), TIMES, hold="buffer", plan_length=4, controller=Cbf())
    assert np.all(np.asarray(run.report["squeezed"]) <= TICKS) and run.path_length.min() > 0.1


def stack_of(motion_model: str = "DiffDrive", **changes: object) -> NavigationStack:
    mppi = MppiConfig(batch_size=16, time_steps=12, model_dt=0.15, wz_max=1.4, motion_model=motion_model)
    return NavigationStack(
        open_floor(SMALL, resolution=0.2), planner=Planner(tolerance=0.5), mppi=mppi, **{"predict": True} | changes
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("robot", [Unicycle(), Holonomic()], ids=lambda each: type(each).__name__)
def test_stack_sends_the_sequence_of_its_local_controller(robot: Robot) -> None:
    """The first command is that of single ones; a gap is bridged by the sequence, linear between its steps."""
    design, times, stack = Design(tau=TAU, deadline=0.2), np.zeros((TICKS, 2)), stack_of(str(robot.motion_model))
    scenario = replace(SMALL, robot=robot)
    single = simulate(scenario, design, times, controller=stack)
    packets = simulate(scenario, design, times, hold="buffer", plan_length=4, controller=stack)
    np.testing.assert_allclose(packets.command, single.command, rtol=1e-9, atol=1e-12)
    times[8:11] = np.inf  # no command takes effect at ticks 10 to 12: those of the loop of tick 7
    gap = simulate(scenario, design, times, hold="buffer", plan_length=4, controller=stack)
    state = jax.tree.map(lambda a: np.asarray(a)[8], gap.view.state)  # left by the cycle of tick 7
    for k in range(4):
        for i in range(2):
            wanted = [np.interp(k * TAU / 0.15, np.arange(12), each[i]) for each in jax.tree.leaves(state.sequence)]
            np.testing.assert_allclose(gap.command[9 + k, i], wanted, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"hold": "buffer"}, "plan_length: got none"),
        ({"hold": "buffer", "plan_length": 0}, "plan_length: got 0"),
        ({"hold": "zero", "plan_length": 5}, "plan_length: got 5 with hold 'zero'"),
        ({"actuation": "arrival", "hold": "buffer", "plan_length": 5}, "actuation: got 'arrival'"),
    ],
)
def test_rules_refuse(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Rules(**options)


def test_what_sends_single_commands_refuses() -> None:
    rules = Rules(hold="buffer", plan_length=5)
    with pytest.raises(ValueError, match="hold: got 'buffer', expected one of hold, zero, timeout, decay"):
        DeadlineGate(rules, 0.2, 0.1)
    with pytest.raises(ValueError, match="hold: got 'buffer'"):
        advise(SMALL, GivenNetwork(), Design(tau=TAU, deadline=0.2), {}, rules=rules)


def test_stack_refuses() -> None:
    for changes, length, message in (({"predict": False}, 3, "predict"), ({}, 19, "plan_length: got 19, .*most 18")):
        with pytest.raises(ValueError, match=message):
            stack_of(**changes).check(SMALL, Design(tau=TAU, deadline=0.2), Rules(hold="buffer", plan_length=length))
    Apf().check(SMALL, Design(tau=TAU, deadline=0.2), Rules(hold="buffer", plan_length=99))


def configured(command: str, model: type, *options: str) -> Any:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return load(model, compose(command, list(options)))


def test_cell_and_demand_feel_the_packets() -> None:
    """(M - 1) further commands of so many bytes, the uplink as it was."""
    plans = ("loop.hold=buffer", "loop.plan_length=6", "loop.command_bytes=48")
    of = lambda kind: configured("show", ShowConfig, f"network={kind}", *plans).build_network()  # noqa: E731
    cell, topics = of("cell"), of("dds")
    assert (cell.downlink.message_bytes, cell.uplink.message_bytes) == (150 + 5 * 48, 3000)
    assert (topics.downlink.payload, topics.uplink.payload) == (76 + 5 * 48, 368)
    config = configured("codesign", CodesignConfig, *plans)
    assert config.traffic.build(config.loop.plan_bytes).downlink_bytes == 150 + 5 * 48


def test_lengths_are_swept() -> None:
    """Each is a set-up of its own, as is the size of a command; its messages are as long as it asks for."""
    plans = ("loop.hold=buffer", "loop.plan_length=2", "network=cell", "sweep.deadline_ms=[200]")
    swept = ("+sweep.grids.loop.plan_length=[1,4]", "+sweep.grids.loop.command_bytes=[16,48]")
    config = configured("sweep", StudyConfig, *plans, *swept)
    problem, usual = config.build_problem(), configured("sweep", StudyConfig, "network=cell").build_network()
    assert problem.apart == ("loop.plan_length", "loop.command_bytes")
    found = {values: (setup.rules.plan_length, setup.network.downlink.message_bytes - usual.downlink.message_bytes)
             for values, setup in problem.setups.items()}  # fmt: skip
    assert found == {(1.0, 16.0): (1, 0), (2.0, 16.0): (2, 16), (4.0, 16.0): (4, 48), (2.0, 48.0): (2, 48)}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["+sweep.grids.loop.plan_length=[1,5]"], "loop.plan_length: got no number"),
        (["+sweep.grids.loop.command_bytes=[16,48]"], "with loop.hold=hold, which does not read it, expected"),
        (
            ["loop.hold=buffer", "loop.plan_length=2", "network=paper", "+sweep.grids.loop.command_bytes=[16,48]"],
            "with network=loop, which does not read it, expected network=cell or dds",
        ),
        (["loop.hold=buffer", "loop.plan_length=2", "+sweep.grids.loop.plan_length=[1.5]"], "got .*1.5.*, expected"),
        (["loop.plan_length=5"], "plan_length: got 5 with hold 'hold'"),
        (["loop.hold=buffer"], "plan_length: got none"),
        (["loop.hold=buffer", "loop.plan_length=2", "loop.command_bytes=0"], "loop.command_bytes: got 0"),
    ],
)
def test_loop_refuses(options: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        configured("sweep", StudyConfig, "network=cell", *options).build_problem()
