"""Bags in every layout that recorders leave: as much is read as is there, and what is not there is said."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_files import COMPRESSIONS, packed, split_bag, write_mcap, write_packed_messages, write_wal
from bags import ODOM, STAMPED, TWIST, Message, pose, speeds, stamped, write_bag
from mcap.writer import IndexType

from qocjax.recorded import Rules, RunFiles, TopicPatterns, Yardstick, read_run
from qocjax.recorded.bags import storage_files
from qocjax.recorded.run import RecordedRun

TOPICS = TopicPatterns(("/{robot}/odom", "/odom"), ("/{robot}/cmd_vel", "/cmd_vel"))
GOAL = Yardstick(goal=(3.6, 0.0), v_max=0.22)


def straight(seconds: float = 20.0, speed: float = 0.2) -> list[Message]:
    """Odometry at 20 Hz of a robot that stands for a second, drives along x, and stands again."""
    return [
        (t + 0.002, "/odom", ODOM, pose(ODOM, t, speed * min(max(t - 1.0, 0.0), seconds - 2.0), 0.0, 0.0, "odom"))
        for t in (0.05 * k for k in range(round(20 * seconds) + 1))
    ]


def read(path: Path) -> RecordedRun:
    return read_run(RunFiles("run", bag=path), Rules(TOPICS, yardstick=GOAL), quiet=True)


def found(run: RecordedRun) -> dict[str, int]:
    return {each.cause: each.count for each in run.findings}


def is_whole(run: RecordedRun, seconds: float = 20.0, length: float = 3.6) -> None:
    assert run.quality is not None and run.quality.duration == pytest.approx(seconds)
    assert run.quality.path_length[0] == pytest.approx(length, abs=1e-6)


@pytest.mark.parametrize("checkpoint", [0, 200, 400])
def test_what_lies_in_a_log_beside_the_file_is_read(checkpoint: int, tmp_path: Path) -> None:
    folder = write_wal(tmp_path / "killed", straight(), checkpoint)
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    for path in (folder, folder / "killed_0.db3"):
        run = read(path)
        is_whole(run)
        assert found(run) == {} and run.quality is not None
        assert run.quality.auc[0] == pytest.approx(0.193, abs=2e-3)
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before  # nothing is written beside


def test_a_log_that_was_cut_is_told(tmp_path: Path) -> None:
    folder = write_wal(tmp_path / "killed", straight(), 200)
    log = folder / "killed_0.db3-wal"
    log.write_bytes(log.read_bytes()[:-3000])
    run = read(folder)
    assert found(run) == {"damaged": 1} and any("-wal" in note for note in run.findings.notes)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize("zipped", [False, True])
def test_splits_without_metadata_in_the_order_of_their_numbers(storage: str, zipped: bool, tmp_path: Path) -> None:
    messages = straight(60.0, 0.1)
    folder = split_bag(tmp_path / "run", [messages[100 * k : 100 * (k + 1)] for k in range(12)], storage)
    if zipped:
        for file in storage_files(folder):
            packed(file)
    run = read(folder)
    is_whole(run, 59.95, 5.8)
    assert found(run) == {}
    one = read(storage_files(folder)[0])
    assert one.quality is not None and one.quality.duration == pytest.approx(4.95)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_broken_split_takes_no_whole_one_with_it(storage: str, tmp_path: Path) -> None:
    messages = straight(60.0, 0.1)
    folder = split_bag(tmp_path / "run", [messages[400 * k : 400 * (k + 1)] for k in range(3)], storage)
    middle = packed(storage_files(folder)[1])
    middle.write_bytes(b"no archive at all")
    run = read(folder)
    assert found(run)["truncated"] == 1 and found(run)["gaps"] == 1
    assert run.quality is not None and run.quality.time.size == 800


VARIANTS: dict[str, dict[str, Any]] = {
    "zstd": {"compression": COMPRESSIONS["zstd"]}, "lz4": {"compression": COMPRESSIONS["lz4"]},
    "plain": {"compression": COMPRESSIONS["none"], "chunk_size": 4096}, "unchunked": {"use_chunking": False},
    "no index": {"index_types": IndexType.NONE}, "no statistics": {"use_statistics": False},
    "no offsets": {"use_summary_offsets": False}, "no repeated channels": {"repeat_channels": False},
    "no repeats": {"repeat_channels": False, "use_statistics": False}, "no profile": {"profile": ""},
    "bare": {"use_chunking": False, "index_types": IndexType.NONE, "repeat_channels": False, "use_statistics": False,
             "use_summary_offsets": False},
    "two channels": {"channels": 2}, "checksums": {"enable_crcs": True, "enable_data_crcs": True},
}  # fmt: skip


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_layout_of_mcap_gives_the_same(variant: str, tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "folder" / "bag.mcap", straight(), **VARIANTS[variant])
    for place in (path, path.parent):
        run = read(place)
        is_whole(run)
        assert found(run) == {} and run.qos == {"/odom": "reliable keep_last(10)"}


def test_records_out_of_order_are_whole(tmp_path: Path) -> None:
    messages = straight()
    shuffled = [*messages[200:], *messages[:200]]
    is_whole(read(write_mcap(tmp_path / "shuffled.mcap", shuffled, chunk_size=4096)))
    swapped = list(messages)
    swapped[50:52] = [swapped[51], swapped[50]]
    for options in ({"use_chunking": False}, {}):
        run = read(write_mcap(tmp_path / "swapped.mcap", swapped, **options))
        is_whole(run)
        assert "truncated" not in found(run) and "missing_messages" not in found(run)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize("stamped_first", [True, False])
def test_a_topic_of_two_types_is_read_by_the_type_of_each_message(
    storage: str, stamped_first: bool, tmp_path: Path
) -> None:
    commands: list[Message] = []
    for k in range(400):
        time = 0.05 * k
        if k % 10 == (5 if stamped_first else 0):
            commands.append((time + 0.1, "/cmd_vel", TWIST, speeds(0.1, 0.0)))
        else:
            commands.append((time + 0.1, "/cmd_vel", STAMPED, stamped(time, 0.2, 0.0)))
    run = read(write_bag(tmp_path / "bag", sorted([*straight(), *commands], key=lambda each: each[0]), storage))
    assert run.commands["robot"].count == 400 and "no_stamp" not in found(run)
    table = run.loops["robot"].table
    assert (~table["lost"]).sum() == 360
    np.testing.assert_allclose(table.loc[~table["lost"], "loop_time"], 0.1, atol=1e-6)


def test_channels_of_other_encodings_do_not_matter(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "bag.mcap", straight())
    other = write_mcap(tmp_path / "json.mcap", [(1.0, "/odom", "foxglove.Pose", b"{}")], encoding="json")
    with pytest.raises(ValueError, match="no topic is one of"):
        read(other)
    folder = tmp_path / "both"
    folder.mkdir()
    for k, file in enumerate((path, other)):
        shutil.copy(file, folder / f"both_{k}.mcap")
    is_whole(read(folder))


def test_messages_packed_one_by_one(tmp_path: Path) -> None:
    run = read(write_packed_messages(tmp_path / "bag", straight()))
    is_whole(run)
    assert found(run) == {}


def test_what_the_metadata_says_is_held_against_what_is_there(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", straight())
    text = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(text.replace("message_count: 401", "message_count: 0"))
    is_whole(read(path))  # as a recorder wrote it when it began
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information: {version: 9")
    run = read(path)
    is_whole(run)
    assert any("metadata.yaml: cannot be read" in note for note in run.findings.notes)
    (path / "metadata.yaml").write_text(text)
    shutil.copy(path / "bag.db3", path / "bag_1.db3")
    run = read(path)
    is_whole(run)
    assert found(run)["duplicates"] == 401 and any("is not among the files" in note for note in run.findings.notes)
    (path / "bag.db3").unlink()
    run = read(path)
    assert found(run) == {"missing_files": 1}
    is_whole(run)


def test_one_content_in_two_formats_is_read_once(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", straight())
    write_bag(tmp_path / "copy", straight(), "mcap")
    shutil.copy(tmp_path / "copy" / "copy.mcap", path / "bag.mcap")
    (path / "metadata.yaml").unlink()
    run = read(path)
    is_whole(run)
    assert "duplicates" not in found(run) and any("left out" in note for note in run.findings.notes)


@pytest.mark.parametrize("options", [{"use_chunking": False}, {"compression": COMPRESSIONS["zstd"]}])
def test_a_broken_record_costs_no_more_than_itself(options: dict, tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "bag.mcap", straight(60.0, 0.1), chunk_size=8000, **options)
    content = bytearray(path.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 800] = b"\xff" * 800
    path.write_bytes(content)
    run = read(path)
    assert found(run)["damaged"] >= 1 and 1 <= found(run)["missing_messages"] <= 31
    assert run.quality is not None and run.quality.duration == pytest.approx(60.0)


def test_a_broken_page_costs_no_more_than_its_rows(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", straight(60.0, 0.1))
    (file,) = storage_files(path)
    content = bytearray(file.read_bytes())
    page = int.from_bytes(content[16:18], "big")
    place = page * (len(content) // page // 2)
    content[place : place + page] = b"\xff" * page
    file.write_bytes(content)
    run = read(path)
    assert found(run)["damaged"] >= 1 and found(run)["missing_messages"] <= 10
    assert run.quality is not None and run.quality.duration == pytest.approx(60.0)


def test_an_unread_topic_gives_way_to_the_next(tmp_path: Path) -> None:
    broken = [(0.1 * k, "/a/odom", ODOM, b"\x00\x01\x00\x00") for k in range(5)]
    good = [(m[0], "/odom", *m[2:]) for m in straight()]
    is_whole(read(write_bag(tmp_path / "bag", [*broken, *good])))
