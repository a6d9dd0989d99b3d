"""Pieces of a bag that are not there, where no metadata tells of them: how long, how many, and what rests on them."""

from __future__ import annotations

import math
import re
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from bag_files import split_bag, write_mcap
from bags import ODOM, STAMPED, Message, pose, stamped, write_bag

from qocjax.recorded import Rules, RunFiles, TopicPatterns, Yardstick, read_run
from qocjax.recorded.numbering import Rows, Sequence
from qocjax.recorded.run import RecordedRun

RULES = Rules(
    TopicPatterns(("/{robot}/odom", "/odom"), ("/{robot}/cmd_vel", "/cmd_vel")), yardstick=Yardstick(goal=(2.0, 0.0))
)
HOLE = range(177, 224)  # loops of 400, while the robot goes round something


def drive(hole: range = range(0), late: range = range(0)) -> list[Message]:
    """Odometry at 20 Hz and commands that bear its stamps; some are not there, others are all recorded at once."""
    messages: list[Message] = []
    for k in set(range(400)) - set(hole):
        time, record = 0.05 * k, 0.05 * (late.stop if k in late else k)
        x, y = 0.1 * time, 1.5 * math.exp(-((time - 10.0) ** 2))
        messages.append((record, "/odom", ODOM, pose(ODOM, time, x, y, 0.0, "odom")))
        messages.append((record + 0.02, "/cmd_vel", STAMPED, stamped(time, 0.2, 0.01 * k)))
    return sorted(messages, key=lambda message: message[0])


def read(path: Path) -> RecordedRun:
    return read_run(RunFiles("run", bag=path), RULES, quiet=True)


def counts(run: RecordedRun, *causes: str) -> dict[str, int]:
    return {cause: number for cause in causes if (number := run.findings.total(cause))}


def without_metadata(folder: Path) -> Path:
    (folder / "metadata.yaml").unlink()
    return next(folder.glob("*.db3"))


def test_a_hole_says_how_long_it_is_and_what_rests_on_it(tmp_path: Path) -> None:
    whole, cut = (read(write_mcap(tmp_path / f"{len(hole)}.mcap", drive(hole))) for hole in (range(0), HOLE))
    assert whole.quality is not None and cut.quality is not None
    assert counts(whole, "silences") == {} and counts(cut, "silences") == {"silences": 1}
    (text,) = (note for note in cut.findings.notes if "no topic has a message" in note)
    (part, auc), length, loops = (
        re.findall(r"of AUC ([\d.]+) s of robot's ([\d.]+) s", text)[0], re.findall(r"longest ([\d.]+) s", text)[0],
        re.findall(r"about (\d+) of robot", text)[0],
    )  # fmt: skip
    assert abs(float(length) - 0.05 * (len(HOLE) + 1)) < 0.03 and int(loops) == len(HOLE)
    assert float(auc) == pytest.approx(cut.quality.auc[0], abs=1e-3)
    assert 0.0 < float(part) < cut.quality.auc[0] < whole.quality.auc[0] - 0.1
    # AUC of a stretch by itself: squared distance from the reference, both straight between two poses.
    time, apart = cut.quality.time, cut.quality.pose[:, 0, :2] - cut.quality.reference
    pieces = [h * ((a @ a + a @ b + b @ b) / 3) for h, a, b in zip(np.diff(time), apart[:-1], apart[1:], strict=True)]
    (wide,) = np.flatnonzero(np.diff(time) > 1.0)
    assert float(part) == pytest.approx(cut.quality.auc[0] * pieces[wide] / sum(pieces), rel=2e-3)


def test_short_holes_of_all_topics_count_and_what_comes_late_is_no_hole(tmp_path: Path) -> None:
    short = read(write_mcap(tmp_path / "short.mcap", drive(range(195, 202))))
    assert counts(short, "silences", "gaps") == {"silences": 1}  # too short for a gap of one topic
    late = read(write_mcap(tmp_path / "late.mcap", drive(late=HOLE)))  # recorded together, with stamps of their time
    assert counts(late, "silences") == {}


def holes_in_rows(tmp_path: Path) -> Path:
    """Rows deleted, and their index with them, as in a file that was recovered."""
    file = without_metadata(write_bag(tmp_path / "bag", drive()))
    with sqlite3.connect(file) as base:
        base.execute("DELETE FROM messages WHERE id BETWEEN 355 AND 448")
    base.close()
    return file


def overwritten_page(tmp_path: Path) -> Path:
    """A page of rows with another such page over it, as a disk may write it; without an index."""
    file = without_metadata(write_bag(tmp_path / "bag", drive()))
    with sqlite3.connect(file) as base:
        base.execute("DROP INDEX timestamp_idx")
    base.close()
    content, page = bytearray(file.read_bytes()), 4096
    leaves = [at for at in range(page, len(content), page) if content[at] == 0x0D]
    content[leaves[40] : leaves[40] + page] = content[leaves[30] : leaves[30] + page]
    file.write_bytes(content)
    return file


def missing_split(tmp_path: Path) -> Path:
    messages = drive()
    folder = split_bag(tmp_path / "bag", [messages[:300], messages[300:360], messages[360:]], "mcap")
    (folder / "bag_1.mcap").unlink()
    return folder


def holes_in_sequence(tmp_path: Path) -> Path:
    """Numbers of the publishers' own, in a file that was written anew without the chunks that were broken."""
    return write_mcap(tmp_path / "bag.mcap", drive(), left_out=range(400, 450))


LOST: dict[str, tuple[Callable[[Path], Path], dict[str, int | None]]] = {
    "rows": (holes_in_rows, {"missing_messages": 94}),
    "page": (overwritten_page, {"missing_messages": None}),
    "split": (missing_split, {"missing_files": 1}),
    "sequence": (holes_in_sequence, {"missing_numbers": 50}),
}


@pytest.mark.parametrize("case", LOST)
def test_what_numbers_promise_and_is_not_there_is_counted(case: str, tmp_path: Path) -> None:
    make, expected = LOST[case]
    found = counts(read(make(tmp_path)), *expected)
    assert found.keys() == expected.keys()
    assert all(number is None or found[cause] == number for cause, number in expected.items()), found


def test_numbers_of_whole_files_miss_none(tmp_path: Path) -> None:
    causes = ("missing_messages", "missing_files", "missing_numbers", "silences")
    for path in (
        write_mcap(tmp_path / "a.mcap", drive()),
        without_metadata(write_bag(tmp_path / "b", drive())),
        split_bag(tmp_path / "c", [drive()[:300], drive()[300:]], "sqlite3"),
    ):
        assert counts(read(path), *causes) == {}, path


@pytest.mark.parametrize(
    ("keys", "missing"),
    [
        ([1, 2, 3, 4], 0),
        ([3, 4, 7], 4),
        ([1, 2, 900, 4, 5], 1),  # the key of the third row is broken
        ([1, 2, 2**50, 4, 5], 1),
        ([1, 2, 3, 4, 2, 3, 8], 3),  # a page that is there twice
        ([], 0),
    ],
)
def test_keys_that_are_not_there(keys: list[int], missing: int) -> None:
    rows = Rows()
    for key in keys:
        rows.take(key)
    assert rows.missing == missing


@pytest.mark.parametrize(
    ("numbers", "missing"),
    [
        ([0] * 50, 0),
        (list(range(50)), 0),
        ([*range(20), *range(25, 60)], 5),
        ([*range(0, 60, 3), *range(75, 150, 3)], 5),  # counted over three topics
        ([*range(20), *range(30)], 0),  # begun anew
        ([0, 1, 5, 6], 0),  # too few to know
        ([k * k for k in range(40)], 0),
    ],
)
def test_sequence_numbers_that_are_not_there(numbers: list[int], missing: int) -> None:
    sequence = Sequence()
    for number in numbers:
        sequence.take(number)
    assert sequence.missing() == missing
