"""What was found wrong in a recording, counted per cause, and what was done about it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

__all__ = ["CAUSES", "Finding", "Findings"]

CAUSES = {
    "truncated": "files that end early; what could be read of them counts",
    "damaged": "pieces of files (chunks, pages, records) that are not as written; what comes before and after counts",
    "missing_files": "files that the metadata names, or the numbers of others promise, and that are not there",
    "missing_messages": "messages that metadata, an index or the numbers of rows promise and the bag does not hold",
    "unreadable": "messages that cannot be decoded; left out",
    "not_finite": "poses or commands with a NaN or an infinity; left out",
    "no_stamp": "messages without a header stamp; they count at their record time",
    "no_source_stamp": "rows without sequence number or uplink send stamp; left out",
    "zero_stamps": "receive stamps of 0, as OWAMP marks what was lost; lost",
    "contradictions": "lines that the log's own summary contradicts; the lines count",
    "duplicates": "repeated messages or rows; the first answer counts",
    "unordered": "messages or rows out of order; sorted",
    "restarts": "places where the numbering or the clock begins anew; clocks are taken up anew there",
    "wraps": "places where a counter of 8, 16 or 32 bits wraps; it counts on",
    "gaps": "intervals much longer than the usual one; poses are interpolated, a command stays in force",
    "silences": "stretches without any message; poses are interpolated over them, loops in them do not count",
    "jumps": "moves faster than any robot; kept",
    "outlier_commands": "commands beyond what any robot can do; left out of their statistics",
    "outlier_speeds": "speeds of odometry beyond what any robot can do; left out of what it was seen to do",
    "no_footprint": "outlines of a robot that are no area; left out",
    "ahead_of_clock": "messages that come sooner than the envelope of their clock; kept",
    "missing_numbers": "sequence numbers that are not there",
    "negative_loop_time": "loops that end before they begin on one clock; left out",
    "negative_compute": "loops that the edge answers before it receives them; without their parts",
    "negative_network": "loops shorter than their compute time; without their parts",
    "negative_leg": "loops with a direction below 0 s after correction of the clock; without their parts",
    "clock_set": "places where the recorder's clock was set or stood still; mended where stamps, order or poses tell",
    "several_publishers": "further publishers of a topic; their messages are taken together",
    "clock_steps": "steps of one clock against the other; the offset is taken up anew there",
    "clock_unknown": "stretches whose clock offset cannot be known; without uplink and downlink",
    "stamps_back": "source stamps that go back while the sequence goes on; kept in the order of the sequence",
    "excluded": "poses of what is matched but not among the robots wanted; left out",
}
"""Causes by name, with what is counted and what is done."""


@dataclass(frozen=True)
class Finding:
    """A cause, how often, and where."""

    where: str
    cause: str
    count: int


@dataclass
class Findings:
    """Counts per place and cause, and remarks that are no counts."""

    counts: dict[tuple[str, str], int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def count(self, where: str, cause: str, number: int = 1) -> None:
        """Adds to a count; nothing is entered for 0.

        Raises:
            ValueError: The cause is not one of `CAUSES`.
        """
        if cause not in CAUSES:
            raise ValueError(f"cause: got {cause!r}, expected one of {', '.join(CAUSES)}")
        if number:
            self.counts[where, cause] = self.counts.get((where, cause), 0) + int(number)

    def note(self, text: str) -> None:
        """Adds a remark, once."""
        if text not in self.notes:
            self.notes.append(text)

    def total(self, cause: str) -> int:
        """Count of a cause over all places."""
        return sum(number for (_, name), number in self.counts.items() if name == cause)

    def __iter__(self) -> Iterator[Finding]:
        return (Finding(where, cause, number) for (where, cause), number in self.counts.items())
