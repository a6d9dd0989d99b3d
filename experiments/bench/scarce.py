"""What finite edges and shared cells cost: loop times drawn and contended for, beside the closed loop of the study.

    python experiments/bench/scarce.py [checkout of another build]

For the paper's study on 32 seeds: seconds of the closed loop over all its designs, with an unlimited edge, and seconds
to work out the loop times that they share, for each kind of network; compile time apart. With another checkout the
closed loop of both builds is timed in turn. Keeps experiments/bench/results/scarce.csv.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
RESULT = Path(__file__).parent / "results" / "scarce.csv"
REPEATS = 5

LOOP = """
import json, time
import numpy as np
from hydra import compose, initialize_config_dir
try:
    from qocjax._xla import request_whole_loop
except ImportError:
    from qocjax.batch.xla import request_whole_loop
request_whole_loop()
from qocjax.batch import evaluate
from qocjax.config import StudyConfig, conf_dir, load
from qocjax.scenario import num_ticks
with initialize_config_dir(str(conf_dir()), version_base="1.3"):
    config = load(StudyConfig, compose("sweep"))
problem = config.build_problem()
steps = sum(num_ticks(30.0, tau) for tau in np.asarray(problem.designs.tau)) * 32 * 2
seconds = []
for _ in range(4):
    begin = time.perf_counter()
    evaluate(problem.scenario, problem.designs, problem.network, range(32), rules=problem.rules, key=problem.key)
    seconds.append(time.perf_counter() - begin)
print(json.dumps([min(seconds[1:]), 1e9 * min(seconds[1:]) / steps]))
"""


def closed_loop(checkout: Path) -> tuple[float, float]:
    """Seconds, and nanoseconds per robot-step, of the study's closed loop in a process of its own."""
    done = subprocess.run([sys.executable, "-c", LOOP], cwd=checkout, check=True, capture_output=True, text=True)
    seconds, each = json.loads(done.stdout.splitlines()[-1])
    return seconds, each


def networks() -> dict[str, object]:
    """Networks by name, for as many loops as the paper's study shares."""
    from qocjax.network import Edge, kth_5g_network, paper_network, with_edge
    from qocjax.network.cell import CellNetwork, Direction
    from qocjax.network.parametric import TruncatedNormal

    cell = CellNetwork(uplink=Direction(3000, 23_000, 0.1), downlink=Direction(150, 21_000, 0.1),
                       compute=TruncatedNormal(0.2, 0.05), edge=Edge(2, False, "latest"))  # fmt: skip
    return {
        "paper, 1 each, skip": with_edge(paper_network(), Edge(1, True, "skip")),
        "paper, 1 each, latest": with_edge(paper_network(), Edge(1, True, "latest")),
        "paper, 3 shared, fifo": with_edge(paper_network(), Edge(3, False, "fifo")),
        "paper, 1 each, latest, abort": with_edge(paper_network(), Edge(1, True, "latest", True)),
        "kth_5g, 1 each, skip": with_edge(kth_5g_network(), Edge(1, True, "skip")),
        "cell, 2 shared, latest": cell,
    }


def contention(network: object, taus: np.ndarray, deadlines: np.ndarray) -> tuple[float, float]:
    """Seconds to draw and contend for the loops of 32 seeds at all sampling periods: the first time, and again."""
    import jax
    import jax.numpy as jnp

    from qocjax.batch.drawing import draw_seeds
    from qocjax.network.contention import contended_times, draw_length, source_of
    from qocjax.network.interface import general_length
    from qocjax.scenario import num_ticks

    start, seeds = jnp.zeros((2, 3)), np.arange(32)

    def once() -> float:
        begin = time.perf_counter()
        for tau in taus:
            ticks = num_ticks(30.0, tau)
            length, period = draw_length(network, ticks, float(tau), general_length(ticks))
            drawn = draw_seeds(start, (0.1, 0.1), source_of(network), seeds, np.int32(0), length, period)
            limits = deadlines if network.uses_deadline else np.zeros(1)
            jax.block_until_ready(contended_times(network, drawn.network, ticks, float(tau), limits))
        return time.perf_counter() - begin

    first = once()
    return first, min(once() for _ in range(3))


def main() -> None:
    """Measures, prints and keeps the table."""
    other = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else None
    taus = np.array([0.005, 0.01, 0.02, 0.03, 0.05, 0.075, 0.1, 0.15, 0.2])
    deadlines = np.arange(0, 801, 20) / 1e3
    own, before = [], []
    for _ in range(REPEATS):
        own.append(closed_loop(ROOT))
        if other is not None:
            before.append(closed_loop(other))
    loop = min(seconds for seconds, _ in own)
    rows = [{"what": "closed loop of the study, unlimited edge", "seconds": loop,
             "ns_per_robot_step": min(n for _, n in own)}]  # fmt: skip
    if before:
        rows.append({"what": "the same, build before", "seconds": min(s for s, _ in before),
                     "ns_per_robot_step": min(n for _, n in before)})  # fmt: skip
    for name, network in networks().items():
        first, again = contention(network, taus, deadlines)
        rows.append({"what": name, "seconds": again, "of_closed_loop": again / loop, "first_time": first})
    table = pd.DataFrame(rows)
    table.to_csv(RESULT, index=False, float_format="%.4g")
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
