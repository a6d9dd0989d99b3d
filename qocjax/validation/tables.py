"""Measured pairs of configured delay and AUC from a CSV file (model, section 10)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from qocjax import _checks
from qocjax.network.columns import UNITS, Columns, read_columns
from qocjax.validation.curves import Curve

__all__ = ["curve_of_csv"]


def curve_of_csv(
    path: str | Path,
    *,
    delay: str = "delay",
    auc: str = "auc",
    unit: str,
    run: str | None = None,
    seed: str | None = None,
) -> Curve:
    """Reads a curve from a table with a row per run, or per robot of a run.

    Rows of one delay are repetitions. With a column that names the run, rows of one delay and one run are its robots
    and are averaged: they are no repetitions of each other. A column of Monte Carlo seeds does the same, and lets the
    curve be compared with simulated ones in pairs.

    Args:
        path: The file; lines that begin with `#` are skipped.
        delay: Column of the configured delay.
        auc: Column of AUC (s).
        unit: Of the delays: s, ms, us or ns.
        run: Column of names of runs.
        seed: Column of seeds.

    Raises:
        ValueError: The file cannot be read, lacks a column, or has an entry that cannot be; the message names file and
            line.
    """
    _checks.choice("unit", unit, UNITS)
    if run is not None and seed is not None:
        raise ValueError(f"run, seed: got {run!r} and {seed!r}, expected one of them at most: a seed is a run")
    names = [delay, auc, *(name for name in (run, seed) if name is not None)]
    table = read_columns(path, names)
    delays = np.array(_not_negative(table, delay), np.float64) / UNITS[unit]
    values = np.array(_not_negative(table, auc), np.float64)
    axis = _distinct(delays)
    place = np.abs(delays[:, None] - axis[None, :]).argmin(axis=1)
    if run is None and seed is None:
        return Curve(axis, tuple(values[place == k] for k in range(axis.size)), None, str(path))
    labels = _seeds(table, seed) if seed is not None else table.texts[str(run)]
    groups: list[dict[str | int, list[float]]] = [{} for _ in axis]
    for row, k in enumerate(place):
        groups[int(k)].setdefault(labels[row], []).append(float(values[row]))
    if seed is None:
        return Curve(axis, tuple(np.array([np.mean(each) for each in group.values()]) for group in groups), None,
                     str(path))  # fmt: skip
    return _by_seed(Path(path), axis, groups)


def _by_seed(path: Path, axis: np.ndarray, groups: list[dict[str | int, list[float]]]) -> Curve:
    """A curve with the same seeds at all delays."""
    seeds = sorted(int(seed) for seed in groups[0])
    for delay, group in zip(axis, groups, strict=True):
        if odd := sorted(set(seeds) ^ {int(seed) for seed in group}):
            here, there = (axis[0], delay) if odd[0] in seeds else (delay, axis[0])
            raise ValueError(f"{path}: got seed {odd[0]} at {1e3 * here:g} ms but not at {1e3 * there:g} ms, expected "
                             "the same seeds at every delay")  # fmt: skip
    return Curve.of_table(axis, [[np.mean(group[seed]) for seed in seeds] for group in groups], seeds, str(path))


def _not_negative(table: Columns, column: str) -> list[float]:
    values = table.numbers(column)
    for row, value in enumerate(values):
        if value < 0:
            raise ValueError(f"{table.where(row, column)}: got {table.texts[column][row]}, expected a number >= 0")
    return values


def _seeds(table: Columns, column: str) -> list[int]:
    values = _not_negative(table, column)
    for row, value in enumerate(values):
        if value != int(value):
            raise ValueError(f"{table.where(row, column)}: got {table.texts[column][row]}, expected a whole number")
    return [int(value) for value in values]


def _distinct(delays: np.ndarray) -> np.ndarray:
    """Ascending delays; those that differ by rounding alone (less than a microsecond) are one."""
    ordered = np.sort(delays)
    return ordered[np.append(True, np.diff(ordered) > 1e-6)]
