"""The oracle itself: against the check values of the model (section 11) and against runs done by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from slow_loop import run

DESIGN = {
    "v_max": 0.7,
    "omega_max": 1.4,
    "eta": 0.6,
    "kappa": 2.0,
    "gamma": 2.0,
    "c_miss": 0.2,
    "d_safe": 0.5,
    "tau": 0.01,
    "deadline": 0.2,
}
START = [(-2.0, -1.5, 0.3), (-2.0, 1.5, 0.0)]
GOAL = (2.0, 0.0)

# deadline, tau, design change, actuation; AUC of both robots, smallest distance, final x and y of robot 0
CHECK = [
    (0.160, 0.01, {}, "deadline", (3.1928, 3.2431, 0.3274, 1.7009, 0.0847)),
    (0.200, 0.01, {}, "deadline", (3.1964, 3.3781, 0.3092, 1.9945, 0.2025)),
    (0.325, 0.01, {}, "deadline", (3.8164, 3.9099, 0.1558, 1.8329, -0.5450)),
    (0.500, 0.01, {"eta": 0.0}, "deadline", (3.1201, 3.1924, 0.0, 2.0, 0.0)),
    (0.250, 0.05, {}, "deadline", (3.3974, 4.0123, 0.2138, 1.8073, -0.2032)),
    (0.300, 0.01, {}, "arrival", (2.9689, 3.2024, 0.3347, 2.0458, -0.2997)),
    (0.300, 0.01, {}, "instant", (2.7096, 2.9758, 0.3909, 2.0020, -0.2310)),
    (0.050, 0.01, {}, "deadline", (215.9368, 215.9368, 3.0, -2.0, -1.5)),
]


def check_loop_times(ticks: int) -> np.ndarray:
    """The loop times of section 11, [P, 2] in s."""
    p, i = np.arange(ticks)[:, None], np.arange(2)[None, :]
    return 0.121 + 0.02 * ((7 * p + 3 * i) % 11)


@pytest.mark.parametrize(("deadline", "tau", "change", "actuation", "expected"), CHECK)
def test_check_values(
    deadline: float, tau: float, change: dict[str, float], actuation: str, expected: tuple[float, ...]
) -> None:
    design = DESIGN | change | {"tau": tau, "deadline": deadline}
    result = run(START, GOAL, 30.0, design, check_loop_times(round(30 / tau)), actuation=actuation)
    got = (*result["auc"], result["min_distance"], *result["pose"][-1, 0, :2])
    np.testing.assert_allclose(got, expected, rtol=0, atol=1.01e-4)


def test_quadrature_has_converged() -> None:
    loops = check_loop_times(150)
    coarse, fine = (run(START, GOAL, 30.0, DESIGN | {"tau": 0.2}, loops, substeps=n)["auc"] for n in (1, 8))
    np.testing.assert_allclose(coarse, fine, rtol=1e-9)


def straight(
    lost: tuple[int, ...] = (), tau: float = 0.1, deadline: float = 0.25, horizon: float = 1.2, **options: Any
) -> dict[str, Any]:
    """One robot that faces its goal from 4 m away and drives at the cap whenever a command is in force."""
    loops = np.full((math.ceil(horizon / tau - 1e-9), 1), 0.12)
    loops[list(lost)] = np.inf
    design = DESIGN | {"tau": tau, "deadline": deadline}
    return run([(-2.0, 0.0, 0.0)], GOAL, horizon, design, loops, normaliser="goal_distance", **options)


def test_straight_line_with_constant_delay() -> None:
    """The reference leaves at once and the robot Δ later: they are v t apart, then v Δ. The last tick is cut short."""
    v, delay, horizon = 0.7, 0.125, 1.05
    result = straight(deadline=delay, horizon=horizon)
    area = v**2 * (delay**3 / 3 + delay**2 * (horizon - delay))
    np.testing.assert_allclose(result["auc"], area / 16, rtol=1e-12)
    np.testing.assert_allclose(result["pose"][-1], [(-2 + v * (horizon - delay), 0, 0)], atol=1e-12)
    np.testing.assert_allclose(result["path_length"], v * (horizon - delay), rtol=1e-12)
    np.testing.assert_allclose(result["effort"], v**2 * (horizon - delay), rtol=1e-12)
    np.testing.assert_allclose(result["time"], [*np.arange(11) * 0.1, 1.05], atol=1e-12)
    np.testing.assert_allclose(result["age"][:, 0], [0, 0.1] + [0.2] * 9, atol=1e-12)
    np.testing.assert_allclose(result["command"][:, 0, 0], [0, 0] + [v] * 9, atol=1e-12)
    assert result["completed"] == 1.0
    assert result["min_distance"] == math.inf
    assert result["arrival_time"] == math.inf


@pytest.mark.parametrize(("horizon", "seconds_at_cap"), [(0.22, 0.0), (0.25, 0.0), (0.27, 0.02)])
def test_commands_due_after_the_horizon_never_act(horizon: float, seconds_at_cap: float) -> None:
    result = straight(horizon=horizon)
    np.testing.assert_allclose(result["path_length"], 0.7 * seconds_at_cap, rtol=1e-12, atol=1e-15)
    assert result["time"][-1] == horizon


@pytest.mark.parametrize(
    ("options", "lost", "seconds_at_cap"),
    [
        ({}, (), 1.2 - 0.25),
        ({"actuation": "arrival"}, (), 1.2 - 0.2),
        ({"actuation": "instant"}, (), 1.2),
        ({}, (0, 1), 1.2 - 0.45),
        ({}, (3,), 1.2 - 0.25),
        # The verdict on loop 3 falls at 0.55 s, the next command takes effect at 0.65 s.
        ({"hold": "zero"}, (3,), 1.2 - 0.25 - 0.1),
        # With `arrival` the verdict falls at the tick 0.6 s, when the command sampled at 0.4 s is in force already.
        ({"hold": "zero", "actuation": "arrival"}, (3,), 1.2 - 0.2),
        ({"hold": "zero", "actuation": "arrival"}, (3, 4, 5), 1.2 - 0.2 - 0.2),
        ({"hold": "zero", "actuation": "instant"}, (3,), 1.2 - 0.1),
        # The command sampled at 0.2 s is 0.4 s old at 0.6 s; the next one takes effect at 0.95 s.
        ({"hold": "timeout", "hold_timeout": 0.35}, (3, 4, 5, 6), 1.2 - 0.25 - 0.35),
        ({"hold": "timeout", "hold_timeout": 0.4}, (3, 4, 5, 6), 1.2 - 0.25 - 0.25),
        # From each tick on, for half a tick, the command is 0.05 s older than Δ; then a fresh one takes over.
        ({"hold": "decay", "hold_decay": 0.5}, (), 0.05 * (10 + 9 * math.exp(-0.1))),
    ],
)
def test_actuation_and_hold(options: dict[str, Any], lost: tuple[int, ...], seconds_at_cap: float) -> None:
    np.testing.assert_allclose(straight(lost, **options)["path_length"], 0.7 * seconds_at_cap, rtol=1e-12)


def test_delay_free_loop_contracts_by_a_constant_factor() -> None:
    """Below the cap each tick multiplies the distance to the goal by 1 - kappa tau."""
    design = DESIGN | {"tau": 0.1, "deadline": 0.0, "kappa": 0.5, "d_safe": 0.25}
    loops = np.zeros((50, 1))
    result = run([(1.0, 0.0, 0.0)], GOAL, 5.0, design, loops, normaliser="goal_distance", reference="uncapped")
    np.testing.assert_allclose(2 - result["pose"][:, 0, 0], 0.95 ** np.arange(51), rtol=1e-12)
    # 0.95^13 > 0.5 >= 0.95^14
    np.testing.assert_allclose(result["arrival_time"], 1.4)


def test_robots_without_commands() -> None:
    """Both robots stand still, 1.5 m beside the reference: the integral over its two stretches is elementary."""
    v, kappa, horizon, length = 0.7, 2.0, 30.0, 4.0
    result = run(START, GOAL, horizon, DESIGN, np.full((3000, 2), np.inf))
    corner = (length - v / kappa) / v
    tail, left = horizon - corner, math.exp(-kappa * (horizon - corner))
    along = v**2 * corner**3 / 3 + length**2 * tail
    along += -2 * length * v / kappa**2 * (1 - left) + v**2 / (2 * kappa**3) * (1 - left**2)
    np.testing.assert_allclose(result["auc"], (1.5**2 * horizon + along) / 1.5**2, rtol=1e-10)
    np.testing.assert_allclose(result["age"][:, 0], result["time"][:-1])
    assert result["peak_age"] == pytest.approx(29.99)


def test_start_on_the_reference_is_an_error() -> None:
    with pytest.raises(ValueError, match="goal_distance"):
        run([(-2.0, 0.0, 0.0)], GOAL, 1.0, DESIGN, np.zeros((100, 1)))
