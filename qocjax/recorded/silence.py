"""Stretches of a recording that hold nothing: how long they are, and what of the result rests on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from qocjax.recorded.findings import Findings
from qocjax.recorded.judge import Quality
from qocjax.recorded.loops import LoopTrace
from qocjax.recorded.series import Cleaning, Series

__all__ = ["Silence", "silences", "tell_silences"]

_MANY = 5.0  # usual intervals of the densest topic, where several topics are silent together
_FEW = 10  # messages of a topic of which no usual interval is known

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Silence:
    """A stretch without a message of any topic that is read."""

    begin: float  # s after the recording's first message
    end: float
    period: float  # s, usual interval of the densest topic

    @property
    def length(self) -> float:
        """In s."""
        return self.end - self.begin


def silences(series: list[Series], cleaning: Cleaning) -> list[Silence]:
    """Stretches in which all topics are silent, much longer than is usual.

    Times are those of the stamps where there are some, so messages that come late, together, fill the stretch that they
    are of. Where one topic alone would have spoken, what counts is what counts as a gap; several that are silent
    together need not be so long.

    Args:
        series: Of all topics that are read.
        cleaning: What counts as a gap.
    """
    usual = [float(np.median(np.diff(each.time))) for each in series if each.time.size >= _FEW]
    if not usual or not min(usual) > 0.0:
        return []
    period = min(usual)
    every = np.unique(np.concatenate([each.time for each in series]))
    length = np.diff(every)
    alone = length > max(cleaning.gap * period, cleaning.least_gap)
    speakers = np.sum([length > cleaning.gap * each for each in usual], axis=0)
    found = np.flatnonzero(alone | ((speakers > 1) & (length > _MANY * period)))
    return [Silence(float(every[k]), float(every[k + 1]), period) for k in found]


def tell_silences(
    name: str, found: list[Silence], duration: float, judged: Quality | None, loops: Mapping[str, LoopTrace],
    weights: tuple[float, float], findings: Findings,
) -> None:  # fmt: skip
    """Says how long a recording is silent, and what AUC and loops have of that.

    Args:
        name: Of the recording.
        found: Where it is silent.
        duration: Of the recording (s).
        judged: Its quality, if any.
        loops: Traces that were made of its commands, by robot.
        weights: Of x and y in the disagreement.
        findings: Takes the counts and remarks.
    """
    if not found:
        return
    findings.count(name, "silences", len(found))
    longest = max(found, key=lambda each: each.length)
    total = sum(each.length for each in found)
    text = (
        f"{name}: no topic has a message in {len(found)} stretches, {total:.3g} s of {duration:.4g} s together, the "
        f"longest {longest.length:.3g} s ({longest.length / longest.period:.0f} usual intervals) from "
        f"{longest.begin:.4g} s on, as where recording paused, or pieces of a file are lost"
    )
    if judged is not None and np.isfinite(judged.auc).any():
        shares = _shares(found, judged, np.asarray(weights, np.float64))
        each_robot = zip(judged.robots, judged.auc, shares, strict=True)
        parts = [f"{auc * share:.3g} s of {robot}'s {auc:.4g} s" for robot, auc, share in each_robot if auc >= 0]
        text += f"; of AUC {', '.join(parts)} are those of straight lines over them"
    if missing := {robot: _missing(found, trace) for robot, trace in loops.items()}:
        parts = [f"{number} of {robot}" for robot, number in missing.items()]
        text += f"; loops in them count neither as done nor as lost (about {', '.join(parts)})"
    findings.note(text)


def _shares(found: list[Silence], judged: Quality, weights: Array) -> Array:
    """What part of each robot's AUC lies in the silences."""
    reference = judged.reference if judged.reference.ndim == 3 else judged.reference[:, None]
    apart = judged.pose[..., :2] - reference  # [K, N, 2], straight between two instants
    a, b = apart[:-1], apart[1:]
    pieces = np.diff(judged.time)[:, None] * ((a * a + a * b + b * b) @ weights)
    middle = judged.began + 0.5 * (judged.time[:-1] + judged.time[1:])
    inside = np.any([(middle > each.begin) & (middle < each.end) for each in found], axis=0)
    return pieces[inside].sum(axis=0) / np.maximum(pieces.sum(axis=0), 1e-300)


def _missing(found: list[Silence], trace: LoopTrace) -> int:
    """Loops that would have begun in the silences, at the usual interval."""
    every = np.diff(np.sort(trace.table["source_stamp"].to_numpy(float)))
    usual = float(np.median(every)) if every.size else np.inf
    return int(sum(max(round(each.length / usual) - 1, 0) for each in found)) if usual > 0.0 else 0
