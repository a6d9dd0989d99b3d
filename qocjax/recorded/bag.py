"""An open rosbag2 recording: its topics, its messages one after the other, and whether all were there."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from qocjax.recorded.findings import Findings
from qocjax.recorded.metadata import Metadata, joined, profiles
from qocjax.recorded.storage import StorageFile
from qocjax.recorded.unpacking import ZSTD, unpacked

__all__ = ["Bag", "Topic"]


@dataclass(frozen=True, eq=False)  # looked up for every message, so by what it is, which is quick
class Topic:
    """A topic of a bag, of one type and encoding; a name with two types is two topics."""

    name: str
    kind: str  # message type, such as geometry_msgs/msg/Twist
    count: int | None  # messages that the bag says it holds; None where it does not say
    qos: str = ""  # offered, such as `reliable keep_last(10)`; empty where it does not say
    publishers: int = 0  # that offered it; 0 where it does not say
    encoding: str = "cdr"


class Bag:
    """An open recording; a context manager."""

    def __init__(
        self, path: Path, files: list[StorageFile], metadata: Metadata | None, findings: Findings, stack: ExitStack
    ) -> None:
        """Takes the files in the order in which they were written, and what is to be cleared away in the end."""
        self.path, self._files, self._findings, self._stack = path, files, findings, stack
        self._by_metadata = {} if metadata is None else metadata.counts
        self._by_files = _promises(files)
        counts = self._by_files | self._by_metadata
        offered: dict[tuple[str, str, str], list[str]] = {}
        for channel in (channel for file in files for channel in file.channels.values()):
            key = (channel.name, channel.kind, channel.encoding)
            offered[key] = max(offered.get(key, []), profiles(channel.profile), key=len)
        self.topics = [
            Topic(name, kind, self._count(counts, (name, kind)), joined(words), len(words), encoding)
            for (name, kind, encoding), words in offered.items()
        ]

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def messages(self, wanted: Collection[Topic]) -> Iterator[tuple[Topic, int, bytes]]:
        """Yields topic, record time (ns) and data of the messages of some topics, in the order of the files.

        One is in memory at a time. What was read is held against what metadata and files promise at the end.
        """
        topics = {(topic.name, topic.kind, topic.encoding): topic for topic in wanted}
        seen = dict.fromkeys(topics.values(), 0)
        for file in self._files:
            numbers = {
                number: topics[key]
                for number, channel in file.channels.items()
                if (key := (channel.name, channel.kind, channel.encoding)) in topics
            }
            for number, time, data in file.messages(numbers) if numbers else ():
                topic = numbers[number]
                seen[topic] += 1
                yield topic, time, _plain(data) if data[:4] == ZSTD else data
        self._account(seen)

    def _count(self, counts: dict[tuple[str, str], int], key: tuple[str, str]) -> int | None:
        """Messages of a topic; a metadata.yaml that was never written to its end says 0 where files hold some."""
        found = counts.get(key)
        totals = [file.total for file in self._files]
        trusted = None not in totals and sum(t or 0 for t in totals) <= sum(self._by_metadata.values())
        return found if found or key not in self._by_metadata or trusted else self._by_files.get(key)

    def _account(self, seen: dict[Topic, int]) -> None:
        """Counts what was promised and not read."""
        for topic, count in seen.items():
            key = (topic.name, topic.kind)
            promises = [each[key] for each in (self._by_metadata, self._by_files) if key in each]
            self._findings.count(topic.name, "missing_messages", max(max(promises, default=0) - count, 0))
            if promises and count > min(promises):
                self._findings.note(f"{topic.name}: holds {count} messages, but promises {min(promises)}; all are read")
        for file in self._files if not self._by_metadata else ():
            self._findings.count(file.name, "missing_messages", file.lost)


def _plain(data: bytes) -> bytes:
    """A message that was packed on its own; nothing where it cannot be unpacked."""
    found, whole = unpacked("zstd", data)
    return found if whole else b""


def _promises(files: list[StorageFile]) -> dict[tuple[str, str], int]:
    """Messages by topic that all files together promise; none where one of them does not say."""
    counts: dict[tuple[str, str], int] = {}
    for file in files:
        if file.promised is None:
            return {}
        for number, channel in file.channels.items():
            key = (channel.name, channel.kind)
            counts[key] = counts.get(key, 0) + file.promised.get(number, 0)
    return counts
