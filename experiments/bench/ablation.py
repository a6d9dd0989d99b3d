"""What each choice brings: one batch of the closed loop without it.

    python experiments/bench/ablation.py [--size smallest|paper] [--out folder]

Each variant runs in a process of its own, they take turns, and the best of 20 calls counts. About 2 minutes.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import pandas as pd

from experiments.bench.entries import ROOT, Process
from experiments.bench.report import markdown, write
from experiments.bench.timing import machine

__all__ = ["VARIANTS", "main", "measure_variants"]

# Two robots, 384 runs a batch, deadline 200 ms: one arc a tick. On one thread, so that a machine with other work to do
# disturbs little.
BASE: dict[str, Any] = {"designs": 12, "seeds": 32, "ticks": 3000, "threads": 1}
VARIANTS: dict[str, dict[str, Any]] = {
    "as qocjax runs it, on one thread": {},
    "without the request for the whole loop": {"whole_loop": False},
    "vectors of XLA's own width (256 bits)": {"vector_width": None},
    "XLA's own optimisation level (3)": {"level": None},
    "XLA's own choices throughout": {"whole_loop": False, "vector_width": None, "level": None},
    "exact functions of angles": {"math": "exact"},
    "designs last": {"layout": "designs last"},
    "nothing shared between runs": {"layout": "nothing shared"},
    "128 runs a batch": {"designs": 4},
    "512 runs a batch": {"designs": 16},
    "2048 runs a batch": {"designs": 64},
    "8192 runs a batch": {"designs": 256},
    "a thread on each core": {"threads": None},
    "two arcs a tick (deadline 205 ms)": {"deadline": 0.205},
}


def measure_variants(variants: dict[str, dict[str, Any]], base: dict[str, Any], rounds: int) -> pd.DataFrame:
    """Times variants of a batch.

    Args:
        variants: Options of `OneBatch` that differ from `base`; the first variant is what the others are compared with.
        base: Options common to all.
        rounds: Calls of each after the first.

    Returns:
        A row for each variant: time per robot-step, over the first variant's, and seconds of compilation.
    """
    processes: dict[str, Process] = {}
    best: dict[str, dict[str, Any]] = {}
    try:
        for _ in range(rounds + 1):
            for name, changed in variants.items():
                if name not in processes:
                    processes[name] = Process(name, "one_batch", base | changed)
                processes[name].ask()
                answer = processes[name].answer()
                if name not in best or answer["seconds"] < best[name]["seconds"]:
                    best[name] = answer
    finally:
        for process in processes.values():
            process.close()
    ns = {name: answer["seconds"] / answer["robot_steps"] * 1e9 for name, answer in best.items()}
    rows = [(name, ns[name], ns[name] / next(iter(ns.values())), best[name]["compile_s"]) for name in variants]
    return pd.DataFrame(rows, columns=["variant", "ns_per_robot_step", "over_first", "compile_s"])


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", choices=("smallest", "paper"), default="paper")
    parser.add_argument("--out", type=Path, default=ROOT / "experiments" / "bench" / "results", metavar="folder")
    options = parser.parse_args()
    here = machine() | {"load": os.getloadavg()[0]}
    if options.size == "smallest":
        names = ("as qocjax runs it, on one thread", "without the request for the whole loop")
        table = measure_variants({name: VARIANTS[name] for name in names}, {"designs": 2, "seeds": 4, "ticks": 50}, 1)
    else:
        table = measure_variants(VARIANTS, BASE, 20)
    shown = pd.DataFrame({"variant": table["variant"]})
    shown["ns per robot-step"] = table["ns_per_robot_step"].map("{:.2f}".format)
    shown["/ first row"] = table["over_first"].map("{:.2f}".format)
    shown["compilation (s)"] = table["compile_s"].map("{:.1f}".format)
    print(markdown(shown))
    write(options.out, "ablation", table, {"machine": here, "size": options.size})


if __name__ == "__main__":
    main()
