"""The closed loop of this build beside that of another checkout, call by call in turn.

    python experiments/bench/builds.py <checkout of another build> [--turns 9]

`evaluate` with one design and 32 seeds (what a newcomer tries first), the same seeds each time or others, with two
designs at each of 23 deadlines on 1024 seeds and a sampling period of 60 ms, as advice has them, and with the paper's
study (41 designs, 32 seeds, 36 deadlines), on the grid of the sampling period and off it; the C++ kernels,
which are this checkout's, between them. Each in a process of its own. Prints nanoseconds per robot-step, the median of
the turns, with ratios to the other build and to the C++ kernels; keeps experiments/bench/results/builds.csv.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import pandas as pd

from experiments.bench.entries import ROOT, Entry, Process, clean_environment
from experiments.bench.report import markdown

RESULT = Path(__file__).parent / "results" / "builds.csv"
CALLS = ("1 design, same seeds", "1 design, new seeds", "few designs", "study on the grid", "study off the grid")

_WORKER = """
import json, sys, time
import numpy as np
try:
    from qocjax._xla import request_whole_loop
except ImportError:
    from qocjax.batch.xla import request_whole_loop
request_whole_loop()
from qocjax import Design, Scenario, evaluate, paper_network
network, fresh = paper_network(), 32
for line in sys.stdin:
    call, calls = json.loads(line)
    shift = 0.005 if "off" in call else 0.0
    deadlines = np.arange(0.1, 0.801, 0.02) + shift if "study" in call else np.array([0.2])
    kappa = np.linspace(1.6, 2.4, 41) if "study" in call else np.array([2.0])
    tau, many = 0.01, 32
    if "few" in call:
        deadlines, kappa, tau, many = 0.15 + 0.007 * np.arange(23), np.array([1.0, 1.5]), 0.06, 1024
    design = Design(tau=tau, kappa=np.tile(kappa, deadlines.size), deadline=np.repeat(deadlines, kappa.size))
    seconds = []
    for _ in range(calls):
        seeds = range(fresh, fresh + 32) if "new" in call else range(many)
        fresh += 32
        begin = time.perf_counter()
        evaluate(Scenario(), design, network, seeds)
        seconds.append(time.perf_counter() - begin)
    print(json.dumps(1e9 * min(seconds) / (design.kappa.size * many * 2 * round(30 / tau))), flush=True)
"""


class Build:
    """A checkout in a process of its own."""

    def __init__(self, checkout: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", _WORKER], cwd=checkout, env=clean_environment(), text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip

    def nanoseconds(self, call: str) -> float:
        """Per robot-step, the best of a few calls where these are short."""
        assert self._process.stdin is not None and self._process.stdout is not None  # for the type checker
        self._process.stdin.write(json.dumps([call, 10 if "1 design" in call else 1]) + "\n")
        self._process.stdin.flush()
        return float(self._process.stdout.readline())

    def close(self) -> None:
        """Ends the process."""
        self._process.communicate()


def measured(other: Path, turns: int) -> dict[str, dict[str, list[float]]]:
    """Nanoseconds per robot-step: by call, then by who; the first turn, with compilation in it, is left out."""
    builds = {"before": Build(other), "now": Build(ROOT)}
    kernels = {
        name: Process(name, "entries", vars(Entry(name, module, "all")) | {"size": "paper"})
        for name, module in (("C++", "cpp_kernel"), ("C++, all metrics", "cpp_metrics"))
    }
    found: dict[str, dict[str, list[float]]] = {call: {} for call in CALLS}
    for turn in range(turns + 1):
        for call in CALLS:
            took = {who: build.nanoseconds(call) for who, build in builds.items()}
            for who, kernel in kernels.items() if "study" in call else ():
                kernel.ask(f"evaluate {'off' if 'off' in call else 'on'}")
                answer = kernel.answer()
                took[who] = 1e9 * answer["seconds"] / answer["robot_steps"]
            for who, each in took.items() if turn else ():
                found[call].setdefault(who, []).append(each)
    for process in (*builds.values(), *kernels.values()):
        process.close()
    return found


def _shown(value: str | float) -> str:
    return value if isinstance(value, str) else "" if math.isnan(value) else f"{value:.3g}"


def main() -> None:
    """Measures, prints and keeps the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path)
    parser.add_argument("--turns", type=int, default=9)
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for call, by_who in measured(options.checkout.resolve(), options.turns).items():
        row: dict[str, Any] = {"call": call} | {who: median(each) for who, each in by_who.items()}
        row["now / before"] = median(a / b for a, b in zip(by_who["now"], by_who["before"], strict=True))
        row |= {f"now / {who}": row["now"] / row[who] for who in by_who if who.startswith("C++")}
        rows.append(row | ({"before / C++": row["before"] / row["C++"]} if "C++" in row else {}))
    table = pd.DataFrame(rows)
    table.to_csv(RESULT, index=False, float_format="%.4g")
    print(markdown(table.map(_shown)))


if __name__ == "__main__":
    main()
