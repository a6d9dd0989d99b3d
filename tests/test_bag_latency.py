"""The delay between commands and motion: known delays are found without bias, and the interval covers them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bags import ODOM, TWIST, Message, pose, speeds, write_bag

from qocjax.config.trace import TraceConfig
from qocjax.recorded import Rules, RunFiles, TopicPatterns, read_run
from qocjax.recorded.latency import command_to_motion
from qocjax.recorded.series import Series

STEP = 0.002  # s, of the exact motion


def drive(
    seed: int, delay: float, jitter: float = 0.0, noise: float = 1e-3, period: float = 0.1, every: float = 0.05,
    seconds: float = 60.0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Record times and speeds of commands, times and poses of a robot that follows `delay` to `delay + jitter` on."""
    rng = np.random.default_rng(seed)
    told = np.arange(0.0, seconds, period)
    told += 0.01 * rng.random(told.size)
    nu = np.clip(0.2 + 0.02 * np.cumsum(rng.normal(size=told.size)), 0.0, 0.5)
    omega = 0.8 * np.sin(0.5 * told + rng.uniform(0, 6)) + 0.3 * rng.normal(size=told.size)
    acts = told + delay + jitter * rng.random(told.size)
    time = np.arange(0.0, seconds, STEP)
    row = np.searchsorted(acts, time + STEP / 2, side="right") - 1
    v, w = (np.where(row >= 0, each[np.maximum(row, 0)], 0.0) for each in (nu, omega))

    def integral(rate: np.ndarray) -> np.ndarray:
        return np.append(0.0, np.cumsum(rate)[:-1] * STEP)

    heading = integral(w)
    path = np.column_stack([integral(v * np.cos(heading)), integral(v * np.sin(heading)), heading])
    seen = np.arange(0.0, seconds - 0.01, every)
    poses = np.column_stack([np.interp(seen, time, column) for column in path.T])
    return told, np.column_stack([nu, omega, 0 * nu]), seen, poses + noise * rng.normal(size=poses.shape)


def series(time: np.ndarray, values: np.ndarray, kind: str) -> Series:
    return Series(time, time, np.full(time.size, np.nan), np.zeros(time.size), values, kind, "odom")


@pytest.mark.parametrize(
    "options",
    [{}, {"jitter": 0.08}, {"noise": 0.01}, {"every": 0.02, "seconds": 30.0}, {"period": 0.2, "every": 0.1}],
)
def test_known_delays_are_found_and_covered(options: dict) -> None:
    errors, covered = [], 0
    for seed in range(20):
        delay = 0.05 + 0.3 * np.random.default_rng(1000 + seed).random()
        told, speeds_, seen, poses = drive(seed, delay, **options)
        found = command_to_motion(series(told, speeds_, TWIST), series(seen, poses, ODOM))
        assert found is not None
        truth = delay + options.get("jitter", 0.0) / 2
        errors.append(found.delay - truth)
        covered += found.low <= truth <= found.high
    assert covered >= 18  # of 20 intervals of 95 %
    assert abs(np.mean(errors)) < 3.0 * np.std(errors, ddof=1) / np.sqrt(len(errors)) + 2e-4
    assert np.std(errors) < 0.01


def test_what_cannot_be_known_is_not_said() -> None:
    told, speeds_, seen, poses = drive(1, 0.2)
    still = np.broadcast_to(np.array([0.2, 0.0, 0.0]), speeds_.shape)
    assert command_to_motion(series(told, still, TWIST), series(seen, poses, ODOM)) is None  # commands never change
    other = drive(2, 0.2)[3]
    assert command_to_motion(series(told, speeds_, TWIST), series(seen, other, ODOM)) is None  # of another robot
    assert command_to_motion(series(told, speeds_, TWIST), series(seen[:20], poses[:20], ODOM)) is None
    assert command_to_motion(series(told, speeds_, TWIST), series(seen, 0 * poses, ODOM)) is None  # it stands


def plain_twists() -> list[Message]:
    """A drive that answers 180 ms after its commands."""
    told, speeds_, seen, poses = drive(3, 0.18)
    messages: list[Message] = [
        (float(t), "/cmd_vel", TWIST, speeds(float(v), float(w))) for t, (v, w, _) in zip(told, speeds_, strict=True)
    ]
    messages += [
        (float(t), "/odom", ODOM, pose(ODOM, float(t), *map(float, p), "odom"))
        for t, p in zip(seen, poses, strict=True)
    ]
    return sorted(messages, key=lambda message: message[0])


def test_a_bag_of_plain_twists_tells_the_delay(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", plain_twists())
    run = read_run(RunFiles("run", bag=path), Rules(TopicPatterns(("/odom",), ("/cmd_vel",))), quiet=True)
    found = run.latency["robot"]
    assert found.low < 0.18 < found.high and found.high - found.low < 0.03 and found.correlation > 0.9


def test_a_bag_is_a_network(tmp_path: Path) -> None:
    """Without stamps of loops every loop takes the delay from commands to motion, and that is said."""
    write_bag(tmp_path / "bag", plain_twists())
    with pytest.warns(UserWarning, match="has no stamps of loops; every loop takes 1[78][0-9] ms"):
        network = TraceConfig(kind="trace", path=str(tmp_path / "bag")).build()
    assert float(network.compute.quantile(0.5)) == pytest.approx(0.18, abs=0.01)
    write_bag(tmp_path / "other", plain_twists())
    with pytest.raises(ValueError, match="holds 2 runs, 2 of them bags, expected one bag"):
        TraceConfig(kind="trace", path=str(tmp_path)).build()
