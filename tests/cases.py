"""Random runs for the tests of the closed loop, each also for the slow loop, and a network with loop times as given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import slow_loop

from qocjax import Design, Run, Scenario
from qocjax.network.schedule import ACTUATIONS, HOLDS
from qocjax.robots import Ackermann, Robot, Unicycle

MODES = [(actuation, hold) for actuation in ACTUATIONS for hold in HOLDS if hold != "buffer"]
HOLD_OPTIONS = {"hold_timeout": 0.35, "hold_decay": 0.4}
DEADLINES = ("zero", "below tau", "on grid", "off grid", "typical", "above horizon")

# Field of a run, and what the slow loop calls it.
SAME = {
    name: name for name in ("time", "pose", "command", "age", "min_distance", "path_length", "effort", "arrival_time")
} | {"completed_share": "completed", "age_mean": "mean_age", "age_peak": "peak_age"}  # fmt: skip


def slow_robot(robot: Robot) -> dict[str, Any]:
    """A robot as the slow loop takes it."""
    if isinstance(robot, Unicycle) and robot.acceleration is not None:
        return {"robot": "sluggish", "numbers": {"limits": tuple(vars(robot.acceleration).values())}}
    return {"robot": type(robot).__name__.lower(), "numbers": vars(robot) if isinstance(robot, Ackermann) else {}}


@dataclass(frozen=True)
class Case:
    """One run."""

    scenario: Scenario
    design: Design
    loop_times: np.ndarray

    def slow(self, actuation: str = "deadline", hold: str = "hold", **options: Any) -> dict[str, Any]:
        """The run by the slow loop."""
        s = self.scenario
        return slow_loop.run(
            s.start, s.goal, s.horizon, self.design.values(), self.loop_times, actuation=actuation, hold=hold,
            reference=s.reference, reference_kappa=s.nominal_kappa, reference_v_max=s.nominal_v_max,
            reference_per_robot=s.reference_per_robot, weights=tuple(s.weights),
            normaliser={"initial_disagreement": "start"}.get(s.normaliser, s.normaliser),
            **slow_robot(s.robot), **HOLD_OPTIONS | options,
        )  # fmt: skip


def yardstick(k: int, num_robots: int) -> dict[str, Any]:
    """The k-th of the scenario's choices that a program is compiled for, so that k = 0 .. 11 meets them all."""
    per_robot = k % 2 == 1
    apart = num_robots > 1 and not per_robot and k % 4 == 0
    return {
        "reference": ("nominal", "follow", "uncapped")[k % 3],
        "reference_per_robot": per_robot,
        "normaliser": "initial_disagreement" if apart else "goal_distance",
    }


def a_deadline(rng: np.random.Generator, kind: str, tau: float, horizon: float) -> float:
    """A deadline of one of the kinds (s)."""
    return float(
        {
            "zero": 0.0,
            "below tau": tau * rng.uniform(0.1, 0.9),
            "on grid": tau * rng.integers(1, 8),
            "off grid": tau * (rng.integers(1, 5) + rng.uniform(0.05, 0.95)),
            "typical": rng.uniform(0.05, 0.8),
            "above horizon": horizon + rng.uniform(0.01, 0.5),
        }[kind]
    )


def a_case(
    rng: np.random.Generator, kind: str, num_robots: int, ticks: int = 25, horizon: float = 2.5, choice: int = 0
) -> Case:
    """A run with a deadline of the given kind, close quarters or wide ones, few losses or many."""
    tau = horizon / (ticks - rng.choice([0.0, rng.uniform(0.05, 0.95)]))  # divides the horizon, or not
    deadline = a_deadline(rng, kind, tau, horizon)
    spread = rng.choice([0.3, 1.5])
    start = np.c_[rng.normal(0, spread, (num_robots, 2)) - [1, 0], rng.uniform(-3, 3, num_robots)]
    typical = rng.choice([0.5, 1.0, 1.5]) * deadline / 2
    times = rng.gamma(3.0, typical / 3 if deadline else 0.05, (ticks, num_robots)) * rng.choice([0, 1], p=[0.2, 0.8])
    if rng.random() < 0.3:  # arrivals and deadlines exactly at sampling instants
        times = np.round(times / tau) * tau
    times[rng.random(times.shape) < rng.choice([0.0, 0.1, 0.6])] = np.inf
    options = yardstick(choice, num_robots)
    per_robot = options["reference_per_robot"]
    goal = rng.uniform([0.5, -0.5], [1.5, 0.5], (num_robots, 2)) if per_robot else np.array([1.0, 0.2])
    scenario = Scenario(
        start=start, goal=goal, horizon=horizon, nominal_kappa=1.7, nominal_v_max=0.6,
        weights=rng.uniform(0.2, 3, 2), **options,
    )  # fmt: skip
    low = {"v_max": 0.3, "omega_max": 0.5, "eta": 0, "kappa": 0.3, "gamma": 0.5, "c_miss": 0, "d_safe": 0.2}
    high = {"v_max": 2.5, "omega_max": 4, "eta": 1.2, "kappa": 4, "gamma": 6, "c_miss": 1, "d_safe": 1}
    values = {name: float(rng.uniform(low[name], high[name])) for name in low}
    return Case(scenario, Design(**values, tau=float(tau), deadline=deadline), times)


def assert_same_run(run: Run, slow: dict[str, Any], rtol: float = 1e-7) -> None:
    """Compares all but the AUC, which is integrated another way."""
    for name, other in SAME.items():
        np.testing.assert_allclose(getattr(run, name), slow[other], rtol=rtol, atol=rtol, err_msg=name)


@dataclass(frozen=True)
class GivenNetwork:
    """The loop times of the model, section 11, whatever the seed."""

    name: str = "given"

    def draw(self, key: jax.Array, num_ticks: int, num_robots: int, tau: float) -> jax.Array:
        p, i = jnp.arange(num_ticks)[:, None], jnp.arange(num_robots)[None, :]
        return (0.121 + 0.02 * ((7 * p + 3 * i) % 11)).astype(jnp.result_type(float))

    def reliability(self, deadline: Any) -> np.ndarray:
        times = 0.121 + 0.02 * np.arange(11)
        return np.mean(times <= np.asarray(deadline)[..., None], axis=-1)

    def describe(self) -> dict[str, Any]:
        return {"kind": "GivenNetwork", "name": self.name}
