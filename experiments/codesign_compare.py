"""Joint co-design against the best one-at-a-time design, on three networks, with and without a limit on collisions.

    python experiments/codesign_compare.py [paper | kth_5g | cleave_wifi ...]

Keeps small tables in experiments/results: codesign.csv (the comparison) and, for each network under the limit,
codesign_<network>_{finals,policies,curve,front}.csv with the figures beside them. The measured trace is read from
../shared/data, or the folder that QOCJAX_DATA names, and left out without it. About five minutes on two cores.
"""

from __future__ import annotations

import json
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
PERIODS = "[0.05,0.075,0.1,0.15,0.2]"  # s; the trace was measured every 50 ms, and says nothing of faster loops
NETWORKS = {
    "paper": [],
    "kth_5g": ["experiment=kth_5g"],
    "cleave_wifi": ["experiment=cleave_wifi", "loop.tau=0.05", f"search.tau={PERIODS}", f"sweep.grids.tau={PERIODS}"],
}
MEASURED = ("cleave_wifi",)
LIMIT = 0.05  # share of runs in which the robots come closer than two radii
UNLIMITED = ["limits.collision_share=null", "search.methods=[cma_es]", "front=null", "figures=false"]
KEPT = ["method", "repetition", "simulations", "kept_at_choice", "score", "score_low", "score_high", "collision_share",
        "difference", "difference_low", "difference_high", "v_max", "eta", "kappa", "gamma", "c_miss", "tau",
        "deadline"]  # fmt: skip


def run(network: str, limited: bool) -> dict[str, object]:
    """Runs one search, keeps its tables, and returns its line of the comparison."""
    options = [*NETWORKS[network], *([f"limits.collision_share={LIMIT}"] if limited else UNLIMITED)]
    with tempfile.TemporaryDirectory() as name:
        folder, begin = Path(name), time.perf_counter()
        command = [sys.executable, "-m", "qocjax.codesign", *options, f"hydra.run.dir={folder}"]
        subprocess.run(command, check=True, cwd=ROOT)
        seconds = time.perf_counter() - begin
        print(f"{network}{'' if limited else ', no limit on collisions'}: {seconds:.0f} s\n", flush=True)
        if limited:
            keep(folder, network)
        return line(folder, network, limited)


def keep(folder: Path, network: str) -> None:
    """Copies the tables and figures that are to stay."""
    for name in ("finals", "policies", "curve", "front"):
        table = pd.read_csv(folder / f"{name}.csv")
        table = table[KEPT] if name == "finals" else table
        table.to_csv(RESULTS / f"codesign_{network}_{name}.csv", index=False, float_format="%.5g")
    for name in ("search", "front"):
        shutil.copyfile(folder / "figures" / f"{name}.png", RESULTS / f"codesign_{network}_{name}.png")


def line(folder: Path, network: str, limited: bool) -> dict[str, object]:
    """The chosen design beside the best one-at-a-time design."""
    record = json.loads((folder / "record.json").read_text(encoding="utf-8"))
    finals, policies = pd.read_csv(folder / "finals.csv"), pd.read_csv(folder / "policies.csv")
    same = (finals[list(record["chosen"])] / pd.Series(record["chosen"]) - 1).abs().max(axis=1)
    best, first = finals.loc[same.idxmin()], policies.iloc[0]
    return {
        "network": network, "collision_limit": LIMIT if limited else "none", "method": best["method"],
        **{name: best[name] for name in ("v_max", "eta", "kappa", "gamma", "c_miss", "tau", "deadline")},
        **{name: best[name] for name in ("score", "score_low", "score_high", "collision_share")},
        "one_at_a_time": f"{first['policy']}, sweep of {first['sweep']}", "one_at_a_time_score": first["score"],
        "one_at_a_time_collisions": first["collision_share"],
        **{name: best[name] for name in ("difference", "difference_low", "difference_high")},
        "ties": len(pd.read_csv(folder / "ties.csv")), "simulations": record["simulations"],
    }  # fmt: skip


def main() -> None:
    """Runs what is named, or all."""
    data = Path(os.environ.get("QOCJAX_DATA", ROOT / ".." / "shared" / "data"))
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / "codesign.csv"
    lines = pd.read_csv(path).to_dict("records") if path.exists() else []
    for network in sys.argv[1:] or NETWORKS:
        if network in MEASURED and not data.is_dir():
            print(f"{network}: no measured data at {data}, left out")
            continue
        lines = [old for old in lines if old["network"] != network]
        lines += [run(network, limited) for limited in (True, False)]
        table = pd.DataFrame(sorted(lines, key=lambda one: list(NETWORKS).index(str(one["network"]))))
        table.to_csv(path, index=False, float_format="%.5g")


if __name__ == "__main__":
    main()
