"""The three middlewares side by side: QoS profiles on lossy channels, a row for each run that counts.

    python -m experiments.dds_testbed.grid [--middlewares fastdds zenoh] [--runs folder] [--horizon 8]

Runs that the folder holds are kept. A run that is rejected three times is told and left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from experiments.dds_testbed.cases import ROOT, Case, measure, summarise
from experiments.dds_testbed.middlewares import MIDDLEWARES

__all__ = ["cells", "main"]

_CHANNELS = ((0.0, False), (0.1, False), (0.2, False), (0.1, True))
_PROFILES = ("best_effort", "reliable_10")
_SHOWN = ("lost", "p50", "p95", "p99", "age_mean", "age_p99", "uplink_bytes", "downlink_bytes", "auc_0", "auc_1")


def cells(middlewares: Sequence[str], horizon: float) -> list[Case]:
    """The cases, those of one channel beside each other."""
    return [
        Case(profile, loss, bursty, middleware, horizon)
        for loss, bursty in _CHANNELS for middleware in middlewares for profile in _PROFILES
    ]  # fmt: skip


def _counts(case: Case, folder: Path) -> bool:
    try:
        measure([case], folder)
    except SystemExit as reason:
        if not isinstance(reason.code, str):
            raise
        print(f"left out: {reason.code.removeprefix('error: ')}", flush=True)
        return False
    return True


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--middlewares", nargs="+", choices=MIDDLEWARES, default=MIDDLEWARES)
    parser.add_argument("--runs", type=Path, default=Path("results/middlewares"), help="folder of the runs")
    parser.add_argument("--horizon", type=float, default=8.0, help="s of each run")
    given = parser.parse_args()
    counting = [case for case in cells(given.middlewares, given.horizon) if _counts(case, given.runs)]
    if not counting:
        raise SystemExit("error: no run counts, expected a quieter machine")
    table, _ = summarise(counting, given.runs)
    table = table[["middleware", "loss", "bursty", "profile", *_SHOWN]]
    pd.DataFrame(table).to_csv(ROOT / "experiments" / "results" / "middlewares.csv", index=False, float_format="%.4g")
    print(table.to_string(index=False, float_format="%.4g"))


if __name__ == "__main__":
    main()
