"""Time of the navigation stack in the closed loop, beside the surrogate law in the same run.

    python experiments/bench/stack.py [--samples 1000 2000] [--out folder]

Two robots of the hall, 20 Hz, 30 s, eight deadlines and eight seeds: 64 runs, 76 800 cycles of costmap, path and MPPI.
Compile time is apart: the first call on one seed per deadline and program. Writes stack.csv; about three minutes on two
cores.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np
import pandas as pd

from experiments.bench.timing import machine
from experiments.prediction import configured
from qocjax import evaluate
from qocjax._xla import num_workers, request_whole_loop
from qocjax.controllers import Apf, Controller
from qocjax.navigation import NavigationStack

RESULTS = Path(__file__).parent / "results"
DEADLINES = np.array([0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.6, 0.8])  # s
SEEDS = range(8)


def timed(controller: Controller) -> tuple[float, float]:
    """Seconds of the first call, with all it compiles, and of the second."""
    config = configured("hall")
    design = replace(config.baseline(), deadline=DEADLINES)
    seconds = []
    for _ in range(2):
        begin = time.perf_counter()
        evaluate(config.build_scenario(), design, config.build_network(), SEEDS, controller=controller)
        seconds.append(time.perf_counter() - begin)
    return seconds[0], seconds[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, nargs="+", default=[1000, 2000], help="K, rollouts of a cycle")
    parser.add_argument("--out", type=Path, default=RESULTS)
    options = parser.parse_args()
    request_whole_loop()
    stack = configured("hall").build_controller()
    assert isinstance(stack, NavigationStack)
    entries: dict[str, Controller] = {"surrogate law": Apf()}
    entries |= {f"stack, K = {k}": replace(stack, mppi=replace(stack.mppi, batch_size=k)) for k in options.samples}
    cycles = 2 * 600 * len(DEADLINES) * len(SEEDS)
    rows = []
    for name, controller in entries.items():
        first, second = timed(controller)
        rows.append(
            {"entry": name, "compile_s": first - second, "run_s": second, "us_per_cycle": 1e6 * second / cycles}
        )
    table = pd.DataFrame(rows)
    table["ratio"] = table["run_s"] / table["run_s"].iloc[0]
    table["workers"] = num_workers()
    options.out.mkdir(parents=True, exist_ok=True)
    table.to_csv(options.out / "stack.csv", index=False, float_format="%.4g")
    print(table.to_string(index=False))
    print(machine())


if __name__ == "__main__":
    main()
