"""Random bags whose truth is known: it is found, or a finding says what could not be known. No silent difference."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from bag_files import COMPRESSIONS, packed, split_bag, write_mcap, write_packed_messages, write_wal
from bags import EPOCH, ODOM, STAMPED, TWIST, Message, pose, speeds, stamped, write_bag

from qocjax.recorded import Rules, RunFiles, TopicPatterns, read_run
from qocjax.recorded.bags import storage_files
from qocjax.recorded.run import RecordedRun

TOPICS = TopicPatterns(("/{robot}/odom", "/odom"), ("/{robot}/cmd_vel", "/cmd_vel"))
LAYOUTS = ("db3", "mcap", "db3_splits", "mcap_splits", "db3_zstd", "mcap_zstd", "wal", "packed_messages", "mcap_lz4",
           "mcap_unchunked", "mcap_no_repeats", "mcap_no_statistics")  # fmt: skip


@dataclass
class Truth:
    """What a bag is made of, and what happened to it."""

    layout: str
    speed: float  # m/s
    seconds: float
    period: float  # s
    loop: float | None  # s, of commands with the stamp of their source; None for commands without
    happened: list[str] = field(default_factory=list)
    lost: int = 0  # loops

    def x(self, time: float) -> float:
        return self.speed * min(max(time - 1.0, 0.0), self.seconds - 2.0)


def make(rng: random.Random) -> tuple[Truth, list[Message]]:
    """A run: a robot stands for a second, drives along x, and stands again."""
    loop = rng.choice((None, 0.03, 0.12))
    truth = Truth(
        rng.choice(LAYOUTS), rng.uniform(0.1, 0.5), rng.uniform(6.0, 12.0), rng.choice((0.02, 0.05, 0.1)), loop
    )
    count = int(truth.seconds / truth.period)
    lost = {k for k in range(2, count - 2) if loop is not None and rng.random() < 0.02}
    truth.lost = len(lost)
    messages: list[Message] = []
    for k in range(count):
        time = truth.period * k + 1e-4 * rng.random()
        late = 0.002 + 0.003 * rng.random()
        messages.append((time + late, "/odom", ODOM, pose(ODOM, time, truth.x(time), 0.0, 0.0, "odom")))
        if loop is None:
            messages.append((time + 0.01, "/cmd_vel", TWIST, speeds(truth.speed, 0.0)))
        elif k not in lost:
            messages.append((time + loop, "/cmd_vel", STAMPED, stamped(time, truth.speed, 0.0)))
    return truth, sorted(messages, key=lambda message: message[0])


def restamped(message: Message, late: float) -> Message:
    """A message at another time on the robot's clock."""
    record, topic, kind, content = message
    if kind != TWIST:
        ns = content.header.stamp.sec * 10**9 + content.header.stamp.nanosec + round(late * 1e9)
        content.header.stamp.sec, content.header.stamp.nanosec = divmod(ns, 10**9)
    return record, topic, kind, content


def stamp_of(message: Message) -> float:
    """Of the state that a message tells of, or answers (s)."""
    if message[2] == TWIST:
        return message[0]
    return message[3].header.stamp.sec - EPOCH // 10**9 + 1e-9 * message[3].header.stamp.nanosec


def happen(truth: Truth, messages: list[Message], rng: random.Random) -> list[Message]:
    """Clock steps, pauses, duplicates and disorder."""
    middle = len(messages) // 2
    event = rng.choice(("nothing", "clock", "clock", "stamps", "gap", "duplicates", "disorder", "both"))
    truth.happened.append(event)
    at = messages[middle][0]
    step = rng.choice((-1, 1)) * 10.0 ** rng.uniform(0.5, 5.0)
    if event in ("clock", "both"):
        messages = [(m[0] + step * (k >= middle), *m[1:]) for k, m in enumerate(messages)]
    if event in ("stamps", "both"):
        messages = [restamped(m, step) if stamp_of(m) >= at else m for m in messages]
    if event == "gap":
        start = messages[middle][0]
        messages = [m for m in messages if not start < m[0] < start + 1.5]
    if event == "duplicates":
        messages = [*messages, *(m for m in messages[-6:] if m[2] != TWIST)]
    if event == "disorder":
        order = sorted(range(len(messages)), key=lambda k: k + rng.uniform(0.0, 3.0))
        messages = [messages[k] for k in order]
    return messages


def write(truth: Truth, messages: list[Message], folder: Path) -> Path:
    name, layout = folder / "bag", truth.layout
    if layout in ("db3", "mcap"):
        return write_bag(name, messages, "sqlite3" if layout == "db3" else "mcap")
    if layout.endswith("_splits") or layout in ("db3_zstd", "mcap_zstd"):
        size = max(len(messages) // 3, 1)
        parts = [messages[k : k + size] for k in range(0, len(messages), size)]
        split_bag(name, parts, "sqlite3" if layout.startswith("db3") else "mcap")
        for file in storage_files(name) if layout.endswith("_zstd") else ():
            packed(file)
        return name
    if layout == "wal":
        return write_wal(name, messages, len(messages) // 3)
    if layout == "packed_messages":
        return write_packed_messages(name, messages)
    options = {
        "mcap_lz4": {"compression": COMPRESSIONS["lz4"], "chunk_size": 20_000},
        "mcap_unchunked": {"use_chunking": False},
        "mcap_no_repeats": {"repeat_channels": False}, "mcap_no_statistics": {"use_statistics": False},
    }[layout]  # fmt: skip
    return write_mcap(folder / "bag.mcap", messages, **options)


def judge(truth: Truth, run: RecordedRun) -> str:
    """Whether the truth was found, or told not to be; an empty answer is a silent difference."""
    causes = {each.cause for each in run.findings}
    right = run.quality is not None
    if run.quality is not None:
        x = run.quality.pose[:, 0, 0]
        begin = run.quality.time  # the run begins with the first pose
        right &= math.isclose(run.quality.duration, truth.seconds, abs_tol=0.15 + truth.period)
        right &= bool(np.abs(x - [truth.x(t) for t in begin]).max() < 0.02)
        right &= math.isclose(run.quality.path_length[0], truth.x(truth.seconds), abs_tol=0.03)
    if truth.loop is not None and right:
        trace = run.loops.get("robot")
        if trace is None:
            right = False
        else:
            got = trace.table["loop_time"][~trace.table["lost"]]
            gone = truth.happened == ["gap"]
            right &= bool(np.abs(got - truth.loop).max() < 5e-3)
            right &= gone or int(trace.table["lost"].sum()) == truth.lost
    expected = {
        "clock": "clock_set", "both": "clock_set", "gap": "gaps", "stamps": "restarts", "duplicates": "duplicates",
        "disorder": "unordered",
    }  # fmt: skip
    cause = expected.get(truth.happened[0])
    if right and cause is None:
        return "" if causes else "found"
    if right:
        return "found" if causes else ""
    return "told" if causes & {"clock_set", "restarts", "clock_unknown", "gaps", "jumps", "ahead_of_clock"} else ""


def check(seed: int, folder: Path) -> str:
    rng = random.Random(seed)
    truth, messages = make(rng)
    messages = happen(truth, messages, rng)
    folder.mkdir(exist_ok=True)
    path = write(truth, messages, folder)
    run = read_run(RunFiles("run", bag=path), Rules(TOPICS), quiet=True)
    found = judge(truth, run)
    assert found, f"seed {seed}: {truth} in silence: {run.findings}, {run.duration}"
    return f"{truth.happened[0]} {found}"


@pytest.mark.parametrize("seed", range(25))
def test_random_bags_are_read_right_or_told(seed: int, tmp_path: Path) -> None:
    check(seed, tmp_path)


@pytest.mark.slow
def test_500_random_bags_are_read_right_or_told(tmp_path: Path) -> None:
    counts: dict[str, int] = {}
    for seed in range(1000, 1500):
        found = check(seed, tmp_path / str(seed))
        counts[found] = counts.get(found, 0) + 1
    print(dict(sorted(counts.items())))
    assert sum(n for words, n in counts.items() if words.endswith("found")) > 490
