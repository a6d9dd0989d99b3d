"""The recorder's clock: set forward, set back, not begun yet; told from pauses, disorder and files that lie twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bags import EPOCH, ODOM, STAMPED, TWIST, Message, pose, speeds, stamped, write_bag

from qocjax.recorded import Rules, RunFiles, TopicPatterns, Yardstick, read_run
from qocjax.recorded.run import RecordedRun

TOPICS = TopicPatterns(("/{robot}/odom", "/odom"), ("/{robot}/cmd_vel", "/cmd_vel"))
RATE = 0.05


def x_at(time: float) -> float:
    return 0.2 * min(max(time - 1.0, 0.0), 18.0)


def drive(step: float = 0.0, at: float = 10.0, stamps_step: bool = True, commands: bool = True) -> list[Message]:
    """A run of 20 s in which the clock is set by a step."""
    messages: list[Message] = []
    for k in range(401):
        time = RATE * k
        late = step if time >= at else 0.0
        stamp = time + (late if stamps_step else 0.0)
        messages.append((time + late + 0.002, "/odom", ODOM, pose(ODOM, stamp, x_at(time), 0.0, 0.0, "odom")))
        if commands:
            messages.append((time + late + 0.02, "/cmd_vel", STAMPED, stamped(stamp, 0.2, 0.0)))
    return messages


def read(path: Path) -> RecordedRun:
    return read_run(
        RunFiles("run", bag=path), Rules(TOPICS, yardstick=Yardstick(goal=(3.6, 0.0), v_max=0.22)), quiet=True
    )


def found(run: RecordedRun) -> dict[str, int]:
    return {each.cause: each.count for each in run.findings}


@pytest.mark.parametrize(("step", "storage"), [
    (259200.0, "sqlite3"), (3.0, "mcap"), (-3.0, "mcap"), (-0.4, "mcap"), (-86400.0, "mcap"), (-1.0, "sqlite3"),
])  # fmt: skip
@pytest.mark.parametrize("stamps_step", [True, False])
def test_a_step_is_found_and_taken_out(step: float, stamps_step: bool, storage: str, tmp_path: Path) -> None:
    run = read(write_bag(tmp_path / "bag", drive(step, stamps_step=stamps_step), storage))
    assert found(run) == {"clock_set": 1}, run.findings.notes
    judged = run.quality
    assert judged is not None and judged.duration == pytest.approx(20.0, abs=0.01)
    np.testing.assert_allclose(judged.pose[:, 0, 0], [x_at(t) for t in judged.time], atol=2e-3)
    assert judged.auc[0] == pytest.approx(0.193, abs=2e-3)
    table = run.loops["robot"].table
    assert len(table) == 401 and not table["lost"].any()
    np.testing.assert_allclose(table["loop_time"], 0.02, atol=1e-6)


def test_several_steps_are_as_many_findings(tmp_path: Path) -> None:
    messages = [
        (m[0] + (500.0 if 100 <= k < 300 else 0.0) + (-2.0 if k >= 500 else 0.0), *m[1:])
        for k, m in enumerate(drive(stamps_step=False))
    ]
    run = read(write_bag(tmp_path / "bag", messages))
    assert found(run) == {"clock_set": 3}
    assert run.quality is not None and run.quality.duration == pytest.approx(20.0, abs=0.01)


def test_record_time_0_before_the_simulated_clock_begins(tmp_path: Path) -> None:
    messages = [((-EPOCH / 1e9 if k < 10 else m[0]), *m[1:]) for k, m in enumerate(drive(commands=False))]
    run = read(write_bag(tmp_path / "bag", messages))
    assert found(run) == {"clock_set": 1}
    assert run.quality is not None and run.quality.duration == pytest.approx(20.0)
    np.testing.assert_allclose(run.quality.pose[:, 0, 0], [x_at(t) for t in run.quality.time], atol=1e-6)


def test_commands_without_stamps_go_by_the_order_of_messages(tmp_path: Path) -> None:
    commands = [
        (RATE * k + 0.01 + (7200.0 if k >= 200 else 0.0), "/cmd_vel", TWIST, speeds(0.2, 0.0)) for k in range(400)
    ]
    run = read(write_bag(tmp_path / "bag", commands))
    assert found(run) == {"clock_set": 1}
    assert run.commands["robot"].longest_gap < 0.11
    assert any("cannot be known" in note for note in run.findings.notes)


def test_one_wrong_record_time_costs_no_more_than_itself(tmp_path: Path) -> None:
    messages = drive()
    messages[300] = (messages[300][0] + 1e7, *messages[300][1:])
    run = read(write_bag(tmp_path / "bag", messages))
    assert found(run) == {"clock_set": 1}
    assert run.quality is not None and run.quality.duration == pytest.approx(20.0, abs=0.01)


def test_a_pause_while_the_robot_drives_on_is_a_gap(tmp_path: Path) -> None:
    messages = [m for m in drive() if not 5.0 < m[0] < 9.0]
    run = read(write_bag(tmp_path / "bag", messages))
    assert "clock_set" not in found(run) and run.findings.total("gaps") == 2
    assert run.quality is not None and run.quality.duration == pytest.approx(20.0)


def test_a_robot_that_stands_for_a_while_is_no_step(tmp_path: Path) -> None:
    messages = [m for m in drive(commands=False) if m[0] < 0.5]
    messages += [(m[0] + 20.0, *m[1:3], pose(ODOM, m[0] + 20.0, 0.0, 0.0, 0.0, "odom")) for m in messages]
    run = read(write_bag(tmp_path / "bag", messages))
    assert "clock_set" not in found(run)


def test_a_topic_that_falls_silent_is_no_step(tmp_path: Path) -> None:
    messages = [m for m in drive() if m[1] != "/odom" or not 5.0 < m[0] < 9.0]
    run = read(write_bag(tmp_path / "bag", messages))
    assert found(run)["gaps"] == 1 and "clock_set" not in found(run)


def test_messages_a_little_out_of_order_are_no_steps(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    messages = drive()
    order = np.argsort(np.arange(len(messages)) + 12.0 * rng.random(len(messages)))
    run = read(write_bag(tmp_path / "bag", [messages[k] for k in order]))
    assert "clock_set" not in found(run)
    assert run.quality is not None
    np.testing.assert_allclose(run.quality.pose[:, 0, 0], [x_at(t) for t in run.quality.time], atol=1e-6)
