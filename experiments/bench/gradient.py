"""Cost of gradients beside the forward pass, at 3000 ticks, 2 robots, 64 seeds x 8 designs.

    python experiments/bench/gradient.py

Prints a Markdown table: best of several calls, each as a ratio to `evaluate` on the same runs, and the peak memory of a
process of its own. About 30 s.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from qocjax import Design, Scenario, evaluate, gradient, paper_network
from qocjax._xla import request_whole_loop
from qocjax.batch import layout
from qocjax.tunables import CONTINUOUS

REPEATS = 15
CASES = {
    "forward, 2 values": (("kappa", "gamma"), "forward"),
    "reverse, 2 values": (("kappa", "gamma"), "reverse"),
    "forward, 7 values": (CONTINUOUS, "forward"),
    "reverse, 7 values": (CONTINUOUS, "reverse"),
}


def best(call: Callable[[], object]) -> float:
    """Seconds of the quickest call, after a first one that compiles."""
    call()
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return min(times)


def measure(name: str) -> None:
    """Prints one row of the table."""
    request_whole_loop()
    layout._WORTH_A_PROGRAM = 0  # both on programs of their own, however little the work
    values, mode = CASES[name]
    work = (Scenario(), Design(kappa=np.linspace(1.0, 3.0, 8), deadline=0.2), paper_network(), range(64))
    forward, slopes = best(lambda: evaluate(*work)), best(lambda: gradient(*work, values, mode=mode))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"| {name} | {1e3 * forward:.1f} | {1e3 * slopes:.1f} | {slopes / forward:.1f} | {peak:.0f} |", flush=True)


def main() -> None:
    """Prints the table, each row from a process of its own."""
    if len(sys.argv) > 1:
        measure(sys.argv[1])
        return
    print(
        "| gradient | forward pass (ms) | gradient (ms) | ratio | peak memory (MiB) |\n|---|---|---|---|---|",
        flush=True,
    )
    for name in CASES:
        subprocess.run([sys.executable, __file__, name], check=True)


if __name__ == "__main__":
    main()
