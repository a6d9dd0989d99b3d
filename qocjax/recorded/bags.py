"""rosbag2 recordings, whole or cut off: their topics, and their messages one after the other."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from qocjax.recorded.findings import Findings
from qocjax.recorded.salvage import Found, salvage, salvaged_topics

__all__ = ["Bag", "Topic", "is_bag", "open_bag", "storage_files"]

_SUFFIXES = (".db3", ".mcap", ".db3.zstd", ".mcap.zstd")
_METADATA = "metadata.yaml"
_RELIABILITY = {"1": "reliable", "2": "best_effort"}
_HISTORY = {"1": "keep_last", "2": "keep_all"}


@dataclass(frozen=True)
class Topic:
    """A topic of a bag."""

    name: str
    kind: str  # message type, such as geometry_msgs/msg/Twist
    count: int | None  # messages that the bag says it holds; None where it does not say
    qos: str  # offered, such as `reliable keep_last(10)`; empty where it does not say


class Bag:
    """An open recording; a context manager."""

    def __init__(self, path: Path, reader: Any, damaged: dict[Path, Found], findings: Findings) -> None:
        """Takes an open reader of rosbags, or the topics of each damaged file."""
        self.path, self._reader, self._damaged, self._findings = path, reader, damaged, findings
        if reader is not None:
            every = [
                Topic(c.topic, c.msgtype, c.msgcount, _words(c.ext.offered_qos_profiles)) for c in reader.connections
            ]
        else:
            found = [topic for topics in damaged.values() for topic in topics.values()]
            promised = _promised(path)
            every = [Topic(name, kind, promised.get(name), _yaml_words(profile)) for name, kind, profile in found]
        self.topics = {topic.name: topic for topic in every}

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        if self._reader is not None:
            self._reader.close()

    def messages(self, names: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """Yields topic, record time (ns) and data of the messages of some topics; one is in memory at a time."""
        if self._reader is None:
            for file, topics in self._damaged.items():
                wanted = {number: topic[0] for number, topic in topics.items() if topic[0] in names}
                for number, time, data in salvage(file, wanted):
                    yield wanted[number], time, data
            return
        connections = [each for each in self._reader.connections if each.topic in names]
        if not connections:
            return
        try:
            for connection, time, data in self._reader.messages(connections):
                yield connection.topic, time, data
        except _read_errors() as error:
            self._findings.count(str(self.path.name), "truncated")
            self._findings.note(f"{self.path.name}: cannot be read to its end: {_first_line(error)}")


def is_bag(path: Path) -> bool:
    """Whether a path is a bag's file, or a folder with one."""
    return bool(storage_files(path)) or (path.is_dir() and (path / _METADATA).is_file())


def storage_files(path: Path) -> list[Path]:
    """Files with messages: the path itself, or those directly in it, by name."""
    each = sorted(path.iterdir()) if path.is_dir() else [path]
    return [file for file in each if file.is_file() and file.name.endswith(_SUFFIXES)]


def open_bag(path: Path, findings: Findings) -> Bag:
    """Opens a rosbag2 folder or file; where it was cut off, what is left of it.

    Raises:
        ValueError: There is no bag, rosbags is not installed, or nothing of it can be read.
    """
    if not path.exists():
        raise ValueError(f"{path}: no such file or folder, expected a rosbag2 folder or a .db3 or .mcap file")
    if path.suffix == ".bag":
        raise ValueError(f"{path}: is a bag of ROS 1, expected rosbag2 (rosbags-convert makes one)")
    if not is_bag(path):
        raise ValueError(f"{path}: holds no .db3 or .mcap file, expected a rosbag2 folder or file")
    if importlib.util.find_spec("rosbags") is None:
        raise ValueError(f"{path}: needs rosbags to be read, expected it installed: pip install 'qocjax[ros]'")
    from rosbags.rosbag2 import Reader

    if path.is_dir() and not (path / _METADATA).is_file():
        findings.note(
            f"{path.name}: has no metadata.yaml, as when recording was not ended; its files are read as they are"
        )
        return _open_files(path, findings)
    try:
        reader = Reader(path)
        reader.open()
    except _read_errors() as error:
        findings.note(f"{path.name}: {_first_line(error)}")
        return _open_files(path, findings)
    return Bag(path, reader, {}, findings)


def _open_files(path: Path, findings: Findings) -> Bag:
    """Reads the files on their own, each as far as it goes."""
    damaged, errors = {}, []
    for file in storage_files(path):
        try:
            damaged[file] = salvaged_topics(file)
        except (ValueError, OSError) as error:
            errors.append(str(error))
            continue
        if _cut(file):
            findings.count(file.name, "truncated")
    if not damaged:
        raise ValueError("; ".join(errors) or f"{path}: names files in its metadata.yaml that are not there")
    for text in errors:
        findings.count(path.name, "truncated")
        findings.note(text)
    return Bag(path, None, damaged, findings)


def _promised(path: Path) -> dict[str, int]:
    """Messages of each topic according to the metadata; empty where there is none that can be read."""
    from ruamel.yaml import YAML, YAMLError

    try:
        values = YAML(typ="safe").load((path / _METADATA).read_text("utf-8"))["rosbag2_bagfile_information"]
        every = values["topics_with_message_count"]
        return {topic["topic_metadata"]["name"]: int(topic["message_count"]) for topic in every}
    except (OSError, ValueError, KeyError, TypeError, YAMLError):
        return {}


def _cut(file: Path) -> bool:
    """Whether a file ends before its end."""
    with file.open("rb") as data:
        if file.suffix == ".mcap":
            data.seek(max(file.stat().st_size - 8, 0))
            return data.read() != b"\x89MCAP0\r\n"
        head = data.read(100)
    page = int.from_bytes(head[16:18], "big")
    return file.stat().st_size < (65536 if page == 1 else page) * int.from_bytes(head[28:32], "big")


def _read_errors() -> tuple[type[Exception], ...]:
    """What rosbags raises for a damaged file."""
    import apsw
    from rosbags.rosbag2 import ReaderError

    return (ReaderError, apsw.Error, OSError, ValueError, TypeError, IndexError, EOFError, RuntimeError, AssertionError)


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _words(profiles: Any) -> str:
    """Reliability and history of the profiles offered, as few words."""
    return _joined(_profile(q.reliability.name.lower(), q.history.name.lower(), str(q.depth)) for q in profiles)


def _yaml_words(text: str) -> str:
    """The same from YAML, where values may be numbers."""
    found = [re.findall(rf"\b{key}: *['\"]?(\w+)", text) for key in ("reliability", "history", "depth")]
    return _joined(
        _profile(_RELIABILITY.get(r, r), _HISTORY.get(h, h), depth) for r, h, depth in zip(*found, strict=False)
    )


def _profile(reliability: str, history: str, depth: str) -> str:
    return f"{reliability} keep_last({depth})" if history == "keep_last" else f"{reliability}, history {history}"


def _joined(profiles: Iterator[str]) -> str:
    return " | ".join(dict.fromkeys(profiles))
