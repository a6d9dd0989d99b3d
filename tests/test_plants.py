"""The linear plant in the robots' loop: its mean cost against the closed form, its pieces against integrals."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import jax
import numpy as np
import pytest
from jump_linear import Loops, mean_cost, piece, stationary_cost
from scipy.integrate import solve_ivp
from scipy.stats import t as student

from qocjax import Rules
from qocjax.network import Constant, GilbertElliott, IndependentLoss, Leg, LoopNetwork, TruncatedNormal
from qocjax.plants import LinearPlant, evaluate_linear, simulate_linear
from qocjax.plants.linear import begin, in_pieces

TAU, SEEDS, TICKS = 0.05, 1200, 100
START = np.array([0.6, -0.4])
# An unstable mode at 1/s, damped by feedback; and two coupled ones with two commands.
PENDULUM = LinearPlant([[0, 1], [1, -0.1]], [[0], [1]], [[3.0, 2.2]], np.diag([1, 0.2]), [[0.05]], np.diag([0.01, 0.1]))
COUPLED = LinearPlant(
    [[0.3, 1.0], [-0.5, 0.1]], np.array([[1, 0.2], [0, 1]]), [[1.4, 0.6], [-0.3, 1.1]], [[1, 0.3], [0.3, 0.5]],
    np.diag([0.1, 0.02]), [[0.1, 0.04], [0.04, 0.06]],
)  # fmt: skip
SILENT = LinearPlant(**{**vars(PENDULUM), "w": np.zeros((2, 2))})

NORMAL, QUICK = TruncatedNormal(0.1, 0.04), Constant(0.01)
BURSTS = GilbertElliott(0.1, 0.4, 0.05, 0.9)


class Case(NamedTuple):
    rules: Rules
    deadline: float
    delay: TruncatedNormal | Constant = NORMAL
    loss: float | GilbertElliott = 0.0
    plant: LinearPlant = PENDULUM

    @property
    def label(self) -> str:
        kind = "bursts" if isinstance(self.loss, GilbertElliott) else f"loss {self.loss:g}"
        return f"{self.rules.actuation}-{self.rules.hold}-{1e3 * self.deadline:g} ms-{kind}"


def rules(actuation: str, hold: str) -> Rules:
    return Rules(actuation, hold, hold_timeout=0.25, hold_decay=0.3)


HOLDS = ("hold", "zero", "timeout", "decay")
CASES = [
    *(Case(rules("deadline", hold), deadline, loss=loss)
      for hold in HOLDS for deadline in (0.15, 0.13) for loss in (0.0, 0.2)),
    *(Case(rules("arrival", hold), deadline, loss=0.2) for hold in HOLDS for deadline in (0.15, 0.13)),
    *(Case(rules("deadline", hold), deadline, loss=BURSTS) for hold in ("hold", "zero") for deadline in (0.15, 0.13)),
    *(Case(rules("deadline", hold), deadline, QUICK, 0.4) for hold in ("hold", "zero") for deadline in (0.02, 0.05)),
    *(Case(rules(actuation, "hold"), 0.0, Constant(0.0), 0.4) for actuation in ("deadline", "arrival")),
    *(Case(rules("instant", hold), 0.13, loss=0.2) for hold in ("hold", "zero")),
    Case(rules("arrival", "hold"), 0.13, loss=0.2, plant=COUPLED),
    Case(rules("deadline", "zero"), 0.13, loss=0.2, plant=SILENT),
]  # fmt: skip


@cache
def simulated(at: int) -> np.ndarray:
    """Cost per second of each seed of a case; every case has seeds of its own, so that they are independent."""
    case = CASES[at]
    loss = case.loss if isinstance(case.loss, GilbertElliott) else IndependentLoss(case.loss)
    network = LoopNetwork(uplink=Leg(loss=loss), compute=case.delay, name="loops")
    return evaluate_linear(case.plant, network, range(at * SEEDS, (at + 1) * SEEDS), tau=TAU, deadline=case.deadline,
                           horizon=TICKS * TAU, rules=case.rules, start=START)["cost"].values.ravel()  # fmt: skip


def exact(case: Case, hold: str | None = None) -> float:
    acting = case.rules if hold is None else rules(case.rules.actuation, hold)
    return mean_cost(case.plant, loops_of(case), acting, case.deadline, TAU, TICKS, START)


def loops_of(case: Case) -> Loops:
    return Loops(lambda at: float(case.delay.cdf(at)), case.loss)


def half_width(costs: np.ndarray, confidence: float = 0.999) -> float:
    return student.ppf(0.5 + confidence / 2, len(costs) - 1) * costs.std(ddof=1) / np.sqrt(len(costs))


def _marked(at: int, case: Case) -> object:
    """Each of the rules is a program of its own; those of which most others are made are tested in seconds."""
    often = case.rules.hold in ("hold", "zero") and case.rules.actuation != "instant"
    return pytest.param(at, id=case.label, marks=[] if often else pytest.mark.slow)


@pytest.mark.parametrize("at", [_marked(at, case) for at, case in enumerate(CASES)])
def test_mean_cost_is_that_of_the_closed_form(at: int) -> None:
    costs, truth = simulated(at), exact(CASES[at])
    assert half_width(costs) < 0.07 * truth  # or it would say nothing
    assert abs(costs.mean() - truth) < half_width(costs)


TOLD_APART = [
    at for at, case in enumerate(CASES)
    if case.rules.hold in ("hold", "zero") and case.rules.actuation == "deadline"  # on arrival the two hardly differ
    and case.loss != 0.0 and case.deadline > 0.0 and case.plant is PENDULUM
]  # fmt: skip


@pytest.mark.parametrize("at", TOLD_APART, ids=lambda at: CASES[at].label)
def test_closed_form_of_the_other_hold_is_excluded(at: int) -> None:
    wrong = exact(CASES[at], "zero" if CASES[at].rules.hold == "hold" else "hold")
    assert abs(simulated(at).mean() - wrong) > half_width(simulated(at))


def test_cost_after_a_warm_up_is_that_of_the_stationary_loop() -> None:
    case = Case(rules("arrival", "hold"), 0.13, loss=0.2)
    truth = stationary_cost(case.plant, loops_of(case), case.rules, case.deadline, TAU)
    assert mean_cost(case.plant, loops_of(case), case.rules, case.deadline, TAU, 5_000, 0 * START) == pytest.approx(
        truth, 5e-3
    )
    network = LoopNetwork(uplink=Leg(loss=IndependentLoss(0.2)), compute=NORMAL, name="loops")
    costs = evaluate_linear(case.plant, network, range(SEEDS), tau=TAU, deadline=0.13, horizon=TICKS * TAU,
                            rules=case.rules, warm_up=0.6 * TICKS * TAU)["cost"].values.ravel()  # fmt: skip
    assert half_width(costs) < 0.07 * truth
    assert abs(costs.mean() - truth) < half_width(costs)


@pytest.mark.parametrize("h", [0.0, 1e-4, 0.03, 0.05, 0.8])
@pytest.mark.parametrize("plant", [PENDULUM, COUPLED], ids=["pendulum", "coupled"])
def test_pieces_are_the_integrals(plant: LinearPlant, h: float) -> None:
    arrays, _ = begin(plant, None, 1)
    found = jax.tree.map(lambda each: each[0, 0], in_pieces(arrays, np.array([[h]])))
    motion, noise, cost, drift = piece(plant, h)
    np.testing.assert_allclose(found.motion, motion, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(found.noise @ found.noise.T, noise, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(found.cost, cost, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(found.drift, drift, rtol=1e-9, atol=1e-13)


def test_run_is_the_differential_equation() -> None:
    """Two loops whose commands take effect between samples; every third loop of the second is lost."""
    times = np.full((40, 2), 0.08)
    times[::3, 1] = np.inf
    run = simulate_linear(SILENT, times, tau=TAU, deadline=0.08, start=[[0.6, -0.4], [0.1, 0.3]])
    a, b, k = (np.asarray(getattr(SILENT, name), float) for name in "abk")
    for loop in range(2):
        x, cost, force = np.asarray(run.state[0, loop]), 0.0, np.zeros(1)
        samples = []
        for tick in range(40):
            samples.append(x)
            np.testing.assert_allclose(run.state[tick, loop], x, rtol=1e-9, atol=1e-10)
            np.testing.assert_allclose(run.cost[tick, loop], cost, rtol=1e-8, atol=1e-12)
            np.testing.assert_allclose(run.command[tick, loop], force, rtol=1e-9, atol=1e-10)
            for h in (0.03, 0.02):
                follow = lambda _, z, u=force: [*(a @ z[:2] + b @ u), z[0] ** 2 + 0.2 * z[1] ** 2 + 0.05 * u @ u]  # noqa: E731
                *x, cost = solve_ivp(follow, (0.0, h), [*x, cost], rtol=1e-11, atol=1e-13).y[:, -1]
                x = np.array(x)
                if h == 0.03 and tick >= 1 and np.isfinite(times[tick - 1, loop]):
                    force = -k @ samples[tick - 1]


def test_recorded_command_is_the_one_in_force() -> None:
    """At a deadline of two samples, that of the state two samples ago."""
    run = simulate_linear(SILENT, np.full((40, 2), 0.08), tau=TAU, deadline=0.1, start=[[0.6, -0.4], [0.1, 0.3]])
    np.testing.assert_allclose(run.command[2:], -run.state[:-3] @ np.asarray(SILENT.k).T, rtol=1e-12)
    assert not np.any(run.command[:2])
    np.testing.assert_allclose(run.age[:, 0], TAU * np.minimum(np.arange(40), 2), atol=1e-12)


@pytest.mark.slow
def test_gains_may_be_mapped_and_differentiated() -> None:
    times = np.random.default_rng(0).uniform(0.0, 0.2, (30, 1))

    def cost(k: jax.Array) -> jax.Array:
        run = simulate_linear(replace(PENDULUM, k=k), times, tau=TAU, deadline=0.13, start=START)
        return run.cost[-1, 0]

    gains = np.array([[[3.0, 2.2]], [[4.0, 2.0]]])
    together = jax.vmap(cost)(gains)
    np.testing.assert_allclose(together, [cost(k) for k in gains], rtol=1e-12)
    step = np.array([[1e-5, 0.0]])
    slope = (cost(gains[0] + step) - cost(gains[0] - step)) / 2e-5
    np.testing.assert_allclose(jax.grad(cost)(gains[0])[0, 0], slope, rtol=1e-6)


@pytest.mark.slow
def test_deadlines_are_independent_runs() -> None:
    network = LoopNetwork(uplink=Leg(loss=IndependentLoss(0.2)), compute=NORMAL, name="loops")
    ask = {"tau": TAU, "horizon": TICKS * TAU, "start": START}
    together = evaluate_linear(PENDULUM, network, range(SEEDS), deadline=[0.15, 0.13], **ask)
    for deadline in (0.15, 0.13):
        alone = evaluate_linear(PENDULUM, network, range(SEEDS), deadline=deadline, **ask)
        np.testing.assert_allclose(together["cost"].sel(deadline=deadline), alone["cost"][0], rtol=1e-10)
    share = together["completed_share"].mean(["seed", "loop"])
    np.testing.assert_allclose(share, 0.8 * NORMAL.cdf([0.15, 0.13]), atol=0.01)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"b": [1.0, 0.0]}, r"b: got shape \(2,\), expected \(2, any\)"),
        ({"k": [[1.0]]}, r"k: got shape \(1, 1\), expected \(1, 2\)"),
        ({"q": [[1, 0.5], [0, 1]]}, "q: got a matrix that is not symmetric, expected a symmetric one"),
        ({"w": np.diag([1.0, -1.0])}, "w: got the eigenvalue -1, expected all >= 0"),
        ({"a": [[np.nan, 0], [0, 1]]}, "a: got .* expected finite numbers"),
    ],
)
def test_wrong_plant_is_refused(change: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        simulate_linear(LinearPlant(**{**vars(PENDULUM), **change}), np.zeros((3, 1)), tau=TAU, deadline=0.1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"loop_times": np.zeros(3)}, r"loop_times: got shape \(3,\), expected \(ticks, loops\)"),
        ({"loop_times": np.full((3, 1), -1.0)}, "loop_times: got NaN or a negative time"),
        ({"tau": 0.0}, "tau: got 0.0, expected > 0"),
        ({"deadline": -1.0}, "deadline: got -1.0, expected >= 0"),
        (
            {"rules": Rules(hold="buffer", plan_length=3)},
            "hold: got 'buffer', .*: a plant's feedback makes one command",
        ),
        ({"start": [1.0]}, r"start: got shape \(1,\), expected \(2,\) or \(1, 2\)"),
    ],
)
def test_wrong_run_is_refused(change: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        simulate_linear(PENDULUM, **{"loop_times": np.zeros((3, 1)), "tau": TAU, "deadline": 0.1, **change})


def test_warm_up_longer_than_the_run_is_refused() -> None:
    with pytest.raises(ValueError, match="warm_up: got 2 s, expected less than the horizon of 1 s"):
        evaluate_linear(PENDULUM, LoopNetwork(compute=QUICK, name="q"), [0], tau=TAU, deadline=0.1, horizon=1.0,
                        warm_up=2.0)  # fmt: skip
