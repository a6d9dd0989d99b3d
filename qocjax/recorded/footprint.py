"""The outline of a robot as a bag tells it, and the circles around and within it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from qocjax.recorded.findings import Findings
from qocjax.recorded.series import Series

__all__ = ["Footprint", "Outline", "footprint_of"]

Array = NDArray[np.float64]

_BASES = ("base_link", "base_footprint")


class Outline(NamedTuple):
    """A message with the corners of a footprint."""

    stamp: int  # ns, 0 for none
    frame: str  # empty where the type has none: the robot's own
    corners: Sequence[tuple[float, float]]  # m


@dataclass(frozen=True)
class Footprint:
    """Circles about a robot's centre, medians over the messages, in m."""

    radius: float  # of the smallest that holds the footprint
    inscribed: float  # of the largest within it
    corners: int
    messages: int
    centre: str  # what counts as the centre: `base`, `pose`, or `middle` of the area where neither is known


def footprint_of(
    outlines: Sequence[Outline], poses: Sequence[Series], begin: int, where: str, findings: Findings
) -> Footprint | None:
    """The circles of the outlines of a robot; None where none is an area.

    Nav2 publishes a footprint where the robot is, in the frame of its costmap, with the padding of that. The centre is
    the origin of the robot's own frame, else the pose at the stamp where poses are in that frame, else the middle of
    the area.

    Args:
        outlines: Messages.
        poses: Of the robot, of every topic that has some.
        begin: Time that counts as 0 for these (ns).
        where: Name of the topic, for the findings.
        findings: Takes a count and a remark of outlines that are none.
    """
    whole = [_area(np.array(each.corners, float).reshape(-1, 2)) > 0.0 for each in outlines]
    kept = [each for each, area in zip(outlines, whole, strict=True) if area]
    findings.count(where, "no_footprint", len(outlines) - len(kept))
    if not all(whole):
        shown = ", ".join(f"({x:g}, {y:g})" for x, y in outlines[whole.index(False)].corners[:4]) or "none"
        findings.note(f"{where}: has outlines that are no area, such as one with the corners {shown}; expected 3 "
                      "finite corners or more that are not in a line")  # fmt: skip
    if not kept:
        return None
    circles: list[tuple[float, float]] = []
    centres: list[str] = []
    for each in kept:
        corners = np.array(each.corners, float)
        centre, name = _centre(each, corners, poses, begin)
        circles.append(_circles(corners - centre))
        centres.append(name)
    usual = max(set(centres), key=centres.count)
    radius, inscribed = np.median([c for c, name in zip(circles, centres, strict=True) if name == usual], axis=0)
    return Footprint(float(radius), float(inscribed), len(kept[-1].corners), len(kept), usual)


def _area(corners: Array) -> float:
    """Of a polygon (m²), 0 for what is none."""
    if len(corners) < 3 or not np.isfinite(corners).all():
        return 0.0
    x, y = (corners - corners.mean(axis=0)).T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def _centre(outline: Outline, corners: Array, poses: Sequence[Series], begin: int) -> tuple[Array, str]:
    """Where the robot's centre is, and by what that is known."""
    frame = outline.frame.strip("/")
    if not frame or frame.rpartition("/")[2] in _BASES:
        return np.zeros(2), "base"
    for series in poses:
        known = np.isfinite(series.stamp)
        stamp = 1e-9 * (outline.stamp - begin)
        if series.frame.strip("/") == frame and known.any() and outline.stamp:
            time, order = series.stamp[known], np.argsort(series.stamp[known], kind="stable")
            if time.min() <= stamp <= time.max():
                at = np.array([np.interp(stamp, time[order], series.values[known, k][order]) for k in range(2)])
                if _inside(at, corners):
                    return at, "pose"
    x, y = (corners - corners[0]).T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    middle = np.array([((each + np.roll(each, -1)) * cross).sum() for each in (x, y)]) / (3.0 * cross.sum())
    return corners[0] + middle, "middle"


def _inside(point: Array, corners: Array) -> bool:
    """Whether a ray from the point crosses the outline an odd number of times."""
    (x, y), (next_x, next_y) = (corners - point).T, (np.roll(corners, -1, axis=0) - point).T
    crosses = (y > 0.0) != (next_y > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = x - y * (next_x - x) / (next_y - y)
    return bool((crosses & (at > 0.0)).sum() % 2)


def _circles(corners: Array) -> tuple[float, float]:
    """Radii about the origin: of the farthest corner, and of the nearest point of a side."""
    sides = np.roll(corners, -1, axis=0) - corners
    length = np.maximum((sides**2).sum(axis=1), 1e-18)
    along = np.clip(-(corners * sides).sum(axis=1) / length, 0.0, 1.0)
    nearest = corners + along[:, None] * sides
    return float(np.hypot(*corners.T).max()), float(np.hypot(*nearest.T).min())
