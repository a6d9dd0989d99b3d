"""Peak memory of a study against the simulations done: a study of any size needs what the default one needs.

    python experiments/bench/flat_memory.py [--seeds 32 1600 5120] [--tau 0.1] [--out folder] [--keep folder]

Runs the default study with more and more seeds (32 are its own; 1600 make it 50 times as large, 5120 more than 10^7
simulations), each in a process of its own that is looked at every second. The baseline's sampling period is long, so
that all of them can be run to the end in minutes: memory hangs on the number of simulations, not on their ticks. Writes
flat_memory.csv, a line for each look, and flat_memory_peaks.csv, a line for each study. Needs 0.6 GB of disk.
"""

from __future__ import annotations

import argparse
import atexit
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np
import pandas as pd

from qocjax.store.checked import read_array

__all__ = ["main", "watched"]

ROOT = Path(__file__).resolve().parents[2]


def watched(seeds: int, tau: float, folder: Path) -> pd.DataFrame:
    """Runs the study; memory (MiB) and simulations done, about once a second. Linux only."""
    options = [f"sweep.seeds={seeds}", f"loop.tau={tau}", "figures=false", "report=false", f"hydra.run.dir={folder}"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "qocjax.sweep", *options]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
    atexit.register(process.kill)
    rows: list[dict[str, Any]] = []
    runs: dict[Path, int] = {}
    started = time.monotonic()
    while process.poll() is None:
        time.sleep(1)
        for path in set((folder / "chunks").glob("[!.]*-*.npz")) - set(runs):
            runs[path] = read_array(path, "collided").size
        if memory := _memory(process.pid):
            seconds = time.monotonic() - started
            row = {"seeds": seeds, "seconds": round(seconds, 1), "chunks": len(runs), "simulations": sum(runs.values())}
            rows.append(row | memory)
    if process.returncode:
        raise SystemExit(f"the study of {seeds} seeds ended with code {process.returncode}")
    return pd.DataFrame(rows)


def _memory(pid: int) -> dict[str, float]:
    """Resident now and at its peak (MiB); nothing once the process has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return {}
    found = {line.split(":")[0]: line.split()[1] for line in lines if line.startswith(("VmRSS", "VmHWM"))}
    return {name: int(found[key]) / 1024 for name, key in (("now_mib", "VmRSS"), ("peak_mib", "VmHWM")) if key in found}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[32, 1600, 5120], metavar="n")
    parser.add_argument("--tau", type=float, default=0.1, metavar="s", help="the baseline's sampling period")
    parser.add_argument("--out", type=Path, default=ROOT / "experiments" / "results", metavar="folder")
    parser.add_argument("--keep", type=Path, default=None, metavar="folder", help="where the studies stay")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        home = options.keep or Path(scratch)
        table = pd.concat([watched(seeds, options.tau, home / f"seeds_{seeds}") for seeds in options.seeds])
    peaks = table.groupby("seeds").agg({"simulations": "max", "chunks": "max", "seconds": "max", "peak_mib": "max"})
    peaks["bytes_per_simulation"] = np.append(
        np.nan, np.diff(peaks["peak_mib"]) * 2**20 / np.diff(peaks["simulations"])
    )
    options.out.mkdir(parents=True, exist_ok=True)
    table.to_csv(options.out / "flat_memory.csv", index=False, float_format="%.5g")
    peaks.reset_index().to_csv(options.out / "flat_memory_peaks.csv", index=False, float_format="%.5g")
    print(peaks.to_string(float_format="{:.4g}".format))


if __name__ == "__main__":
    main()
