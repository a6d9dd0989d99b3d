"""The local controller: weights in closed form, rollouts and critics against slow loops, and where it drives."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array
from scipy import signal, stats

from qocjax.navigation import mppi
from qocjax.navigation.critics import (
    ConstraintCritic,
    CostCritic,
    Ends,
    GoalAngleCritic,
    GoalCritic,
    ObstaclesCritic,
    Point,
    PreferForwardCritic,
    Scene,
)
from qocjax.navigation.iteration import weights_of
from qocjax.navigation.local_path import MapCosts, local_path
from qocjax.navigation.mppi import initial_state, predict, step_each
from qocjax.navigation.mppi_config import MppiConfig
from qocjax.navigation.noise import normal_pairs
from qocjax.navigation.path_critics import PathAlignCritic, PathFollowCritic
from qocjax.navigation.smoothing import shifted, smoothed
from qocjax.navigation.stack_parts import STACK_MPPI
from qocjax.robots import Command

step = jax.jit(mppi.step, static_argnames=("config", "record"))

KEY = jax.random.key(7)
LIMITS = ("ax_max", "ax_min", "az_max")
SMALL = MppiConfig(batch_size=24, time_steps=22, wz_std=0.8, vx_std=0.4, sgf_order=0, gamma=0.0)
POSE = jnp.array([0.3, 0.2, 0.4])
SPEED = Command(jnp.array(0.1), jnp.array(0.2))  # of the robot, behind what it was told
NOW = (0.25, 0.375)  # what it can reach of (0.3, 0.5) in a cycle


@dataclass(frozen=True)
class Quadratic:
    """Squared distance of the speed from a wish."""

    weight: float
    wish: float
    stride = 1

    def term(self, point: Point, scene: Scene) -> Array:
        return (point.vx - self.wish) ** 2

    def cost(self, total: Array, ends: Ends, scene: Scene) -> Array:
        return self.weight * total


def room(seed: int = 0, free: float = 0.5) -> MapCosts:
    """A map of 8 m x 6 m with random costs, the given share of its cells free; one in twenty touches an obstacle."""
    draws = np.random.default_rng(seed).uniform(size=(300, 400))
    cost = np.where(draws < free, 0.0, np.round((draws - free) / (1 - free) * 240))
    return MapCosts(jnp.asarray(np.where(draws > 0.95, 253.0, cost)), 0.02, (-4.0, -3.0))


def empty() -> MapCosts:
    return MapCosts(jnp.zeros((60, 80)), 0.1, (-4.0, -3.0))


def straight(goal: Array) -> Array:
    return jnp.stack([jnp.linspace(-3.0, goal[0], 30), jnp.linspace(0.0, goal[1], 30)], axis=1)


def samples_of(config: MppiConfig, vx: np.ndarray, wz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The sequences [H, K] that the first iteration draws."""
    noise = normal_pairs(jax.random.fold_in(KEY, 0), config.time_steps, config.batch_size, jnp.float64)
    return np.asarray(vx[:, None] + config.vx_std * noise[0]), np.asarray(wz[:, None] + config.wz_std * noise[1])


def between(low: float, high: float, value: float) -> float:
    return min(max(value, low), high)


def slow_speeds(config: MppiConfig, now: tuple[float, float], vx: np.ndarray, wz: np.ndarray) -> np.ndarray:
    """Speeds [H, K, 2] of rollouts: that of now, then what acceleration allows of the sample before."""
    rise, fall, turn = (each * config.model_dt for each in (config.ax_max, -config.ax_min, config.az_max))
    speeds = np.zeros((*vx.shape, 2))
    for k in range(vx.shape[1]):
        v, w = now
        speeds[0, k] = v, w
        for t in range(1, vx.shape[0]):
            low, high = (v - fall, v + rise) if v > 0 else (v - rise, v + fall)
            v, w = between(low, high, vx[t - 1, k]), between(w - turn, w + turn, wz[t - 1, k])
            speeds[t, k] = v, w
    return speeds


def slow_rollouts(config: MppiConfig, pose: Array, speeds: np.ndarray) -> np.ndarray:
    """Points [H, K, 4] (x, y, heading, distance from the first point), by centre and radius of each arc."""
    points = np.zeros((*speeds.shape[:2], 4))
    for k in range(speeds.shape[1]):
        x, y, theta, distance = *(float(v) for v in pose), 0.0
        for t in range(speeds.shape[0]):
            v, w = speeds[t, k]
            turned = theta + w * config.model_dt
            x, y = x + v / w * (math.sin(turned) - math.sin(theta)), y - v / w * (math.cos(turned) - math.cos(theta))
            theta, distance = turned, distance + abs(v) * config.model_dt * (t > 0)
            points[t, k] = x, y, theta, distance
    return points


def run(config: MppiConfig, goal: Array, costs: MapCosts, path: Array | None = None, pose: Array = POSE):
    """One cycle from a warm start that is not zero, with speeds and points of its rollouts by the slow loop."""
    times = jnp.linspace(0.0, 1.0, config.time_steps)
    state = replace(initial_state(config), vx=0.3 + 0.1 * times, wz=0.5 - times)
    path = straight(goal) if path is None else path
    command, after, rollouts = step(config, state, pose, costs, path, goal, KEY, record=True, speed=SPEED)
    mean = [np.append(now, sequence[1:]) for now, sequence in zip(NOW, (state.vx, state.wz), strict=True)]
    samples = samples_of(config, *mean)
    speeds = slow_speeds(config, NOW, *samples)
    return rollouts, speeds[..., 0], slow_rollouts(config, pose, speeds), (mean, samples, command, after)


def cell(costs: MapCosts, x: float, y: float) -> float:
    row, column = (math.floor((v - o) / costs.resolution) for v, o in ((y, costs.origin[1]), (x, costs.origin[0])))
    rows, cols = costs.cost.shape
    return float(np.asarray(costs.cost)[row, column]) if 0 <= row < rows and 0 <= column < cols else 255.0


def test_noise_is_standard_normal() -> None:
    pairs = [np.asarray(each).ravel() for each in normal_pairs(KEY, 50, 2000, jnp.float32)]
    for each in pairs:
        assert each.dtype == np.float32
        assert stats.kstest(each, "norm").pvalue > 0.01
    assert abs(np.corrcoef(pairs)[0, 1]) < 4 / math.sqrt(len(pairs[0]))
    assert abs(np.corrcoef(pairs[0] ** 2, pairs[1] ** 2)[0, 1]) < 4 / math.sqrt(len(pairs[0]))
    other = np.asarray(normal_pairs(jax.random.key(8), 50, 2000, jnp.float32)[0]).ravel()
    assert abs(np.corrcoef(pairs[0], other)[0, 1]) < 4 / math.sqrt(len(other))


def test_random_words_are_those_of_threefry() -> None:
    from jax.extend.random import threefry_2x32

    from qocjax.navigation.noise import _threefry

    key = jnp.array([1234567, 4000000000], jnp.uint32)
    counters = jnp.arange(12, dtype=jnp.uint32) * jnp.uint32(300000007)
    wanted = threefry_2x32(key, counters)
    got = _threefry(key[0], key[1], counters[:6], counters[6:], rounds=20)
    np.testing.assert_array_equal(np.concatenate([np.asarray(each) for each in got]), wanted)


def test_every_bit_of_key_and_counter_turns_every_random_bit_in_half_of_the_cases() -> None:
    from qocjax.navigation.noise import _threefry

    words = np.random.default_rng(5).integers(0, 2**32, (4, 4000), dtype=np.uint32)
    words[2:] >>= np.uint32(16)  # counters are small
    random = jax.jit(_threefry)
    before = random(*words)
    for i in range(128):
        turned = words.copy()
        turned[i // 32] ^= np.uint32(1 << i % 32)
        after = random(*turned)
        for one, other in zip(before, after, strict=True):
            flips = np.unpackbits(np.asarray(one ^ other)[:, None].view(np.uint8), axis=1).mean(axis=0)
            assert np.all(np.abs(flips - 0.5) < 5.5 * 0.5 / math.sqrt(words.shape[1]))


def test_the_logarithm_is_that_of_numpy_to_rounding() -> None:
    from qocjax.navigation.noise import _log, _uniform

    numbers = _uniform(jnp.arange(0, 2**32, 65521, dtype=jnp.uint32), jnp.float32)
    wanted = np.log(np.asarray(numbers, np.float64))
    np.testing.assert_allclose(_log(numbers), wanted, rtol=1.5e-7)
    np.testing.assert_allclose(_log(_uniform(jnp.uint32([0, 2**32 - 1]), jnp.float32)), np.log([2**-24, 1 - 2**-24]),
                               rtol=1e-6)  # fmt: skip
    np.testing.assert_allclose(_log(jnp.asarray(numbers, jnp.float64)), wanted, rtol=1e-15)


def test_weights_and_update_of_one_quadratic_critic() -> None:
    config = replace(SMALL, critics=(Quadratic(0.7, 0.2),), temperature=0.45, gamma=0.02)
    rollouts, speeds, _, ((mean_v, mean_w), (vx, wz), command, after) = run(config, jnp.array([2.0, 0.0, 0.0]), empty())
    cost = 0.7 * np.sum((speeds - 0.2) ** 2, axis=0)
    for t in range(config.time_steps):
        cost += 0.02 / 0.4**2 * mean_v[t] * (vx[t] - mean_v[t]) + 0.02 / 0.8**2 * mean_w[t] * (wz[t] - mean_w[t])
    weight = np.exp(-(cost - cost.min()) / 0.45)
    weight /= weight.sum()
    np.testing.assert_allclose(rollouts.cost, cost, rtol=1e-12)
    np.testing.assert_allclose(rollouts.weight, weight, rtol=1e-10)
    # The sequence goes on from the speeds of now, within caps and limits, and its second command is the one sent.
    averages = [np.sum(each * weight, axis=1) for each in (vx, wz)]
    capped = (np.clip(averages[0], config.vx_min, config.vx_max), np.clip(averages[1], -config.wz_max, config.wz_max))
    wanted = slow_speeds(config, NOW, *(np.append(each[1:], 0.0)[:, None] for each in capped))[:, 0]
    np.testing.assert_allclose([command.nu, command.omega], wanted[1], rtol=1e-12)
    np.testing.assert_allclose(after.vx, np.append(wanted[1:, 0], wanted[-1, 0]), rtol=1e-12)
    np.testing.assert_allclose(after.wz, np.append(wanted[1:, 1], wanted[-1, 1]), rtol=1e-12)
    assert float(after.past_vx[-1]) == pytest.approx(averages[0][1], rel=1e-12)  # before caps and limits


def test_many_rollouts_find_the_tilted_normal_distribution() -> None:
    # exp(-q (v - c)²/T) times the density of N(m, σ²) has the mean (m/σ² + 2qc/T) / (1/σ² + 2q/T).
    unlimited = {"ax_max": None, "ax_min": None, "az_max": None, "vx_max": 9.0, "vx_min": -9.0}
    config = replace(SMALL, batch_size=40000, time_steps=3, critics=(Quadratic(2.0, 0.5),), **unlimited)
    state = replace(initial_state(config), vx=jnp.full(3, 0.1))
    goal = jnp.array([2.0, 0.0, 0.0])
    command, after, rollouts = step(config, state, POSE, empty(), straight(goal), goal, KEY)
    precision, pull = 1 / 0.4**2, 2 * 2.0 / config.temperature
    wanted = (0.1 * precision + 0.5 * pull) / (precision + pull)
    error = math.sqrt(float(jnp.sum(rollouts.weight**2)) / (precision + pull))
    assert abs(float(command.nu) - wanted) < 4 * error
    assert abs(float(after.vx[1]) - 0.1) < 4 * error * math.sqrt(1 + pull / precision)  # the last sample is not driven


def test_weights_are_those_of_a_softmax() -> None:
    cost = jnp.array([3.0, 1e6, 2.5, 4.0])
    np.testing.assert_allclose(weights_of(cost, 0.3), jax.nn.softmax(-cost / 0.3), rtol=1e-12)


def test_without_noise_the_warm_start_comes_back() -> None:
    config = replace(SMALL, vx_std=0.0, wz_std=0.0, gamma=0.1, iteration_count=2, critics=(CostCritic(),))
    state = replace(initial_state(config), vx=jnp.linspace(0.1, 0.4, 22), wz=jnp.linspace(-1.0, 1.0, 22))
    goal = jnp.array([2.0, 0.0, 0.0])
    command, after, _ = step(config, state, POSE, empty(), straight(goal), goal, KEY)
    np.testing.assert_allclose([command.nu, command.omega], [state.vx[1], state.wz[1]], rtol=1e-12)
    np.testing.assert_allclose(after.wz, jnp.append(state.wz[1:], state.wz[-1]), rtol=1e-12)


@pytest.mark.parametrize("limits", [{}, {"ax_min": -6.0, "az_max": 9.0}, {"ax_max": math.inf}, dict.fromkeys(LIMITS)])
def test_rollouts_are_exact_arcs_within_the_limits_on_acceleration(limits: dict) -> None:
    config = replace(SMALL, critics=(CostCritic(trajectory_point_step=4),), **limits)  # 22 steps: 5 blocks and a rest
    steep = {"ax_max": 1e9, "ax_min": -1e9, "az_max": 1e9}
    slow = replace(config, **{name: steep[name] for name in limits if getattr(config, name) is None})
    state = replace(initial_state(config), vx=jnp.linspace(0.3, -0.4, 22), wz=jnp.full(22, 0.5))
    goal = jnp.array([2.0, 0.0, 0.0])
    rollouts = step(config, state, POSE, empty(), straight(goal), goal, KEY, record=True)[2]
    samples = samples_of(config, np.asarray(state.vx), np.asarray(state.wz))
    speeds = slow_speeds(slow, (0.3, 0.5), *samples)
    points = slow_rollouts(config, POSE, speeds)
    np.testing.assert_allclose(rollouts.x, points[..., 0].T, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(rollouts.y, points[..., 1].T, rtol=1e-9, atol=1e-9)
    assert np.any(speeds[..., 0] > config.vx_max)  # the caps do not bound a rollout
    assert np.any(speeds[..., 0] < 0)
    assert np.array_equal(speeds[1:, :, 0], samples[0][:-1]) == (config.ax_max is None and config.ax_min is None)


def test_rollouts_begin_at_what_the_robot_can_reach_of_the_command_sent_last() -> None:
    config = replace(SMALL, vx_std=0.0, wz_std=0.0, critics=(CostCritic(),))
    state = replace(initial_state(config), vx=jnp.full(22, 0.3), wz=jnp.full(22, -0.5))
    goal = jnp.array([2.0, 0.0, 0.0])
    for limited, sent, speed, wanted in (
        (True, (0.3, -0.5), (0.3, -0.5), (0.3, -0.5)),
        (True, (0.3, -0.5), (0.0, 0.0), (0.15, -0.175)),
        (True, (0.3, -0.5), (0.7, -0.7), (0.55, -0.525)),
        (True, (0.3, -0.5), None, (0.3, -0.5)),
        (False, (0.3, -0.5), (0.0, 0.0), (0.3, -0.5)),
    ):
        free = {} if limited else dict.fromkeys(LIMITS)
        robot = None if speed is None else Command(jnp.array(speed[0]), jnp.array(speed[1]))
        command, _, rollouts = step(
            replace(config, **free), state, POSE, empty(), straight(goal), goal, KEY, record=True, speed=robot
        )
        first = predict(POSE, Command(*(jnp.array([each]) for each in wanted)), jnp.full(1, 0.05))
        np.testing.assert_allclose([rollouts.x[0, 0], rollouts.y[0, 0]], first[:2], rtol=1e-12)
        reach = np.array([0.15, 0.175]) if limited else np.array([np.inf, np.inf])
        np.testing.assert_allclose(
            [command.nu, command.omega], np.clip(sent, np.array(wanted) - reach, np.array(wanted) + reach), rtol=1e-9
        )


def test_clamped_controls_are_those_that_the_rollouts_drive() -> None:
    config = replace(SMALL, clamp_raw_controls=True, temperature=0.45, gamma=0.02, critics=(Quadratic(0.7, 0.2),))
    rollouts, speeds, _, ((mean_v, mean_w), (vx, wz), _, after) = run(config, jnp.array([2.0, 0.0, 0.0]), empty())
    driven = slow_speeds(config, NOW, vx, wz)
    used = [np.append(driven[1:, :, i], last[-1:], axis=0) for i, last in ((0, vx), (1, wz))]
    cost = 0.7 * np.sum((speeds - 0.2) ** 2, axis=0)
    for mean, sample, std in ((mean_v, used[0], 0.4), (mean_w, used[1], 0.8)):
        cost += 0.02 / std**2 * (mean @ (sample - mean[:, None]))
    np.testing.assert_allclose(rollouts.cost, cost, rtol=1e-11)
    assert float(after.past_vx[-1]) == pytest.approx(used[0][1] @ np.asarray(rollouts.weight), rel=1e-11)


def test_commands_keep_the_caps() -> None:
    goal = jnp.array([-3.0, 2.0, 0.0])
    wild = replace(SMALL, batch_size=8, temperature=0.01, wz_std=9.0, vx_std=9.0, critics=(GoalCritic(),))
    for config in (wild, replace(wild, clamp_raw_controls=True)):
        state = initial_state(config)
        for cycle in range(5):
            command, state, _ = step(config, state, POSE, empty(), straight(goal), goal, jax.random.key(cycle))
            assert config.vx_min <= float(command.nu) <= config.vx_max
            assert abs(float(command.omega)) <= config.wz_max
            assert float(jnp.max(jnp.abs(state.wz))) <= config.wz_max
            assert np.abs(np.diff(state.vx)).max() <= 0.15 + 1e-9 and np.abs(np.diff(state.wz)).max() <= 0.175 + 1e-9


def test_constraint_and_forward_critics() -> None:
    config, goal = (
        replace(SMALL, critics=(ConstraintCritic(), PreferForwardCritic(cost_power=2))),
        jnp.array([2.0, 0, 0]),
    )
    for pose, away in ((POSE, True), (POSE.at[0].set(1.8), False)):
        rollouts, vx, _, _ = run(config, goal, empty(), pose=pose)
        beyond = np.array([sum(max(v - 0.5, 0) + max(-0.35 - v, 0) for v in vx[:, k]) for k in range(24)]) * 0.05
        backward = np.array([sum(max(-v, 0) for v in vx[:, k]) for k in range(24)]) * 0.05
        assert beyond.max() > 0 and backward.max() > 0
        np.testing.assert_allclose(rollouts.cost, 4.0 * beyond + away * (5.0 * backward) ** 2, rtol=1e-12)


def test_goal_critics() -> None:
    config = replace(SMALL, critics=(GoalCritic(cost_power=2), GoalAngleCritic()))
    for goal, close, near in (((0.6, 0.3, 2.9), True, True), ((1.5, 0.2, 2.9), True, False), ((3, 0, 0), False, False)):
        rollouts, _, points, _ = run(config, jnp.array(goal, float), empty())
        gap, angle = np.zeros(24), np.zeros(24)
        for k in range(24):
            gap[k] = np.mean([math.hypot(p[0] - goal[0], p[1] - goal[1]) for p in points[:, k]])
            turns = [p[2] - goal[2] for p in points[:, k]]
            angle[k] = np.mean([abs(math.atan2(math.sin(turn), math.cos(turn))) for turn in turns])
        np.testing.assert_allclose(rollouts.cost, close * (5.0 * gap) ** 2 + near * 3.0 * angle, rtol=1e-9)


@pytest.mark.parametrize("goal", [(2.5, 0.0, 0.0), (0.6, 0.2, 0.0)])
def test_cost_critic(goal: tuple[float, float, float]) -> None:
    critic, costs = CostCritic(cost_power=2, near_collision_cost=200.0, trajectory_point_step=3), room()
    rollouts, _, points, _ = run(replace(SMALL, critics=(critic,)), jnp.array(goal), costs)
    near = math.hypot(goal[0] - 0.3, goal[1] - 0.2) < 0.5
    wanted, scored = np.zeros(24), range(0, 22, 3)
    for k in range(24):
        for t in scored:
            c = cell(costs, *points[t, k, :2])
            if c >= 253:
                wanted[k] = critic.collision_cost
                break
            wanted[k] += critic.critical_cost if c >= 200 else 0 if near else c
    assert 0 < np.sum(wanted >= critic.collision_cost) < 24
    np.testing.assert_allclose(rollouts.cost, (wanted * (3.81 / 254 / len(scored))) ** 2, rtol=1e-9)


def test_obstacles_critic() -> None:
    critic, costs, goal = ObstaclesCritic(cost_power=2), room(3, free=0.8), jnp.array([2.5, 0.0, 0.0])
    rollouts, _, points, _ = run(replace(SMALL, critics=(critic,)), goal, costs)
    raw, repulsion = np.zeros(24), np.zeros(24)
    for k in range(24):
        values = [cell(costs, *points[t, k, :2]) for t in range(22)]
        distances = [(math.log(253) - math.log(c)) / 10.0 for c in values if c >= 1]
        raw[k] = 1e5 if max(values) >= 253 else sum(max(0.1 - d, 0) for d in distances)
        repulsion[k] = sum(0.55 - d for d in distances)
    wanted = (20.0 * raw + 1.5 * (repulsion - repulsion.min()) / 22) ** 2
    assert 0 < np.sum(raw >= 1e5) < 24
    np.testing.assert_allclose(rollouts.cost, wanted, rtol=1e-9)


def slow_path(path: np.ndarray, pose: Array, spacing: float, count: int) -> tuple[np.ndarray, float]:
    """Points along a path from the one of them nearest to the robot on, found by walking it in steps of 10 µm."""
    lengths = np.append(0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T)))
    walk = np.arange(0.0, lengths[-1], 1e-5)
    x, y = np.interp(walk, lengths, path[:, 0]), np.interp(walk, lengths, path[:, 1])
    begin = walk[np.argmin((x - float(pose[0])) ** 2 + (y - float(pose[1])) ** 2)]
    begin = min(round(begin / spacing) * spacing, lengths[-1])
    at = np.minimum(begin + spacing * np.arange(count), lengths[-1])
    return np.stack([np.interp(at, lengths, path[:, i]) for i in (0, 1)], axis=1), lengths[-1] - begin


@pytest.mark.parametrize("seed", range(4))
def test_local_path(seed: int) -> None:
    corners = np.cumsum(np.random.default_rng(seed).normal(size=(6, 2)), axis=0)
    corners = np.concatenate([corners, np.repeat(corners[-1:], 3, axis=0)])  # filled up with the last point
    got = local_path(jnp.asarray(corners), POSE[0], POSE[1], 1.5, 0.05)
    wanted, remaining = slow_path(corners, POSE, 0.05, 31)
    np.testing.assert_allclose(jnp.stack([got.x, got.y], axis=1), wanted, atol=3e-5)
    assert float(got.remaining) == pytest.approx(remaining, abs=3e-5)
    assert int(got.last) == min(math.ceil(remaining / 0.05 - 1e-3), 30)


FOLLOWING = replace(
    SMALL,
    time_steps=40,
    critics=(PathAlignCritic(offset_from_furthest=5, trajectory_point_step=3), PathFollowCritic(cost_power=2)),
)


@pytest.mark.parametrize("blocked", [0, 1, 5])
def test_path_critics(blocked: int) -> None:
    goal, cost = jnp.array([2.5, 1.0, 0.0]), np.zeros((60, 80))
    local, _ = slow_path(np.asarray(straight(goal)), POSE, 0.05, 31)
    for x, y in local[4 : 4 + 2 * blocked : 2]:
        cost[math.floor((y + 3) / 0.1), math.floor((x + 4) / 0.1)] = 254.0
    costs = replace(empty(), cost=jnp.asarray(cost))
    free = [cell(costs, *point) < 253 for point in local]
    rollouts, _, points, _ = run(FOLLOWING, goal, costs)
    reach = [math.ceil(points[-1, k, 3] / 0.05) + 1 for k in range(24)]
    furthest = max(int(np.argmin(np.hypot(*(local[:n] - points[-1, k, :2]).T))) for k, n in enumerate(reach))
    assert 8 < furthest < 24
    taken, align = free[:furthest].count(False), np.zeros(24)
    assert (taken > 0) == (blocked > 0)
    if taken <= 2 or taken / furthest <= 0.07:
        for k in range(24):
            scored = points[0:40:3, k, :2]
            along = np.cumsum(np.hypot(*np.diff(scored, axis=0).T))
            at = [(point, min(int(s / 0.05 + 0.5), 30)) for point, s in zip(scored[1:], along, strict=True)]
            gaps = [math.hypot(*(point - local[i])) for point, i in at if free[i]]
            align[k] = 10.0 * sum(gaps) / max(len(gaps), 1)
    assert np.any(align) == (blocked < 5)
    target = next((i for i in range(furthest + 6, 31) if free[i]), 30)
    follow = [(5.0 * math.hypot(*(points[-1, k, :2] - local[target]))) ** 2 for k in range(24)]
    np.testing.assert_allclose(rollouts.cost, align + follow, rtol=1e-3)


def test_path_critics_stop_near_the_end() -> None:
    assert not np.any(run(FOLLOWING, jnp.array([0.7, 0.2, 0.0]), empty())[0].cost)


def test_costs_of_cells_and_outside() -> None:
    costs = room(1)
    x, y = np.random.default_rng(2).uniform(-5, 5, (2, 300))
    wanted = [cell(costs, *point) for point in zip(x, y, strict=True)]
    np.testing.assert_array_equal(costs.at(jnp.asarray(x), jnp.asarray(y)), wanted)
    assert 255.0 in wanted


def test_smoothing_is_a_savitzky_golay_filter() -> None:
    rng = np.random.default_rng(0)
    sequence, past = rng.normal(size=21), rng.normal(size=4)
    for order in (1, 2):
        whole = signal.savgol_filter(np.concatenate([past, sequence, np.repeat(sequence[-1:], 4)]), 9, order)
        wanted = np.append(whole[4:-5], sequence[-1])  # the last one stays
        np.testing.assert_allclose(smoothed(jnp.asarray(sequence), jnp.asarray(past), order), wanted, rtol=1e-9)
    for short, order in ((sequence, 0), (sequence[:20], 2)):
        np.testing.assert_array_equal(smoothed(jnp.asarray(short), jnp.asarray(past), order), short)


def test_shift_reads_between_the_steps() -> None:
    sequence = np.random.default_rng(0).normal(size=6)
    for steps in (0.0, 0.2, 1.0, 2.5, 5.0, 9.0):
        wanted = np.interp(np.arange(6) + steps, np.arange(6), sequence)
        np.testing.assert_allclose(shifted(jnp.asarray(sequence), steps), wanted, rtol=1e-9)


def test_robots_side_by_side_equal_single_ones() -> None:
    config = replace(SMALL, batch_size=40, gamma=0.015, sgf_order=2, critics=(CostCritic(), PathFollowCritic()))
    goals, state = jnp.array([[2.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]]), initial_state(config)
    poses = jnp.array([[0.3, 0.2, 0.4], [-1.0, 0.5, 2.0], [1.7, 0.1, 0.0]])
    paths, keys = jnp.stack([straight(goal) for goal in goals]), jax.random.split(KEY, 3)
    costs = replace(room(), cost=jnp.stack([room(seed).cost for seed in range(3)]))
    robots = (jax.tree.map(lambda a: jnp.stack([a, a + 0.1, a]), state), poses, costs, paths, goals, keys)
    singles = [step(config, *jax.tree.map(lambda a, i=i: a[i], robots)) for i in range(3)]
    for together in (jax.jit(jax.vmap(partial(mppi.step, config))), jax.jit(partial(step_each, config))):
        for i, single in enumerate(singles):
            for one, many in zip(jax.tree.leaves(single), jax.tree.leaves(together(*robots)), strict=True):
                np.testing.assert_allclose(many[i], one, rtol=1e-9, atol=1e-12)


def test_float32_stays_float32() -> None:
    config = MppiConfig(batch_size=16, time_steps=8)
    pose, goal = POSE.astype(jnp.float32), jnp.array([2.0, 0.0, 0.0], jnp.float32)
    costs = MapCosts(jnp.zeros((60, 80), jnp.uint8), 0.1, (-4.0, -3.0))
    path = straight(goal).astype(jnp.float32)
    out = step(config, initial_state(config, jnp.float32), pose, costs, path, goal, KEY)
    assert {leaf.dtype.name for leaf in jax.tree.leaves(out)} == {"float32", "bool"}


def test_predicted_pose_is_that_after_the_commands_under_way() -> None:
    rng = np.random.default_rng(4)
    nu, omega, durations = rng.uniform(0.1, 0.7, 7), rng.uniform(-1.4, 1.4, 7), rng.uniform(0.0, 0.2, 7)
    durations[2] = 0.0
    got = predict(POSE, Command(jnp.asarray(nu), jnp.asarray(omega)), jnp.asarray(durations))
    x, y, theta = (float(v) for v in POSE)
    for v, w, h in zip(nu, omega, durations, strict=True):
        for _ in range(2000):
            x, y = x + v * h / 2000 * math.cos(theta + w * h / 4000), y + v * h / 2000 * math.sin(theta + w * h / 4000)
            theta += w * h / 2000
    np.testing.assert_allclose(got, [x, y, theta], atol=1e-8)


def drive(config: MppiConfig, pose: Array, costs: MapCosts, path: Array, goal: Array, cycles: int) -> np.ndarray:
    """Poses [cycles + 1, 3] of a robot that takes each command at once, at 20 Hz."""

    def cycle(carry: tuple, key: Array) -> tuple:
        state, at = carry
        command, state, _ = mppi.step(config, state, at, costs, path, goal, key)
        moved = predict(at, Command(command.nu[None], command.omega[None]), jnp.full(1, 0.05))
        return (state, moved), moved

    keys = jax.random.split(KEY, cycles)
    _, poses = jax.jit(lambda: jax.lax.scan(cycle, (initial_state(config), pose), keys))()
    return np.concatenate([np.asarray(pose)[None], poses])


def test_a_robot_alone_reaches_its_goal_and_heading() -> None:
    goal = jnp.array([2.0, 0.0, 0.5])
    pose = jnp.array([-2.0, -1.0, 0.3])
    path = jnp.stack([jnp.linspace(-2.0, 2.0, 40), jnp.linspace(-1.0, 0.0, 40)], axis=1)
    poses = drive(MppiConfig(batch_size=300, time_steps=40), pose, empty(), path, goal, 400)
    gap = np.hypot(poses[:, 0] - 2.0, poses[:, 1])
    assert np.all(gap[-60:] < 0.25)
    assert abs(poses[-1, 2] - 0.5) < 0.3
    line = np.abs((poses[:, 1] + 1.0) * 4.0 - (poses[:, 0] + 2.0)) / math.sqrt(17.0)
    assert line.max() < 0.2


def test_a_predicted_start_makes_up_for_the_delay_of_the_loop() -> None:
    """Commands take effect 12 cycles (0.6 s) after the pose was sampled, on a straight path."""
    goal, lag = jnp.array([2.0, 0.0, 0.0]), 12
    config = replace(STACK_MPPI, batch_size=200, time_steps=40, vx_max=0.7)
    path = jnp.array([[-2.0, 0.0], [2.0, 0.0]])

    def cycle(aware: Array, carry: tuple, key: Array) -> tuple:
        state, at, way, driven = carry
        begin = jnp.where(aware, predict(at, Command(way[:, 0], way[:, 1]), jnp.full(lag, 0.05)), at)
        speed = Command(*jnp.where(aware, way[-1], driven))
        command, state, _ = mppi.step(config, state, begin, empty(), path, goal, key, speed=speed)
        moved = predict(at, Command(way[:1, 0], way[:1, 1]), jnp.full(1, 0.05))
        later = jnp.concatenate([way[1:], jnp.stack([command.nu, command.omega])[None]])
        return (state, moved, later, way[0]), moved

    def poses(aware: bool) -> np.ndarray:
        begin = (initial_state(config), jnp.array([-2.0, 0.5, 0.0]), jnp.zeros((lag, 2)), jnp.zeros(2))
        return np.asarray(jitted(jnp.asarray(aware), begin))

    jitted = jax.jit(lambda aware, begin: jax.lax.scan(partial(cycle, aware), begin, jax.random.split(KEY, 240))[1])
    aware, late = poses(True), poses(False)
    assert np.mean(np.abs(aware[40:, 1])) < 0.5 * np.mean(np.abs(late[40:, 1]))
    assert np.hypot(*(aware[-1, :2] - goal[:2])) < 0.1
    assert np.min(aware[:, 1]) > -0.05 and np.min(late[:, 1]) < -0.15  # it does not overshoot


def test_a_gap_in_a_wall_is_passed_without_contact() -> None:
    """A wall at x = 0 with a gap of 0.9 m about y = 1, inflated by 0.2 m, and a path around its corners."""
    x, y = np.meshgrid(-4 + 0.05 * (np.arange(160) + 0.5), -3 + 0.05 * (np.arange(120) + 0.5))
    along = np.maximum(np.maximum(y - 0.55, 0) * (y < 1), np.maximum(1.45 - y, 0) * (y >= 1))
    distance = np.hypot(np.maximum(np.abs(x) - 0.1, 0), along)
    cost = np.where(distance < 0.025, 254.0, np.where(distance < 0.2, 253.0, 252 * np.exp(-5 * (distance - 0.2))))
    costs = MapCosts(jnp.asarray(np.where(distance > 0.6, 0.0, np.floor(cost))), 0.05, (-4.0, -3.0))
    corners = np.array([[-2.0, -1.0], [-0.5, 1.0], [0.5, 1.0], [2.0, -1.0]])
    goal = jnp.array([2.0, -1.0, -0.9])
    poses = drive(MppiConfig(batch_size=400), jnp.array([-2.0, -1.0, 0.9]), costs, jnp.asarray(corners), goal, 450)
    assert max(cell(costs, *pose[:2]) for pose in poses) < 253
    assert math.hypot(poses[-1, 0] - 2.0, poses[-1, 1] + 1.0) < 0.25


def corners() -> Array:
    """A path of 10.5 m with four right angles, a point every 5 cm."""
    turns = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 2.0], [6.0, 2.0], [6.0, 0.0], [6.5, 0.0]])
    reached = np.append(0.0, np.cumsum(np.hypot(*np.diff(turns, axis=0).T)))
    at = np.linspace(0.0, reached[-1], 211)
    return jnp.asarray(np.stack([np.interp(at, reached, turns[:, i]) for i in (0, 1)], axis=1))


# Seconds that Nav2's own controller takes, of its branch main with new noise each cycle: all of 13 runs, all of 4, 9.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("vx_std", "prune_distance", "weight", "least", "most"),
    [(0.3, 2.5, 10.0, 19.0, 26.5), (0.2, 2.5, 10.0, 18.0, 20.0), (0.2, 1.5, 5.0, 23.0, 24.8)],
)
def test_time_to_the_goal_moves_with_the_sampling_as_that_of_nav2(
    vx_std: float, prune_distance: float, weight: float, least: float, most: float
) -> None:
    critics = tuple(
        replace(each, cost_weight=weight) if isinstance(each, PathFollowCritic) else each for each in STACK_MPPI.critics
    )
    config = MppiConfig(vx_max=0.7, vx_std=vx_std, prune_distance=prune_distance, critics=critics)
    costs, goal = MapCosts(jnp.zeros((160, 280)), 0.05, (-2.0, -4.0)), jnp.array([6.5, 0.0, 0.0])
    poses = drive(config, jnp.zeros(3), costs, corners(), goal, 600)
    arrived = np.flatnonzero(np.hypot(poses[:, 0] - 6.5, poses[:, 1]) <= 0.25)
    assert len(arrived) and least <= 0.05 * arrived[0] <= most


def test_a_robot_with_no_way_out_stops() -> None:
    goal, config = jnp.array([2.0, 0.0, 0.0]), replace(SMALL, critics=(CostCritic(),))
    walled = replace(empty(), cost=jnp.full((60, 80), 254.0))
    state = replace(initial_state(config), vx=jnp.full(22, 0.3))
    command, after, rollouts = step(config, state, POSE, walled, straight(goal), goal, KEY)
    assert bool(rollouts.blocked) and float(command.nu) == 0.0 and not np.any(after.vx)
    command, _, _ = step(replace(config, stop_if_blocked=False), state, POSE, walled, straight(goal), goal, KEY)
    assert float(command.nu) > 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"batch_size": 0}, "batch_size: got 0, expected at least 1"),
        ({"time_steps": 1}, "time_steps: got 1, expected at least 2"),
        ({"ax_max": 0.0}, "ax_max: got 0.0, expected > 0"),
        ({"ax_max": -math.inf}, "ax_max: got -inf, expected finite"),
        ({"ax_min": 3.0}, "ax_min: got 3.0, expected <= 0"),
        ({"az_max": math.nan}, "az_max: got nan"),
        ({"time_steps": 2.5}, "time_steps: got 2.5"),
        ({"iteration_count": 0}, "iteration_count"),
        ({"temperature": 0.0}, "temperature: got 0.0, expected > 0"),
        ({"model_dt": -0.1}, "model_dt"),
        ({"vx_std": -0.1}, "vx_std"),
        ({"vx_min": 0.6}, "vx_min: got 0.6, expected <= 0.5"),
        ({"gamma": math.nan}, "gamma"),
        ({"sgf_order": 3}, "sgf_order"),
        ({"path_spacing": 2.0}, "path_spacing: got 2.0, expected at most prune_distance"),
        ({"critics": ()}, "critics"),
        ({"critics": (CostCritic(cost_weight=-1.0),)}, "CostCritic.cost_weight: got -1.0, expected >= 0"),
        ({"critics": (PathAlignCritic(trajectory_point_step=0),)}, "PathAlignCritic.stride: got 0"),
    ],
)
def test_bad_parameters_are_named(changes: dict, message: str) -> None:
    with pytest.raises((ValueError, TypeError)) as error:
        MppiConfig(**changes)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pose": jnp.zeros(2)}, "pose: got shape (2,), expected (3,)"),
        ({"goal": jnp.zeros(2)}, "goal: got shape (2,), expected (3,)"),
        ({"path": jnp.zeros((1, 2))}, "path: got shape (1, 2), expected (P, 2) with P at least 2"),
        ({"state": initial_state(MppiConfig())}, "state.vx: got shape (56,), expected (22,)"),
    ],
)
def test_bad_shapes_are_named(changes: dict, message: str) -> None:
    good = {"state": initial_state(SMALL), "pose": POSE, "path": straight(POSE), "goal": POSE}
    with pytest.raises(ValueError) as error:
        mppi.step(SMALL, costmap=empty(), key=KEY, **(good | changes))
    assert message in str(error.value)
