"""The navigation stack of this build beside that of another checkout, in turns.

    python experiments/bench/stack_turns.py CHECKOUT [--turns 5] [--map map.yaml]

Microseconds per cycle in the closed loop (the work of stack.py, compile time apart), wall time on all cores and
processor time. With a map of ROS also `python -m qocjax.show` on it, 5 s of a run from process to process: wall time,
processor time, and the most memory; Nav2's `nav2_bringup/maps/warehouse.yaml` has 1674 x 1006 cells around the default
start and goal. Both builds compile before they are timed. Medians of turns; keeps stack_turns.csv in
experiments/bench/results.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
RESULT = Path(__file__).parent / "results" / "stack_turns.csv"
SAMPLES = (1000, 2000)

_WORKER = """
import json, sys, time
from dataclasses import replace
try:
    from qocjax._xla import request_whole_loop
except ImportError:  # as it was called before
    from qocjax.batch.xla import request_whole_loop
request_whole_loop()
from experiments.bench.stack import DEADLINES, SEEDS
from experiments.prediction import configured
from qocjax import evaluate
config = configured("hall")
design, stack = replace(config.baseline(), deadline=DEADLINES), config.build_controller()
cycles = 2 * 600 * len(DEADLINES) * len(SEEDS)
for line in sys.stdin:
    chosen = replace(stack, mppi=replace(stack.mppi, batch_size=json.loads(line)))
    begin = time.perf_counter(), time.process_time()
    evaluate(config.build_scenario(), design, config.build_network(), SEEDS, controller=chosen)
    took = time.perf_counter() - begin[0], time.process_time() - begin[1]
    print(json.dumps([1e6 * each / cycles for each in took]), flush=True)
"""


class Loop:
    """The closed loop of a checkout, in a process of its own."""

    def __init__(self, checkout: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", _WORKER], cwd=checkout, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __call__(self, samples: int) -> dict[str, float]:
        """Microseconds per cycle of one call."""
        assert self._process.stdin is not None and self._process.stdout is not None  # for the type checker
        self._process.stdin.write(json.dumps(samples) + "\n")
        self._process.stdin.flush()
        wall, processor = json.loads(self._process.stdout.readline())
        return {"wall (µs per cycle)": wall, "processor (µs per cycle)": processor}

    def close(self) -> None:
        """Ends the process."""
        assert self._process.stdin is not None  # for the type checker
        self._process.stdin.close()
        self._process.wait()


def show(checkout: Path, room: Path, cache: Path) -> dict[str, float]:
    """One `qocjax.show` on a map: seconds, and MB at most."""
    with tempfile.TemporaryDirectory() as folder:
        options = ["controller=navigation", "loop.tau=0.05", "scenario.horizon=5", f"scenario.map={room}"]
        begin = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "-m", "qocjax.show", *options, f"hydra.run.dir={folder}"], cwd=checkout,
            env=os.environ | {"JAX_COMPILATION_CACHE_DIR": str(cache)}, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        _, status, used = os.wait4(process.pid, 0)
        wall = time.perf_counter() - begin
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"qocjax.show of {checkout} ended with {process.returncode}")
    return {"wall (s)": wall, "processor (s)": used.ru_utime + used.ru_stime, "memory (MB)": used.ru_maxrss / 1024}


def main() -> None:
    """Measures, prints and keeps the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path, help="of the other build")
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--map", type=Path, help="a map.yaml for show; none to leave it out")
    options = parser.parse_args()
    builds = {"other": options.checkout.resolve(), "this": ROOT}
    found: dict[tuple[str, str, str], list[float]] = {}

    def note(what: str, build: str, measured: dict[str, float], turn: int) -> None:
        if turn:  # the first one compiles
            for quantity, value in measured.items():
                found.setdefault((what, quantity, build), []).append(value)

    loops = {build: Loop(checkout) for build, checkout in builds.items()}
    with tempfile.TemporaryDirectory() as caches:
        for turn in range(options.turns + 1):
            for build in list(builds)[:: 1 if turn % 2 else -1]:
                for samples in SAMPLES:
                    note(f"stack, K = {samples}", build, loops[build](samples), turn)
                if options.map:
                    note("show", build, show(builds[build], options.map.resolve(), Path(caches) / build), turn)
    for loop in loops.values():
        loop.close()
    medians = pd.Series({key: median(values) for key, values in found.items()}, name="median")
    table = medians.unstack().rename_axis(["what", "quantity"]).reset_index()
    table["ratio"] = table["this"] / table["other"]
    print(table.to_string(index=False, float_format="%.3g"))
    table.to_csv(RESULT, index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
