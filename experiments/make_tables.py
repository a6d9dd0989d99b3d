"""Runs the experiments of conf/experiment and keeps their small tables in experiments/results.

    python experiments/make_tables.py [experiment ...]

Those on measured traces read ../shared/data, or the folder that QOCJAX_DATA names, and are left out without it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pandas as pd

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "experiments" / "results"
MEASURED = ("cleave_wifi", "cicv_5g")
OTHERS = ("ci", "navigation")  # whose tables are not kept
CURVES = ("auc_eta", "auc_tau", "auc_delay")  # whose curve over the deadline is the figure
CURVE_COLUMNS = ["value", "deadline", "reliability", "auc", "auc_se", "auc_normalised", "qoc", "qoc_se"]


def run(name: str) -> None:
    """Runs one experiment and keeps its tables."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        command = [sys.executable, "-m", "qocjax.sweep", f"experiment={name}", f"hydra.run.dir={folder}"]
        subprocess.run(command, check=True, cwd=ROOT)
        print(f"{name}: {time.perf_counter() - begin:.0f} s\n", flush=True)
        pd.read_csv(Path(folder) / "policies.csv").to_csv(RESULTS / f"{name}.csv", index=False, float_format="%.5g")
        if name in CURVES:
            table = pd.read_csv(Path(folder) / "results.csv")[CURVE_COLUMNS]
            table.to_csv(RESULTS / f"{name}_curve.csv", index=False, float_format="%.5g")


def main() -> None:
    """Runs what is named, or all."""
    data = Path(os.environ.get("QOCJAX_DATA", ROOT / ".." / "shared" / "data"))
    RESULTS.mkdir(exist_ok=True)
    names = [path.stem for path in (ROOT / "conf" / "experiment").glob("*.yaml")]
    every = sorted(name for name in names if name not in OTHERS and not name.startswith("fleet"))  # of another command
    for name in sys.argv[1:] or every:
        if name in MEASURED and not data.is_dir():
            print(f"{name}: no measured data at {data}, left out")
            continue
        run(name)


if __name__ == "__main__":
    main()
