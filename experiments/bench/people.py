"""How long people wait for commands: another build and this one in turn, with the ratios of both.

    python experiments/bench/people.py ../base                # all rows, five turns; half an hour
    python experiments/bench/people.py ../base --rows help import --turns 9
    python experiments/bench/people.py ../base --history      # and a row for this version in history.csv

Prints a table of medians. In a turn run `import jax`, the yardstick of start-up, and each build. Compiled programs are
in a cache for each build, filled before the first turn, or in an empty one each time. Nothing else should run.
"""

from __future__ import annotations

import argparse
import csv
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import pandas as pd

from experiments.bench.phases import with_build
from experiments.bench.report import markdown

__all__ = ["ROWS", "Row", "Turns", "main", "measured", "printed", "write_history"]

ROOT = Path(__file__).resolve().parents[2]
HISTORY = Path(__file__).parent / "history.csv"
DATA = Path(os.environ.get("QOCJAX_DATA", ROOT.parent / "shared" / "data"))
_TRACE = DATA / "cicv-5g-rtt" / "urban_n78_v20_run02.txt"


@dataclass(frozen=True)
class Row:
    """What somebody waits for, and how long at most.

    Attributes:
        arguments: Of the interpreter.
        target: Largest ratio to the other build, or to `import jax`.
        of_jax: Whether the ratio is to `import jax`.
        cold: With an empty cache of compiled programs.
        processor: Processor time of all threads and processes instead of wall-clock time.
        needs: A file that it reads.
    """

    what: str
    arguments: tuple[str, ...]
    target: float
    of_jax: bool = False
    cold: bool = False
    processor: bool = False
    needs: Path | None = None


def _command(name: str, *options: str) -> tuple[str, ...]:
    return ("-m", f"qocjax.{name}", *options)


ROWS = {
    "help": Row("`python -m qocjax.sweep --help`", _command("sweep", "--help"), 2.0, of_jax=True),
    "unknown": Row("refusal of an unknown option", _command("sweep", "wheels=2"), 2.0, of_jax=True),
    "kind": Row("refusal of a wrong kind", _command("sweep", "controller.kappa=much"), 2.0, of_jax=True),
    "value": Row("refusal of a wrong value", _command("sweep", "loop.tau=-0.01"), 2.0, of_jax=True),
    "import": Row("`import qocjax`", ("-c", "import qocjax"), 1.3, of_jax=True),
    "used": Row("`import qocjax`, all of its names", ("-c", "from qocjax import *"), 2.0, of_jax=True),
    "main": Row("main job, warm cache", _command("sweep"), 0.45),
    "cold": Row("main job, cold", _command("sweep"), 0.55, cold=True),
    "ci": Row("`experiment=ci`, warm cache", _command("sweep", "experiment=ci"), 0.35),
    "advise": Row(
        "`advise` on a trace, processor time",
        _command("advise", "network=trace", f"network.path={_TRACE}", r"network.column=delay\(ms\)", "network.unit=ms",
                 "loop.tau=0.06"),
        0.5, processor=True, needs=_TRACE,
    ),
}  # fmt: skip


@dataclass
class Turns:
    """Seconds of a row, turn by turn."""

    jax: list[float] = field(default_factory=list)
    base: list[float] = field(default_factory=list)
    new: list[float] = field(default_factory=list)

    def ratio(self, row: Row) -> float:
        """Median time of this build over that of the other, or of `import jax`."""
        return statistics.median(self.new) / statistics.median(self.jax if row.of_jax else self.base)


def measured(rows: Sequence[str], base: Path, turns: int, work: Path) -> dict[str, Turns]:
    """Runs each row `turns` times, the builds one after the other."""
    found = {}
    for name in rows:
        row = ROWS[name]
        if row.needs is not None and not row.needs.is_file():
            print(f"{name}: {row.needs} is not there; left out", file=sys.stderr)
            continue
        own = Turns()
        caches = {build: work / f"{where}-cache" for build, where in ((base, "base"), (ROOT, "new"))}
        for build, cache in caches.items():
            _seconds(row.arguments, build, cache, row.processor)  # files in memory, programs compiled
        for _ in range(turns):
            own.jax.append(_seconds(("-c", "import jax"), ROOT, work, row.processor))
            for build, times in ((base, own.base), (ROOT, own.new)):
                with tempfile.TemporaryDirectory(dir=work) as empty:
                    times.append(_seconds(row.arguments, build, Path(empty) if row.cold else caches[build],
                                          row.processor))  # fmt: skip
        found[name] = own
        print(f"{name}: {own.ratio(row):.2f}", file=sys.stderr, flush=True)
    return found


def _seconds(arguments: Sequence[str], build: Path, cache: Path, processor: bool) -> float:
    """Time of one run, in a folder of its own."""
    environment = with_build(build) | {"JAX_COMPILATION_CACHE_DIR": str(cache)}
    with tempfile.TemporaryDirectory() as folder:
        begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, encoding="utf-8"
        )
        passed, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 2):  # 2 is a refusal
        raise SystemExit(f"{' '.join(arguments)} of {build}: {done.stderr.strip()}")
    return (after.ru_utime - before.ru_utime) + (after.ru_stime - before.ru_stime) if processor else passed


def printed(found: dict[str, Turns]) -> str:
    """The medians as Markdown."""
    rows = [
        (
            ROWS[name].what, *(f"{statistics.median(times):.2f}" for times in (own.jax, own.base, own.new)),
            f"{statistics.median(own.new) / statistics.median(own.jax):.2f}",
            f"{statistics.median(own.new) / statistics.median(own.base):.2f}",
            f"≤ {ROWS[name].target:g} × {'`import jax`' if ROWS[name].of_jax else 'base'}",
        )
        for name, own in found.items()
    ]  # fmt: skip
    return markdown(pd.DataFrame(rows, columns=[
        "what", "`import jax` (s)", "base (s)", "now (s)", "now / jax", "now / base", "target",
    ]))  # fmt: skip


def write_history(path: Path, found: dict[str, Turns]) -> None:
    """Appends the ratios of this version, a column each; a version that is there already is replaced."""
    import qocjax

    commit = subprocess.check_output(["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"], text=True).strip()
    ratios = {name: f"{own.ratio(ROWS[name]):.3f}" for name, own in found.items()}
    row = {"version": qocjax.__version__, "commit": commit, "date": date.today().isoformat(), **ratios}
    rows = list(csv.DictReader(path.open(encoding="utf-8"))) if path.is_file() else []
    rows = [each for each in rows if each["commit"] != commit] + [row]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(dict.fromkeys(name for each in rows for name in each)), restval="")
        writer.writeheader()
        writer.writerows(rows)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("base", type=Path, help="checkout of the other build")
    parser.add_argument("--rows", nargs="+", choices=ROWS, default=list(ROWS))
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--history", action="store_true", help=f"write the ratios to {HISTORY.name}")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        found = measured(given.rows, given.base.resolve(), given.turns, Path(work))
    print(printed(found))
    if given.history:
        write_history(HISTORY, found)


if __name__ == "__main__":
    main()
