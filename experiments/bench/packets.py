"""What packets of commands cost: the closed loop with hold `buffer` beside `hold` and `zero`, in turn.

    python experiments/bench/packets.py [checkout of another build]

41 designs, 32 seeds, 3000 ticks, 2 robots, the paper's network, at a deadline on the grid of the sampling period and at
one off it: nanoseconds of a core per robot-step (processor time, so that a busy machine matters less), the median of
calls that take turns, compile time apart. With another checkout its `hold` and `zero` are timed in the same turns.
Keeps experiments/bench/results/packets.csv.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from statistics import median

import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
RESULT = Path(__file__).parent / "results" / "packets.csv"
TURNS = 15
DEADLINES = {"on the grid": 0.2, "off the grid": 0.205}
HOLDS = {"hold": {}, "zero": {"hold": "zero"}} | {
    f"buffer, M = {m}": {"hold": "buffer", "plan_length": m} for m in (1, 2, 5, 10, 20)
}

_WORKER = """
import json, sys, time
import numpy as np
from qocjax._xla import request_whole_loop
request_whole_loop()
from qocjax import Design, Scenario, evaluate, paper_network
from qocjax.network.schedule import Rules
for line in sys.stdin:
    deadline, rules = json.loads(line)
    design = Design(kappa=np.linspace(0.5, 4.0, 41), deadline=deadline)
    begin = time.process_time()
    evaluate(Scenario(), design, paper_network(), range(32), rules=Rules(**rules))
    print(1e9 * (time.process_time() - begin) / (41 * 32 * 3000 * 2), flush=True)
"""


class Build:
    """A checkout in a process of its own."""

    def __init__(self, checkout: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", _WORKER], cwd=checkout, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def nanoseconds(self, deadline: float, rules: dict) -> float:
        """Per robot-step, of one call."""
        assert self._process.stdin is not None and self._process.stdout is not None  # for the type checker
        self._process.stdin.write(json.dumps([deadline, rules]) + "\n")
        self._process.stdin.flush()
        return float(self._process.stdout.readline())

    def close(self) -> None:
        """Ends the process."""
        assert self._process.stdin is not None  # for the type checker
        self._process.stdin.close()
        self._process.wait()


def main() -> None:
    """Measures, prints and keeps the table."""
    builds = {"this": Build(ROOT)}
    if len(sys.argv) > 1:
        builds["before"] = Build(Path(sys.argv[1]).resolve())
    calls = [(build, grid, hold) for grid in DEADLINES for hold in HOLDS for build in builds
             if build == "this" or "buffer" not in hold]  # fmt: skip
    found: dict[tuple[str, str, str], list[float]] = {call: [] for call in calls}
    for turn in range(TURNS + 1):
        for call in calls[:: 1 if turn % 2 else -1]:
            taken = builds[call[0]].nanoseconds(DEADLINES[call[1]], HOLDS[call[2]])
            if turn:  # the first one compiles
                found[call].append(taken)
    for build in builds.values():
        build.close()
    table = pd.DataFrame([
        {"deadline": grid, "hold": hold, "build": build, "ns_per_robot_step": median(taken), "fastest": min(taken)}
        for (build, grid, hold), taken in found.items()
    ])  # fmt: skip
    print(table.round(2).to_string(index=False))
    table.to_csv(RESULT, index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
