"""Every recorded bag and loop log of ../shared/data, or of QOCJAX_DATA, through python -m qocjax.ingest.

    python experiments/ingest_all.py [name ...]

Keeps what came out of each run as experiments/results/ingest.csv, and the clocks of one Wi-Fi loop and the path of one
TurtleBot as figures beside it. Half a minute.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pandas as pd

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "experiments" / "results"
DATA = Path(os.environ.get("QOCJAX_DATA", ROOT / ".." / "shared" / "data")).resolve()

MOCAP = 'topics.poses=["/vrpn_client_node/turtlebot{robot}_cap/pose"]'
JOBS: dict[str, tuple[str, list[str]]] = {
    "turtlebot3": ("turtlebot3-bags", ["robot=turtlebot3_burger", "quality.goal=end"]),
    "turtlebot4_mocap": ("turtlebot4-bags", [MOCAP]),
    "turtlebot4_odometry": ("turtlebot4-bags", ["topics.poses=['/{robot}/odom']"]),
    "cleave": ("cleave-wifi-loop", ["stamps=cleave"]),
    "edgedroid": ("edgedroid-wifi", ["stamps=edgedroid", "clock.window=5"]),
    "edgedroid_client": ("edgedroid-wifi", ["stamps=edgedroid_client"]),
}
FIGURES = {
    "ingest_clock.png": ("cleave", "*plant.3*/clock_loops.png"),
    "ingest_delays.png": ("edgedroid", "*BadLink*/delays.png"),
    "ingest_path.png": ("turtlebot3", "*/trajectories.png"),
}
COLUMNS = [
    "recorded", "robots", "duration", "auc", "min_distance", "path_length", "commands", "command_period",
    "command_gaps", "longest_command_gap", "hold_share", "command_to_motion", "command_to_motion_half",
    "pose_late_p50", "pose_late_p99", "loops", "lost",
    "lost_uplink", "period", "loop_p50", "loop_p95", "loop_p99", "uplink_p50", "compute_p50", "downlink_p50",
    "parts_share", "clock_uncertainty", "clock_drift_ppm", "offered_qos",
]  # fmt: skip


def ingest(name: str, work: Path) -> pd.DataFrame:
    """Runs one job and returns its summary."""
    folder, options = JOBS[name]
    begin = time.perf_counter()
    command = [sys.executable, "-m", "qocjax.ingest", f"path={DATA / folder}", *options, f"hydra.run.dir={work / name}"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    print(f"== {name}: {time.perf_counter() - begin:.0f} s\n{done.stdout}{done.stderr}", flush=True)
    done.check_returncode()
    table = pd.read_csv(work / name / "summary.csv")
    found = [column for column in table if column.startswith("found_")]
    wrong = [
        "; ".join(f"{int(row[c])} {c.removeprefix('found_')}" for c in found if row[c]) for _, row in table.iterrows()
    ]
    return table.reindex(columns=["run", *COLUMNS]).assign(found=wrong, notes=table["notes"]).assign(job=name)


def main() -> None:
    """Runs what is named, or all."""
    names = sys.argv[1:] or list(JOBS)
    tables = []
    with tempfile.TemporaryDirectory() as scratch:
        work = Path(scratch)
        for name in names:
            if name not in JOBS:
                sys.exit(f"{name}: no such job, expected one of {', '.join(JOBS)}")
            if not (DATA / JOBS[name][0]).is_dir():
                print(f"{name}: no measured data at {DATA / JOBS[name][0]}, left out")
                continue
            tables.append(ingest(name, work))
        for target, (job, pattern) in FIGURES.items():
            for file in sorted((work / job).glob(f"runs/{pattern}"))[:1]:
                shutil.copyfile(file, RESULTS / target)
    if tables:
        whole = pd.concat(tables, ignore_index=True)
        columns = ["job", *(column for column in whole if column != "job")]
        whole[columns].to_csv(RESULTS / "ingest.csv", index=False, float_format="%.5g")


if __name__ == "__main__":
    main()
