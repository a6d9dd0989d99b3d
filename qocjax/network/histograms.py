"""Histograms of delays from files, as laws that are uniform within each bin: DETERMINISTIC6G's XML, CSV and JSON."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from qocjax._reading import decoding, read_text
from qocjax.network.empirical import QuantileTable
from qocjax.network.records import parsed_json
from qocjax.network.values import UNITS

__all__ = ["read_histogram"]


def read_histogram(path: str | Path) -> QuantileTable:
    """Reads a histogram of delays as a law that is uniform within each bin.

    Three formats are told apart by their content. XML as of 6GDetCom, `<histogram><bin low="4.18ms">12</bin>...`: the
    lower edge of a bin with its unit, and its count. As of NetworkDelayEmulator, CSV without names, `4180000,12,ns`,
    the lower edge, the count and the unit; and JSON, a list of objects with `lower_bound`, `upper_bound`, `count` and
    `unit`. A bin ends where the next begins, so the last must be empty, as must one that begins at `-inf`. Counts may
    be decimal.

    Raises:
        ValueError: The file is not there or not of these formats, the edges do not increase, a count is negative, there
            is no count at all, or one in a bin without two edges.
    """
    path = Path(path)
    text = read_text(path)
    first = text.lstrip()[:1]
    if first == "[":
        edge, counts = _json(path, text)
    elif first == "<" or not first or "," not in text:
        edge, counts = _xml(path, text)
    else:
        edge, counts = _csv(path, text)
    for k in np.flatnonzero(np.diff(edge) <= 0.0)[:1]:
        raise ValueError(f"{path}, bin {k + 2}: begins at {edge[k + 1]:g} s, expected it above {edge[k]:g} s")
    for k in np.flatnonzero((counts > 0) & ~np.isfinite(np.append(np.diff(edge), np.inf)))[:1]:
        raise ValueError(f"{path}, bin {k + 1}: has {counts[k]:g} delays but not two finite edges, expected none")
    if not counts.sum() > 0:
        raise ValueError(f"{path}: has no count above 0")
    return _law_of_bins(edge, counts, str(path))


def _xml(path: Path, text: str) -> tuple[np.ndarray, np.ndarray]:
    try:
        with decoding(path, "XML", let=ElementTree.ParseError):
            bins = list(ElementTree.fromstring(text).iter("bin"))
    except ElementTree.ParseError as error:
        raise ValueError(f"{path}: is no XML: {error}") from None
    if len(bins) < 2:
        raise ValueError(f"{path}: has {len(bins)} bins, expected two or more elements <bin low=...>count</bin>")
    edge = [_edge(path, k, each.get("low", "")) for k, each in enumerate(bins)]
    return np.array(edge), np.array([_count(path, k, (each.text or "").strip()) for k, each in enumerate(bins)])


def _csv(path: Path, text: str) -> tuple[np.ndarray, np.ndarray]:
    rows = [(number, line.split(",")) for number, line in enumerate(text.split("\n"), start=1) if line.strip()]
    for number, fields in rows:
        if len(fields) != 3:
            raise ValueError(f"{path}, line {number}: is no XML and no bin such as '4180000,12,ns'")
    edge = [_edge(path, k, fields[0].strip() + fields[2].strip()) for k, (_, fields) in enumerate(rows)]
    return np.array(edge), np.array([_count(path, k, fields[1].strip()) for k, (_, fields) in enumerate(rows)])


def _json(path: Path, text: str) -> tuple[np.ndarray, np.ndarray]:
    """Bins with both edges; what lies between two of them is an empty bin."""
    edge: list[float] = []
    counts: list[float] = []
    found = parsed_json(path, text)
    for k, each in enumerate(found if isinstance(found, list) else []):
        if not isinstance(each, dict) or not {"lower_bound", "upper_bound", "count", "unit"} <= each.keys():
            raise ValueError(f"{path}, bin {k + 1}: expected lower_bound, upper_bound, count and unit")
        low, high = (_edge(path, k, f"{each[name]}{each['unit']}") for name in ("lower_bound", "upper_bound"))
        if edge and low == edge[-1]:
            edge.pop()
            counts.pop()
        edge += [low, high]
        counts += [_count(path, k, str(each["count"])), 0.0]
    if len(edge) < 2:
        raise ValueError(f"{path}: has no bin, expected a list of objects with lower_bound, upper_bound, count, unit")
    return np.array(edge), np.array(counts)


def _law_of_bins(edge: np.ndarray, counts: np.ndarray, source: str) -> QuantileTable:
    """Uniform within each bin; the empty bins at either end are left out."""
    used = np.flatnonzero(counts)
    first, last = used[0], used[-1]
    if edge[first] < 0.0:
        raise ValueError(f"{source}, bin {first + 1}: has a count below 0 s, expected delays >= 0")
    within = counts[first : last + 1] / counts.sum()
    probability = np.concatenate(([0.0], np.minimum(np.cumsum(within), 1.0)))
    probability[-1] = 1.0
    return QuantileTable(probability, edge[first : last + 2], source)


def _edge(path: Path, k: int, text: str) -> float:
    for unit in sorted(UNITS, key=len, reverse=True):
        if text.strip().endswith(unit):
            try:
                edge = float(text.strip().removesuffix(unit)) / UNITS[unit]
            except ValueError:
                break
            if math.isnan(edge):
                break
            return edge
    raise ValueError(f"{path}, bin {k + 1}: got low={text[:60]!r}, expected a number and a unit, such as '4.18ms'")


def _count(path: Path, k: int, text: Any) -> float:
    try:
        count = float(text)
    except ValueError:
        count = -1.0
    if not (0.0 <= count < 1e300) or "_" in text:
        raise ValueError(f"{path}, bin {k + 1}: got {text[:60]!r}, expected a count, a number >= 0")
    return count
