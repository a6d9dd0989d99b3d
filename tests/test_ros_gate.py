"""The deadline gate against the simulator, tick by tick, and what its counts say; no ROS needed."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qocjax._math import EXACT
from qocjax.controllers import apf
from qocjax.network.schedule import Rules, schedule, split_deadline
from qocjax.robots import pose_from
from qocjax.ros import DeadlineGate, Injection, drawn_loop_times
from qocjax.scenario import Design, Scenario
from qocjax.single import simulate

MS = 1_000_000
EPOCH = 1_700_000_000_000_000_000  # ns
TAU_MS, TICKS = 20, 60
TAU = TAU_MS / 1e3
RULES = [
    Rules(actuation, hold, hold_timeout=timeout, hold_decay=0.05)
    for actuation in ("deadline", "arrival")
    for hold, timeout in (("hold", 0.5), ("zero", 0.5), ("timeout", 0.13), ("timeout", 0.04), ("decay", 0.5))
]
each_rule = pytest.mark.parametrize("rules", RULES, ids=lambda r: f"{r.actuation}-{r.hold}-{r.hold_timeout}")


def replayed(
    times_ms: np.ndarray, deadline_ms: float, rules: Rules, commands: np.ndarray
) -> tuple[np.ndarray, np.ndarray, DeadlineGate]:
    """Commands in force and ages at every sampling instant, of a gate that is given each command when it comes."""
    gate = DeadlineGate(rules, deadline_ms / 1e3, TAU, origin=EPOCH)
    events = [(round(time * MS) + p * TAU_MS * MS, 1, p) for p, time in enumerate(times_ms) if np.isfinite(time)]
    events += [(p * TAU_MS * MS, 2, p) for p in range(TICKS)]  # sampling comes after what arrives at that instant
    force, ages = np.zeros((TICKS, 2)), np.zeros(TICKS)
    for time, kind, p in sorted(events):
        now = EPOCH + time
        if kind == 1:
            gate.arrive(EPOCH + p * TAU_MS * MS, tuple(commands[p]), now)
        elif kind == 2:
            gate.advance(now)
            force[p], ages[p] = gate.in_force or (0.0, 0.0), gate.age(now)
    return force, ages, gate


CODES = np.arange(1, TICKS + 1)[:, None] * np.array([1.0, -0.5])  # say which loop they are of, and what gain is on them
planned = jax.jit(schedule, static_argnums=(3, 4))


@st.composite
def loop_times(draw: st.DrawFn) -> np.ndarray:
    """In ms: whatever completes, comes late, in disorder, at the very deadline, or never, one by one or in a row."""
    one = st.one_of(st.integers(0, 400).map(lambda k: k / 4), st.sampled_from([0.0, 60.0, 75.5, 20.0, np.inf, 1e4]))
    some = st.lists(one, min_size=1, max_size=8)
    outage = st.lists(st.just(np.inf), min_size=5, max_size=20)
    parts = draw(st.lists(st.one_of(some, some, outage), min_size=6, max_size=12))
    return np.array((sum(parts, []) + [30.0] * TICKS)[:TICKS])


@each_rule
@pytest.mark.parametrize("deadline_ms", [0.0, 60.0, 75.5])
@given(times=loop_times())
@settings(max_examples=8, deadline=None)
def test_the_commands_in_force_are_those_of_the_model(rules: Rules, deadline_ms: float, times: np.ndarray) -> None:
    """At every sampling instant, with gain and age; and in the end every loop has been counted."""
    deadline = deadline_ms / 1e3
    mid = rules.actuation == "deadline" and bool(split_deadline(deadline, TAU)[1] > 0)
    found = jax.tree.map(lambda a: np.asarray(a)[:, 0], planned(times[:, None] / 1e3, deadline, TAU, rules, mid))
    source = np.concatenate([[-1], found.source[:-1]]) if mid else found.source  # mid-tick: after the instant
    gain = np.ones(TICKS) if found.gain_start is None else found.gain_start
    force, ages, gate = replayed(times, deadline_ms, rules, CODES)
    wanted = np.where(source[:, None] >= 0, CODES[source], 0.0) * gain[:, None]
    np.testing.assert_allclose(force, wanted, rtol=1e-9)
    at_once = np.isin(times, 0.0).any() if rules.actuation == "arrival" else deadline == 0
    if not at_once:  # else the controller's age is that before the new command
        np.testing.assert_allclose(ages, found.age, atol=1e-9)
    gate.advance(EPOCH + (TICKS - 1 + int(np.ceil(deadline_ms / TAU_MS))) * TAU_MS * MS)
    counts, completed = gate.counts, int(found.completed.sum())
    assert (counts.completed, counts.missed) == (completed, TICKS - completed)
    assert counts.late == np.isfinite(times).sum() - completed and counts.repeated == counts.ahead == 0


@each_rule
@pytest.mark.parametrize("deadline_ms", [60.0, 75.5])
def test_a_robot_behind_the_gate_is_commanded_as_in_simulation(rules: Rules, deadline_ms: float) -> None:
    scenario = Scenario(
        start=np.array([[-2, -1.5, 0.3]]), goal=np.array([-1.6, -1.4]), horizon=TAU * TICKS, normaliser="goal_distance"
    )
    times = np.random.default_rng(3).choice([15.0, 40.0, 58.0, 60.0, 75.5, 90.0, np.inf], TICKS)
    times[30:38] = np.inf
    design = Design(tau=TAU, deadline=deadline_ms / 1e3)
    run = simulate(scenario, design, times[:, None] / 1e3, **asdict(rules))
    goal = (np.array([-1.6]), np.array([-1.4]))
    law = jax.jit(lambda pose, age: apf(pose_from(pose), age, goal, design, EXACT))
    commands = np.array([
        [float(each[0]) for each in jax.tree.leaves(law(pose, age))]
        for pose, age in zip(np.asarray(run.pose)[:-1], np.asarray(run.age), strict=True)
    ])  # fmt: skip
    force, ages, _ = replayed(times, deadline_ms, rules, commands)
    np.testing.assert_allclose(force, np.asarray(run.command)[:, 0], atol=1e-12)
    np.testing.assert_allclose(ages, np.asarray(run.age)[:, 0], atol=1e-9)
    assert np.ptp(force, axis=0).min() > 0.1 or rules.hold_timeout < 0.06  # which no command outlives


@each_rule
@given(times=loop_times())
@settings(max_examples=5, deadline=None)
def test_a_timer_at_the_next_change_misses_none(rules: Rules, times: np.ndarray) -> None:
    """A gate that is looked at only when something comes or it has asked for it changes as one looked at always."""

    def changes(polled: bool) -> list[Any]:
        gate = DeadlineGate(rules, 0.0755, TAU)
        arrivals = [(round(time * MS) + p * TAU_MS * MS, p) for p, time in enumerate(times) if np.isfinite(time)]
        found: list[Any] = []
        last = 0
        for time, p in [*sorted(arrivals), (20_000 * MS, -1)]:
            while polled and last + MS // 4 < min(time, 2_000 * MS):
                last += MS // 4
                found += gate.advance(EPOCH + last)
            while not polled and (due := gate.next_change()) is not None and due < EPOCH + min(time, 2_000 * MS):
                made = gate.advance(due)
                assert all(each.time == due for each in made)
                found += made
            if p >= 0:
                gate.arrive(EPOCH + p * TAU_MS * MS, tuple(CODES[p]), EPOCH + time)
                found += gate.advance(EPOCH + time)
            last = time
        return found

    assert changes(polled=False) == changes(polled=True)


def test_every_loop_is_counted_once() -> None:
    gate = DeadlineGate(Rules(), 0.1, 0.02, origin=EPOCH)
    stamps = {p: EPOCH + 20 * MS * p for p in range(10)}
    for p, after_ms in ((0, 50), (2, 60), (1, 90), (3, 100), (4, 101), (6, 10), (6, 12)):
        gate.arrive(stamps[p], (float(p),), stamps[p] + after_ms * MS)
    gate.advance(stamps[9] + 99 * MS)
    counts = gate.counts
    assert (counts.completed, counts.missed) == (5, 4)  # 0, 1, 2, 3, 6, and 4, 5, 7, 8; 9 has a millisecond left
    assert (counts.late, counts.reordered, counts.repeated, counts.ahead) == (1, 1, 1, 0)
    gate.advance(stamps[9] + 100 * MS)
    assert gate.counts.missed == 5


def test_stamps_may_wander_by_less_than_half_a_period() -> None:
    """Poses of another rate than the controller's: every loop is found by its stamp, none is missed."""
    rng = np.random.default_rng(0)
    gate = DeadlineGate(Rules(hold="zero"), 0.1, 0.05, jitter=0.02)
    for p in range(400):
        stamp = EPOCH + round((p * 50 + rng.uniform(-9, 9)) * MS)
        gate.advance(stamp + 30 * MS)
        assert gate.arrive(stamp, (1.0,), stamp + 30 * MS) == "completed"
        assert p == 0 or p < 3 or gate.in_force == (1.0,)
    gate.advance(stamp + 30 * MS)
    assert (gate.counts.completed, gate.counts.missed) == (400, 0)


def test_without_a_period_commands_act_as_they_come_and_a_timeout_at_once() -> None:
    gate = DeadlineGate(Rules("arrival", "timeout", hold_timeout=0.2), 0.1)
    gate.arrive(EPOCH, (1.0,), EPOCH + 33 * MS)
    gate.arrive(EPOCH + 20 * MS, (2.0,), EPOCH + 130 * MS)  # late
    gate.arrive(EPOCH - 10 * MS, (3.0,), EPOCH + 80 * MS)  # older than what is in force
    found = gate.advance(EPOCH + 1000 * MS)
    assert [each.command for each in found] == [(1.0,), (0.0,)]
    np.testing.assert_allclose([each.time - EPOCH for each in found], [33 * MS, 200 * MS], rtol=2e-6)
    assert gate.counts.missed == gate.counts.late == 1 and gate.counts.completed == 2
    assert gate.next_change() is None


def test_a_command_of_the_future_is_dropped_and_one_without_a_stamp_is_late() -> None:
    gate = DeadlineGate(Rules(hold="zero"), 0.1, 0.02, ahead=0.005)
    assert gate.arrive(EPOCH + 6 * MS, (1.0,), EPOCH) == "ahead"
    assert gate.arrive(0, (1.0,), EPOCH) == "late"
    assert gate.arrive(EPOCH + 5 * MS, (1.0,), EPOCH) == "completed"
    gate.advance(EPOCH + 104 * MS)
    assert gate.in_force is None
    gate.advance(EPOCH + 105 * MS)
    assert gate.in_force == (1.0,)
    gate.advance(EPOCH + 10**9 * 86_400)  # a day without a command is counted, not walked through
    assert gate.in_force == (0.0,)
    assert gate.counts.missed == (86_400_000 - 105) // 20


def test_a_clock_that_is_set_back_begins_anew_and_stops_the_robot() -> None:
    gate = DeadlineGate(Rules(), 0.1)
    gate.arrive(EPOCH, (1.0, 2.0), EPOCH)
    gate.advance(EPOCH + 100 * MS)
    assert gate.advance(EPOCH + 90 * MS) == [] and gate.in_force == (1.0, 2.0)  # a small step is waited out
    (stop,) = gate.advance(EPOCH - 5_000 * MS)
    assert stop.command == (0.0, 0.0) and gate.in_force is None and gate.counts.restarts == 1
    assert gate.arrive(EPOCH - 5_000 * MS, (1.0, 1.0), EPOCH - 4_990 * MS) == "completed"


def test_injected_delays_give_the_commands_of_those_loop_times() -> None:
    """Also where a command really comes later than drawn, and the draws begin again after the last."""
    options = "network=kth_5g network.compute_mean=0.03 network.compute_std=0.01 network.uplink_loss=0.2"
    times = drawn_loop_times(options, TAU, deadline=0.1, seed=4, length=TICKS // 2)
    assert times.shape == (TICKS // 2,) and 0 < np.isinf(times).sum() < 20
    np.testing.assert_array_equal(times, drawn_loop_times(options, TAU, deadline=0.1, seed=4, length=TICKS // 2))
    whole = np.ceil(1e3 * np.tile(times, 2))
    whole[7] = 50.0
    rules, injection = Rules(), Injection(times, TAU)
    gate = DeadlineGate(rules, 0.06, TAU, origin=EPOCH)
    force = np.zeros((TICKS, 2))
    for p in range(TICKS):
        stamp = EPOCH + p * TAU_MS * MS
        for late_p, delay in ((p, 0), (p - 2, 10)):
            if late_p == 7 and delay or late_p == p != 7:
                injection.put(EPOCH + late_p * TAU_MS * MS, tuple(CODES[late_p]), stamp + delay * MS)
        for each in injection.take(stamp + 20 * MS - 1):
            gate.arrive(*each)
        gate.advance(stamp)
        force[p] = gate.in_force or (0.0, 0.0)
    np.testing.assert_array_equal(force, replayed(whole, 60.0, rules, CODES)[0])
    assert injection.lost == np.isinf(np.delete(whole, 7)).sum()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: DeadlineGate(Rules("instant"), 0.1), "actuation: got 'instant', expected one of deadline, arrival"),
        (lambda: DeadlineGate(Rules(hold="zero"), 0.1), "period: got 0 with hold 'zero'"),
        (lambda: DeadlineGate(Rules(), -0.1), "deadline: got -0.1"),
        (lambda: DeadlineGate(Rules(), 0.1, 0.02, jitter=0.01), "jitter: got 0.01, expected less than half"),
        (lambda: Injection(np.array([]), 0.1), "loop_times: expected a row"),
        (lambda: Injection(np.array([0.1]), 0.0), "period: got 0"),
        (lambda: drawn_loop_times("network=none", 0.1, 0.1), "network: got 'network=none'"),
        (lambda: drawn_loop_times("network.uplink.no=1", 0.1, 0.1), "network: got 'network.uplink.no=1'"),
    ],
)
def test_bad_input_is_named(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
