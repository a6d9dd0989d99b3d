"""qocjax and other ways to run the closed loop, on the same work in one run.

    python experiments/bench/run.py [--size smallest|paper] [--out folder]

Prints a table of the time per robot-step, and writes it with a plot to experiments/bench/results. Every entry runs in a
process of its own; their calls take turns, so that what else the machine does meets all alike, and the best counts.
About 3 minutes at the paper's size, with growth.py; the smallest size only shows that everything runs.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np
import pandas as pd

from experiments.bench.entries import ENTRIES, ROOT, Entry, Process, clean_environment
from experiments.bench.report import draw_times, printed, write
from experiments.bench.study import SIZES, Part, Size
from experiments.bench.timing import machine

__all__ = ["Record", "check", "main", "measure_all"]

GRIDS = ("on", "off")
RATIOS = (("over_cpp", "cpp_kernel"), ("over_cpp_metrics", "cpp_metrics"), ("vmap_over", "vmap_scan"))
TOLERANCE = 0.01  # on the mean AUC of any two entries: float32 runs of meeting robots differ, their mean does not


@dataclass
class Record:
    """What one entry did by one method on one grid."""

    entry: Entry
    method: str
    grid: str
    seconds: list[float] = field(default_factory=list)  # the first call first
    answer: dict[str, Any] = field(default_factory=dict)

    @property
    def question(self) -> str:
        return f"{self.method} {self.grid}"

    def take(self, answer: dict[str, Any]) -> None:
        self.answer = answer
        self.seconds.append(answer.get("seconds", np.nan))


def measure_all(size_name: str, entries: tuple[Entry, ...] = ENTRIES) -> tuple[pd.DataFrame, list[str]]:
    """Runs all entries.

    Args:
        size_name: Key of `SIZES`.
        entries: What is run; among them qocjax on the whole study.

    Returns:
        A row for each entry, method and grid, and a line for each entry that cannot run here.

    Raises:
        RuntimeError: The mean AUC of two entries differs by more than the tolerance.
    """
    size = SIZES[size_name]
    pinned = hasattr(os, "sched_setaffinity")
    skipped = [] if pinned else ["entries on one core skipped: this system cannot pin a process to one"]
    records = {
        Process(entry.label, "entries", vars(entry) | {"size": size_name}): [
            Record(entry, method, grid) for grid in GRIDS for method in entry.methods
        ]
        for entry in entries
        if pinned or not entry.one_core
    }
    processes = list(records)
    try:
        _first_calls(records, size.in_turn)
        for process in [p for p in processes if "unavailable" in records[p][0].answer]:
            first = records.pop(process)[0]
            skipped.append(f"{first.entry.label} skipped: {first.answer['unavailable']}")
        for _ in range(size.rounds):
            for process, own in records.items():
                for record in own:
                    process.ask(record.question)
                    record.take(process.answer())
    finally:
        for process in processes:
            process.close()
    done = [record for own in records.values() for record in own]
    check(done, size)
    return _with_ratios(pd.DataFrame([_row(record) for record in done])), list(dict.fromkeys(skipped))


def _first_calls(records: dict[Process, list[Record]], in_turn: bool) -> None:
    """First calls, the compilation in them; those of different processes at once where their times do not matter."""
    for group in [[process] for process in records] if in_turn else [list(records)]:
        for process in group:
            for record in records[process]:
                process.ask(record.question)
        for process in group:
            for record in records[process]:
                record.take(process.answer())


def check(records: list[Record], size: Size) -> None:
    """Compares the mean AUC of every entry with that of qocjax on the same designs.

    Raises:
        RuntimeError: They differ by more than the tolerance.
    """
    whole = next(r for r in records if r.entry.entry == "qocjax" and r.entry.part == "all" and r.method == "evaluate")
    for record in records:
        same = next(r for r in records if (r.entry, r.method, r.grid) == (whole.entry, whole.method, record.grid))
        part = Part() if record.entry.part == "all" else size.parts[record.entry.part]
        grid = np.reshape(same.answer["auc"], (len(size.deadlines_ms), size.designs))
        expected, got = grid[:: part.every, : part.designs].mean(), np.mean(record.answer["auc"])
        if not abs(got - expected) <= TOLERANCE * expected:
            raise RuntimeError(
                f"{record.entry.label}, deadlines {record.grid} the grid: got a mean AUC of {got:.5g} s, "
                f"expected that of qocjax.evaluate, {expected:.5g} s, to {TOLERANCE:.0%}"
            )


def _row(record: Record) -> dict[str, Any]:
    entry, answer, later = record.entry, record.answer, record.seconds[1:]
    is_program = entry.entry == "qocjax" and record.method == "program"
    return {
        "entry": entry.label.replace("qocjax.evaluate", "qocjax loop alone") if is_program else entry.label,
        "module": entry.entry,
        "deadlines": record.grid,
        "cores": 1 if entry.one_core else machine()["cores"],
        "one_core": entry.one_core,
        "whole_loop": entry.whole_loop,
        "runs": answer["lanes"],
        "first_call_s": record.seconds[0] if not is_program else np.nan,
        "best_s": min(later),
        "median_s": median(later),
        "ns_per_robot_step": min(later) / answer["robot_steps"] * 1e9,
        "mean_auc_s": np.mean(answer["auc"]),
    }


def _with_ratios(table: pd.DataFrame) -> pd.DataFrame:
    """Adds the time over those of the C++ kernels on as many cores, and that of plain vmap over the time."""
    ns = table["ns_per_robot_step"]
    for column, module in RATIOS:
        chosen = table[(table["module"] == module) & ~table["whole_loop"]]
        time = {(row.deadlines, row.one_core): row.ns_per_robot_step for row in chosen.itertuples()}
        pinned = [False] * len(table) if module == "vmap_scan" else table["one_core"]
        base = [time.get(key, np.nan) for key in zip(table["deadlines"], pinned, strict=True)]
        table[column] = base / ns if module == "vmap_scan" else ns / base
    return table


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", choices=SIZES, default="paper")
    parser.add_argument("--out", type=Path, default=ROOT / "experiments" / "bench" / "results", metavar="folder")
    options = parser.parse_args()
    here = machine() | {"load": os.getloadavg()[0]}
    print("\n".join(f"{name}: {value}" for name, value in here.items()) + "\n", flush=True)
    table, skipped = measure_all(options.size)
    print("\n".join([printed(table), *skipped]), flush=True)
    write(options.out, "results", table, {"machine": here, "size": options.size, "skipped": skipped})
    draw_times(table, options.out / "times")
    if options.size == "paper":
        growth = [sys.executable, str(Path(__file__).with_name("growth.py")), "--out", str(options.out)]
        subprocess.run(growth, env=clean_environment(), check=True)


if __name__ == "__main__":
    main()
