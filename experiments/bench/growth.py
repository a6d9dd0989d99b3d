"""How time and memory of `qocjax.evaluate` grow with designs, seeds, ticks and robots.

    python experiments/bench/growth.py [--size smallest|paper] [--out folder]

Writes growth.csv and a plot with a panel for each; about a minute. Sizes are such that programs made for the case run,
not the general ones that small studies share.
"""

from __future__ import annotations

import argparse
import math
import resource
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np
import pandas as pd

from experiments.bench.entries import ROOT, clean_environment
from experiments.bench.report import draw_growth, markdown
from experiments.bench.study import NETWORK, TAU, drawn_designs
from experiments.bench.timing import measure
from qocjax import Design, Scenario, evaluate
from qocjax._xla import request_whole_loop

__all__ = ["Case", "cases", "main", "measure_case", "peak_mib"]

PANELS = ("designs", "seeds", "ticks", "robots", "memory")
SEEDS = 32
DEADLINE = 0.2  # s


@dataclass(frozen=True)
class Case:
    """A study, and the panel that shows it."""

    panel: str  # one of PANELS: what grows
    designs: int
    seeds: int
    ticks: int
    robots: int = 2

    @property
    def run_ticks(self) -> int:
        """Ticks of all runs together."""
        return self.designs * self.seeds * self.ticks

    def run(self) -> Any:
        """Evaluates it."""
        scenario = Scenario(start=circle(self.robots), horizon=self.ticks * TAU)
        designs = Design(**drawn_designs(self.designs), tau=TAU, deadline=DEADLINE)
        return evaluate(scenario, designs, NETWORK, range(self.seeds))


def circle(robots: int) -> np.ndarray:
    """Start poses [N, 3] around the default ones, the robots a metre or more apart."""
    angle = 2 * np.pi * np.arange(robots) / robots - np.pi / 2
    radius = max(1.5, robots / (2 * np.pi))
    heading = np.where(np.arange(robots) == 0, 0.3, 0.0)
    return np.stack([-2 + radius * np.cos(angle), radius * np.sin(angle), heading], axis=-1)


def cases(size: str) -> Iterator[Case]:
    """What is measured at a size."""
    if size == "smallest":
        yield from (Case("designs", g, 2, 50) for g in (1, 4))
        yield from (Case("robots", 2, 2, 20, n) for n in (8, 9))
        return
    # The peak of a process is at least what its parent had when it was started: so these before anything large.
    yield from (Case("memory", g, SEEDS, 300) for g in (64, 512, 4096, 32768))
    yield from (Case("designs", g, SEEDS, 3000) for g in (1, 8, 64, 512, 2048))
    yield from (Case("seeds", 64, s, 3000) for s in (1, 8, 64, 256, 1024))
    yield from (Case("ticks", 1600, SEEDS, p) for p in (375, 750, 1500, 3000))
    yield from (Case("robots", max(math.ceil(1600 * 2 / n), 50), SEEDS, 300, n) for n in (2, 4, 8, 16, 32, 64))


def measure_case(case: Case, repeats: int) -> dict[str, Any]:
    """Times a case, or for the panel `memory` finds its peak in a process of its own."""
    row: dict[str, Any] = asdict(case)
    if case.panel == "memory":
        code = f"from experiments.bench.growth import *; print(*peak_mib({case!r}))"
        command = [sys.executable, "-c", code]
        output = subprocess.check_output(command, cwd=ROOT, env=clean_environment(), text=True)
        row["peak_mib"], row["results_mib"] = map(float, output.split())
        return row
    timing = measure(case.run, repeats)
    pairs = case.robots * (case.robots - 1) // 2
    return row | {
        "first_s": timing.first_s,
        "best_s": timing.best_s,
        "ns_per_robot_step": timing.best_s / (case.run_ticks * case.robots) * 1e9,
        "ns_per_pair_tick": timing.best_s / (case.run_ticks * pairs) * 1e9,
    }


def peak_mib(case: Case) -> tuple[float, float]:
    """Peak memory of this process once it has run a case, and size of the results (MiB)."""
    request_whole_loop()
    results = case.run()
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB elsewhere
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20, results.nbytes / 2**20


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """A line for each panel that says how what it shows grows."""
    lines = []
    for panel, rows in table.groupby("panel", sort=False):
        if panel in ("designs", "seeds", "ticks"):
            a, b = rows.iloc[-2], rows.iloc[-1]
            exponent = np.log(b["best_s"] / a["best_s"]) / np.log(b[panel] / a[panel])
            lines.append((panel, f"time grows with the power {exponent:.2f} from {a[panel]:.0f} to {b[panel]:.0f}"))
        elif panel == "robots":
            cost = rows.set_index("robots")["ns_per_pair_tick"]
            most = cost.index.max()
            ratio = cost.loc[most] / cost.loc[8]
            lines.append((panel, f"a pair and tick at N = {most:.0f} costs {ratio:.2f} of that at N = 8"))
        else:
            own = rows["peak_mib"] - rows["results_mib"]
            lines.append((panel, f"peak less the results: {', '.join(f'{mib:.0f}' for mib in own)} MiB"))
    return pd.DataFrame(lines, columns=["against", "what came out"])


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", choices=("smallest", "paper"), default="paper")
    parser.add_argument("--out", type=Path, default=ROOT / "experiments" / "bench" / "results", metavar="folder")
    options = parser.parse_args()
    request_whole_loop()
    table = pd.DataFrame([measure_case(case, 3 if options.size == "paper" else 1) for case in cases(options.size)])
    table = table.sort_values("panel", key=lambda panels: panels.map(PANELS.index), kind="stable")
    options.out.mkdir(parents=True, exist_ok=True)
    table.to_csv(options.out / "growth.csv", index=False, float_format="%.5g")
    print(markdown(summary(table)))
    draw_growth(table, options.out / "growth")


if __name__ == "__main__":
    main()
