"""Header stamps that leap where record times and order do not: the clock that stamps was set."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from qocjax.recorded.findings import Findings
from qocjax.recorded.witnesses import AHEAD, NEAR, Topic, usual_delay

__all__ = ["mend_stamps"]

_LONGEST = 0.5  # of a step, that delays may vary by for it to be one


def mend_stamps(topics: list[Topic], findings: Findings) -> None:
    """Takes steps of the clock of the poses' stamps out of the stamps of every topic that steps with it.

    Where its stamps were nearest to the record times the clock keeps its time.

    Args:
        topics: Messages, with record times that are in order; stamps are changed in place.
        findings: Takes a count and a remark for each step.
    """
    lead = max(
        (t for t in topics if t.pose is not None and t.stamped.sum() > 3), key=lambda t: t.place.size, default=None
    )
    if lead is None:
        return
    leaps = _leaps(lead)
    if not leaps:
        return
    edges = np.array([int(lead.place[row]) for row in leaps])
    piece = np.searchsorted(edges, lead.place, side="right")
    delays = [usual_delay(lead, piece == k) or 0 for k in range(len(leaps) + 1)]
    base = min(range(len(delays)), key=lambda k: abs(delays[k]))
    for topic in topics:
        _shift(topic, np.searchsorted(edges, topic.place, side="right"), np.array(delays), base)
    findings.count("header stamps", "restarts", len(leaps))
    for row, (before, after) in zip(leaps, zip(delays, delays[1:], strict=False), strict=True):
        findings.note(
            f"header stamps: step by {1e-9 * (before - after):.6g} s at message {int(lead.place[row]) + 1}, and record "
            "times do not; their clock was set, and its step is taken out"
        )


def _leaps(lead: Topic) -> list[int]:
    """First rows after steps of the stamps against the record times."""
    rows = np.flatnonzero(lead.stamped)
    delay = (lead.record - lead.stamp)[rows]
    found = []
    for k in np.flatnonzero(np.abs(np.diff(delay)) > 1e9 * AHEAD):
        before, after = delay[max(k + 1 - NEAR, 0) : k + 1], delay[k + 1 : k + 1 + NEAR]
        size = abs(float(np.median(after) - np.median(before)))
        near = [float(np.median(np.abs(part - np.median(part)))) for part in (before, after)]
        if min(before.size, after.size) > 2 and size > 1e9 * AHEAD and max(near) < _LONGEST * size:
            found.append(int(rows[k + 1]))
    return found


def _shift(topic: Topic, piece: NDArray[np.intp], delays: NDArray[np.int64], base: int) -> None:
    """Moves the stamps of each piece, or of the piece before for what was under way, to where the base is."""
    own = usual_delay(topic, piece == base)
    if own is None:
        return
    delay = topic.record - topic.stamp
    options = np.stack([np.zeros(piece.size, np.int64), (delays - delays[base])[piece],
                        (delays - delays[base])[np.maximum(piece - 1, 0)]])  # fmt: skip
    best = np.argmin(np.abs(delay - options - own), axis=0)
    topic.stamp[topic.stamped] += options[best, np.arange(piece.size)][topic.stamped]
