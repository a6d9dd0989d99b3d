"""The runs of the comparison: three QoS profiles on five channels, and how they are measured."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from qocjax.network import GilbertElliott, IndependentLoss

__all__ = ["CASES", "LEVELS", "NUMBERS", "PROFILES", "Case", "measure", "summarise"]

ROOT = Path(__file__).resolve().parents[2]
PROFILES = {"best_effort": ("best_effort", 1), "reliable_1": ("reliable", 1), "reliable_10": ("reliable", 10)}
LEVELS = np.linspace(0.0, 1.0, 101)  # of the quantiles that are kept
HORIZON = 20.0  # s
_BURST = 5  # sampling periods, the mean length of a burst
_ATTEMPTS = 3

# name of a number: its aim, and whether that is relative to what was measured; no aim for the last ones
NUMBERS = {
    "lost": (0.02, False), "p50": (0.2, True), "p95": (0.2, True), "p99": (0.2, True),
    "age_mean": (0.2, True), "age_p99": (0.2, True), "uplink_bytes": (0.2, True), "downlink_bytes": (0.2, True),
    "auc": (0.2, True), "qoc": (None, False),
}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One profile on one channel, the same both ways."""

    profile: str
    loss: float
    bursty: bool
    middleware: str = "cyclonedds"
    horizon: float = HORIZON  # s

    @property
    def name(self) -> str:
        """Name of its folder."""
        of = "" if self.middleware == "cyclonedds" else f"{self.middleware}-"
        return f"{of}{self.profile}-{self.loss * 100:g}{'-bursty' if self.bursty else ''}"

    def process(self) -> IndependentLoss | GilbertElliott:
        """What loses its messages."""
        if not self.bursty:
            return IndependentLoss(self.loss)
        return GilbertElliott(self.loss / (1.0 - self.loss) / _BURST, 1.0 / _BURST)

    def options(self) -> list[str]:
        """As options of the testbed; channels have random numbers of their own, profiles share them."""
        reliability, depth = PROFILES[self.profile]
        key = round(1000 * self.loss) + self.bursty
        options = [f"middleware={self.middleware}", f"qos.reliability={reliability}", f"qos.depth={depth}",
                   f"key={key}", f"scenario.horizon={self.horizon}"]  # fmt: skip
        for leg in ("uplink", "downlink"):
            if isinstance(process := self.process(), GilbertElliott):
                options.append(f"loss@network.{leg}.loss=gilbert_elliott")
                values = {"p_good_to_bad": process.p_good_to_bad, "p_bad_to_good": process.p_bad_to_good}
            else:
                values = {"probability": process.probability}
            options += [f"network.{leg}.loss.{name}={value}" for name, value in values.items()]
        return options


CASES = [
    Case(profile, loss, bursty)
    for loss, bursty in ((0.0, False), (0.05, False), (0.1, False), (0.2, False), (0.1, True))
    for profile in PROFILES
]


def measure(cases: Iterable[Case], folder: Path) -> None:
    """Measures those cases that the folder does not hold yet; a rejected run is made again, a few times."""
    for case in cases:
        place = folder / case.name
        for _ in range(_ATTEMPTS):
            if (place / "record.json").exists() and not json.loads((place / "record.json").read_text())["rejected"]:
                break
            print(f"\n{case.name}", flush=True)
            command = [sys.executable, "-m", "experiments.dds_testbed", *case.options(), f"folder={place.resolve()}"]
            status = subprocess.run(command, cwd=ROOT).returncode
            if status not in (0, 3):
                raise SystemExit(status)
        else:
            raise SystemExit(f"error: {case.name}: rejected {_ATTEMPTS} times, expected a quieter machine")


def summarise(cases: Iterable[Case], folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Numbers of the measured cases, a row each, and the quantiles of their loop times, a column each (s, inf)."""
    rows, quantiles = [], {"level": LEVELS}
    for case in cases:
        record = json.loads((folder / case.name / "record.json").read_text(encoding="utf-8"))
        link, late = record["link"], record["lateness"]
        rows.append(
            {"middleware": case.middleware, "loss": case.loss, "bursty": case.bursty, "profile": case.profile}
            | record["loops"]
            | {f"{leg}_bytes": link[leg]["bytes"] for leg in link}
            | {f"{leg}_frames": link[leg]["frames"] for leg in link}
            | {f"auc_{robot}": auc for robot, auc in enumerate(record["auc"])}
            | {f"auc_replayed_{robot}": auc for robot, auc in enumerate(record["auc_replayed"])}
            | {f"{name}_late_{p}": value for name, each in late.items() for p, value in each.items()}
        )
        files = sorted((folder / case.name).glob("loops_*.csv"))
        times = pd.concat([pd.read_csv(file) for file in files])["loop_time"].to_numpy()
        quantiles[case.name] = np.quantile(times, LEVELS, method="inverted_cdf")
    return pd.DataFrame(rows), pd.DataFrame(quantiles)
