"""Damaged bags: the same numbers, or findings that account for what is not the same, or one line. Never a traceback."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from bag_files import COMPRESSIONS, packed, split_bag, write_mcap, write_packed_messages, write_wal
from bags import ODOM, STAMPED, Message, pose, stamped, write_bag
from damage import Damage, damaged

from qocjax.recorded import TopicPatterns
from qocjax.recorded.content import read_bag
from qocjax.recorded.findings import Findings
from qocjax.recorded.topics import BagContent

TOPICS = TopicPatterns(("/{robot}/odom", "/odom"), ("/{robot}/cmd_vel", "/cmd_vel"))


def drive(count: int = 60) -> list[Message]:
    """Odometry at 20 Hz, and commands that bear its stamps."""
    messages: list[Message] = []
    for k in range(count):
        time = 0.05 * k
        messages.append((time, "/odom", ODOM, pose(ODOM, time, 0.01 * k, 0.1, 0.2, "odom")))
        messages.append((time + 0.02, "/cmd_vel", STAMPED, stamped(time, 0.2, 0.01 * k)))
    return messages


def _mcap(**options: object) -> Callable[[Path], Path]:
    return lambda path: write_mcap(path / "bag.mcap", drive(), chunk_size=8_000, **options)


def _sqlite(path: Path) -> Path:
    return next(write_bag(path / "bag", drive()).glob("*.db3"))


def _wal(path: Path) -> Path:
    return next(write_wal(path / "bag", drive(), 45).glob("*-wal"))


def _packed(storage: str) -> Callable[[Path], Path]:
    def make(path: Path) -> Path:
        folder = split_bag(path / "bag", [drive()], storage)
        return packed(next(folder.iterdir()))

    return make


def _metadata(path: Path) -> Path:
    return write_bag(path / "bag", drive(), "mcap") / "metadata.yaml"


FORMATS: dict[str, Callable[[Path], Path]] = {
    "sqlite": _sqlite,
    "sqlite_wal": _wal,
    "sqlite_zstd": _packed("sqlite3"),
    "sqlite_messages_zstd": lambda path: next(write_packed_messages(path / "bag", drive()).glob("*.db3")),
    "mcap_none": _mcap(compression=COMPRESSIONS["none"]),
    "mcap_lz4": _mcap(compression=COMPRESSIONS["lz4"]),
    "mcap_zstd": _mcap(compression=COMPRESSIONS["zstd"]),
    "mcap_unchunked": _mcap(use_chunking=False),
    "mcap_file_zstd": _packed("mcap"),
    "metadata": _metadata,
}
"""Each writes a bag into a folder and returns the file that is damaged."""

UNCHECKED = ("sqlite", "sqlite_wal", "sqlite_messages_zstd", "mcap_unchunked")
"""Formats without checksums over their content: that a byte of a message is another cannot be known."""
PACKED = ("sqlite_zstd", "mcap_file_zstd")
"""Packed without a checksum, as rosbag2 does: a byte there may be any number of bytes in the messages."""


@dataclass(frozen=True)
class Outcome:
    """What came out of a bag."""

    content: BagContent | None
    said: int  # findings and remarks
    error: str = ""


def outcome(path: Path) -> Outcome:
    findings = Findings()
    try:
        content = read_bag(path, TOPICS, findings, quiet=True)
    except ValueError as error:
        return Outcome(None, 1, str(error))
    return Outcome(content, sum(findings.counts.values()) + len(findings.notes))


def rows(content: BagContent) -> Counter[tuple]:
    """Every message that was read, as numbers."""
    found: Counter[tuple] = Counter()
    for part in (content.poses, content.commands):
        for robot, raw in part.items():
            values = np.frombuffer(raw.values, np.int64).reshape(-1, 3)
            found.update(
                (robot, raw.kind, r, s, *map(int, v)) for r, s, v in zip(raw.record, raw.stamp, values, strict=True)
            )
    return found


def judge(name: str, whole: Outcome, got: Outcome, damage: Damage) -> str:
    """How a mutant came out; an empty answer is a silent difference."""
    if got.content is None:
        assert got.error and "\n" not in got.error, got.error
        return "refused"
    assert whole.content is not None
    expected, found = rows(whole.content), rows(got.content)
    if expected == found:
        return "equal"
    if got.said > whole.said:
        return "told"
    lost, new = (expected - found).total(), (found - expected).total()
    hit = len(damage.spans) if all(end - start <= 512 for start, end in damage.spans) else 9
    return "values" if lost == new and (name in PACKED or (name in UNCHECKED and new <= 2 * hit + 2)) else ""


def mutate(name: str, folder: Path, seeds: range) -> Counter[str]:
    """Reads mutants of a format and counts how they came out."""
    file = FORMATS[name](folder)
    bag = file if name.startswith("mcap") and name != "mcap_file_zstd" else file.parent
    content = file.read_bytes()
    whole = outcome(bag)
    assert whole.content is not None and sum(rows(whole.content).values()) == 120
    counts: Counter[str] = Counter()
    for seed in seeds:
        damage = damaged(content, seed)
        file.write_bytes(damage.content)
        got = judge(name, whole, outcome(bag), damage)
        assert got, f"{name}, seed {seed}: differs in silence after {damage.words}"
        counts[got] += 1
    shutil.rmtree(folder, ignore_errors=True)
    return counts


@pytest.mark.parametrize("name", FORMATS)
def test_damaged_bags_are_read_or_told(name: str, tmp_path: Path) -> None:
    assert mutate(name, tmp_path / "bags", range(50)).total() == 50


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_500_damaged_bags_of_each_format(name: str, tmp_path: Path) -> None:
    counts = mutate(name, tmp_path / "bags", range(1000, 1500))
    print(name, dict(counts))
    assert counts.total() == 500
