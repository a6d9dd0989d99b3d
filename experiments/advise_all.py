"""Advice on every measured network: python -m qocjax.advise on each trace of ../shared/data, or of QOCJAX_DATA.

    python experiments/advise_all.py [name ...]

Keeps each advice.yaml and a summary in experiments/results/advice. Every run compares with the default gains and a
deadline of 300 ms; a trace is replayed with the period that it was measured with, the others at tau = 10 ms. About
25 s of computing for each.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import yaml

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "experiments" / "results" / "advice"
DATA = Path(os.environ.get("QOCJAX_DATA", ROOT / ".." / "shared" / "data")).resolve()

WIFI = "cleave-wifi-loop/MOSN_20m_wifi_plant6_sample_rate_20/udpclient.plant."
CLEAVE = {"cleave_wifi_3": f"{WIFI}3.20211212.032926577813.csv", "cleave_wifi_5": f"{WIFI}5.20211212.032926613423.csv"}
CICV = {
    "urban_n78_v20_run02": 0.055, "urban_n8_v20_run01": 0.055, "urban_n8_v30_100ms_v2v_info-01": 0.105,
    "w2s_n8_v30_run07": 0.055, "s2w_n8_v30_run02": 0.055, "south_n8_v10_04": 0.055,
}  # s between two messages  # fmt: skip
EDGEDROID = {"edgedroid_near": "1Client_Benchmark", "edgedroid_far": "1Client_100Runs_BadLink"}


def trace(path: Path, column: str, unit: str, period: float, *more: str) -> list[str]:
    """Options for a trace; quotes, as Hydra reads parentheses in a value."""
    named = [f"network.path='{path}'", f"network.column='{column}'", f"network.unit={unit}", f"network.period={period}"]
    return ["network=trace", f"loop.tau={period}", *named, *more]


def edgedroid(folder: str, work: Path) -> list[str]:
    """Round trips of video frames as a trace: times of receipt less times of sending, both of the client's clock."""
    table = pd.read_csv(DATA / "edgedroid-wifi" / folder / "total_frame_stats.csv").sort_values(
        ["run_id", "client_send"]
    )
    path = work / f"edgedroid_{folder}.csv"
    (table["client_recv"] - table["client_send"]).to_frame("rtt").to_csv(path, index=False)
    within = table.groupby("run_id")["client_send"].diff()
    return trace(path, "rtt", "ms", round(float(within.median()) / 1e3, 4))


def oai(work: Path) -> list[str]:
    """Measured uplink delays before the paper's compute time; holes in their numbering are no proven losses."""
    path = work / "oai_5g_uplink.csv"
    pd.read_parquet(DATA / "oai-5g-uplink" / "res.parquet")[["e2e_delay"]].to_csv(path, index=False)
    uplink = [
        f"network.uplink.delay.path='{path}'",
        "network.uplink.delay.column=e2e_delay",
        "network.uplink.delay.unit=ms",
    ]
    return ["network=loop", "delay@network.uplink.delay=samples", "network.name=oai_5g_uplink", *uplink]


def cases(work: Path) -> dict[str, Callable[[], list[str]]]:
    """Options of each network by name, made when needed."""
    made: dict[str, Callable[[], list[str]]] = {"kth_5g": lambda: ["network=kth_5g"]}
    for name, file in CLEAVE.items():
        made[name] = lambda file=file: trace(DATA / file, "rtt", "s", 0.05, "network.sequence=seq")
    for name, period in CICV.items():
        path = DATA / "cicv-5g-rtt" / f"{name}.txt"
        made[f"cicv_{name}"] = lambda path=path, period=period: trace(path, "delay(ms)", "ms", period)
    for name, folder in EDGEDROID.items():
        made[name] = lambda folder=folder: edgedroid(folder, work)
    made["oai_5g_uplink"] = lambda: oai(work)
    return made


def run(name: str, options: list[str], work: Path) -> None:
    """Runs one advice and keeps its file."""
    folder = work / name
    begin = time.perf_counter()
    command = [
        sys.executable,
        "-W",
        "ignore",
        "-m",
        "qocjax.advise",
        *options,
        f"hydra.run.dir={folder}",
        "figures=false",
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    print(f"== {name}: {time.perf_counter() - begin:.0f} s\n{done.stdout}{done.stderr}", flush=True)
    if done.returncode == 0:
        values = yaml.safe_load((folder / "advice.yaml").read_text(encoding="utf-8"))
        for key in ("written", "platform", "versions", "device"):  # the same for all, and no result
            values.pop(key)
        values["network"].pop("source", None)  # a path on the machine that it ran on
        (RESULTS / f"{name}.yaml").write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")


def summary() -> pd.DataFrame:
    """One row per network, from the files kept."""
    rows = []
    for path in sorted(RESULTS.glob("*.yaml")):
        a = yaml.safe_load(path.read_text(encoding="utf-8"))
        best, loop, (now, deadline_only, by_mean, then) = a["recommended"], a["loop"], a["judged"]
        stress = {row["what"]: row for row in a["stress"]}
        changed = [row for row in a["stress"][1:] if row["current_qoc"] is not None]
        rows.append(
            {
                "network": path.stem, "p50_ms": loop["percentiles_ms"]["p50"], "p99_ms": loop["percentiles_ms"]["p99"],
                "lost_share": loop["lost_share"], "delay_correlation": loop["delay_correlation"],
                "mean_miss_run": loop["mean_miss_run"], "reliability": loop["reliability"],
                "deadline_ms": 1e3 * best["deadline"],
                **{gain: best[gain] for gain in ("kappa", "gamma", "eta", "c_miss", "v_max")},
                "qoc_current": now["qoc"], "qoc": then["qoc"], "gain": then["gain"], "gain_low": then["gain_low"],
                "gain_high": then["gain_high"], "gain_of_deadline": deadline_only["gain"],
                "collisions_current": now["collision_share"], "collisions": then["collision_share"],
                **{f"margin_{end}_ms": 1e3 * a["margin"][end]["value"] for end in ("low", "high")},
                **{f"current_margin_{end}_ms": 1e3 * a["current_margin"][end]["value"] for end in ("low", "high")},
                "growth": a["growth"]["value"], "deadline_x15": stress["as it is, deadline x 1.5"]["change"],
                "delay_x15": stress["all loop times x 1.5"]["change"],
                "delay_and_deadline_x15": stress["all loop times x 1.5, deadline x 1.5"]["change"],
                "deadline_by_mean_ms": 1e3 * by_mean["deadline"], "cost": by_mean["beyond"],
                **{f"worst_{name}qoc": min(row[f"{name}qoc"] for row in changed)
                   for name in ("", "by_mean_", "current_")},
                "verdict": a["verdict"], "acceptable": a["acceptable"], "kept": " ".join(a["kept_as_they_were"]),
                "current_policy": a["current_policy"], "ties": len(a["ties"]) - 1,
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


def main() -> None:
    """Runs what is named, or all."""
    if not DATA.is_dir():
        sys.exit(f"no measured data at {DATA}")
    RESULTS.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        every = cases(Path(folder))
        for name in sys.argv[1:] or every:
            if name not in every:
                sys.exit(f"{name}: no such network, expected one of {', '.join(every)}")
            run(name, every[name](), Path(folder))
    summary().to_csv(RESULTS / "summary.csv", index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
