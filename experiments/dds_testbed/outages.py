"""What comes back, and when, after a time without radio: outages of 5 to 60 s over each middleware.

    python -m experiments.dds_testbed.outages [--middlewares fastdds zenoh] [--runs folder] [--repeats 3]

RELIABLE, depth 10, one robot at 10 Hz, unicast peers as on 5G, and the middleware's own timers of discovery. Runs that
the folder holds are kept. They need no quiet machine: what is asked for is a matter of seconds.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from experiments.dds_testbed.cases import ROOT
from experiments.dds_testbed.middlewares import MIDDLEWARES

__all__ = ["OUTAGES", "main", "returned"]

OUTAGES = (5, 10, 20, 30, 40, 60)  # s
_BEGIN, _WAIT = 5, 60  # s, of loops before an outage and after it
_OPTIONS = (
    "scenario.start=[[0,0,0]]", "scenario.goal=[3,0]", "scenario.normaliser=goal_distance", "loop.tau=0.1",
    "dds.lease=null", f"outage.begin={_BEGIN}", "limits.relay_p99_ms=50", "limits.tick_p99_ms=50",
)  # fmt: skip


def returned(loops: pd.DataFrame, end: float) -> dict[str, float]:
    """What a run's loops say of the time after an outage.

    Args:
        loops: Of one robot, as the testbed writes them (s from the first sample).
        end: When the outage ends (s).

    Returns:
        From its end on (s, inf for never): `state`, until the edge has a first message; `command`, until the robot has
        a first answer to a state sent after it; `steady`, until the last loop that is lost or takes over 1 s is sent.
        And how many states sent within the outage the edge still got, `late_states`, and the age of the oldest of
        these when it came, `oldest` (s).
    """
    sent, at_edge, back = (loops[name].to_numpy() for name in ("uplink_send", "edge_receive", "downlink_receive"))
    after, within = sent >= end, (sent >= end - 120.0) & (sent < end) & (at_edge >= end)
    slow = after & ~(loops["loop_time"].to_numpy() <= 1.0)
    came = np.isfinite(back[after]).any()
    return {
        "state": np.min(at_edge[at_edge >= end], initial=np.inf) - end,
        "command": np.nanmin(np.append(back[after], np.inf)) - end,
        "steady": np.max(sent[slow], initial=end) - end if came and not slow[-1] else np.inf,
        "late_states": float(within.sum()),
        "oldest": float(np.max((at_edge - sent)[within], initial=0.0)),
    }


def _run(middleware: str, outage: int, place: Path) -> pd.DataFrame | None:
    """The loops of a run, made if the folder has none; None where a side ended early."""
    loops = place / "loops_0.csv"
    if not loops.exists():
        options = [*_OPTIONS, f"middleware={middleware}", f"outage.duration={outage}",
                   f"scenario.horizon={_BEGIN + outage + _WAIT}", f"folder={place.resolve()}"]  # fmt: skip
        status = subprocess.run([sys.executable, "-m", "experiments.dds_testbed", *options], cwd=ROOT).returncode
        if status not in (0, 3):
            print(f"left out: {middleware}, {outage} s: exit status {status}", flush=True)
            return None
    return pd.read_csv(loops)


def _measured(middlewares: Sequence[str], folder: Path, repeats: int) -> pd.DataFrame:
    rows = []
    for repeat in range(repeats):
        for middleware in middlewares:
            for outage in OUTAGES:
                place = folder / f"{middleware}-{outage}" / str(repeat)
                if (loops := _run(middleware, outage, place)) is not None:
                    link = json.loads((place / "record.json").read_text(encoding="utf-8"))["link"]
                    rows.append({"middleware": middleware, "outage": outage, "repeat": repeat}
                                | returned(loops, _BEGIN + outage)
                                | {f"{leg}_frames": link[leg]["frames"] for leg in link})  # fmt: skip
    return pd.DataFrame(rows)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--middlewares", nargs="+", choices=MIDDLEWARES, default=MIDDLEWARES)
    parser.add_argument("--runs", type=Path, default=Path("results/outages"), help="folder of the runs")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each")
    given = parser.parse_args()
    table = _measured(given.middlewares, given.runs, given.repeats)
    if table.empty:
        raise SystemExit("error: no run came to its end")
    if set(given.middlewares) == set(MIDDLEWARES):
        table.to_csv(ROOT / "experiments" / "results" / "outages.csv", index=False, float_format="%.4g")
    print(table.to_string(index=False, float_format="%.4g"))


if __name__ == "__main__":
    main()
