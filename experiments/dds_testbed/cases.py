"""The runs of the comparison: QoS profiles of three middlewares on nine channels, and how they are measured."""

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

__all__ = ["CHANNELS", "HORIZON", "LEVELS", "PROFILES", "REPEATS", "Case", "cases_of", "measure", "summarise"]

ROOT = Path(__file__).resolve().parents[2]
BURST = 0.2  # s, the mean length of a burst
CHANNELS = ((0.0, False), *((loss, bursty) for bursty in (False, True) for loss in (0.05, 0.1, 0.2, 0.3)))
REPEATS = 3
LEVELS = np.linspace(0.0, 1.0, 101)  # of the quantiles that are kept
_TAU = 0.02  # s
HORIZON = 8.0  # s
_ATTEMPTS = 3

_OF_DDS = {
    "best_effort": {"qos.reliability": "best_effort", "qos.depth": 1},
    "reliable_1": {"qos.reliability": "reliable", "qos.depth": 1},
    "reliable_10": {"qos.reliability": "reliable", "qos.depth": 10},
    "reliable_all": {"qos.reliability": "reliable", "qos.depth": "null"},
}
_OF_FASTDDS = _OF_DDS | {"reliable_10_fast": _OF_DDS["reliable_10"] | {"dds.heartbeat_period": _TAU}}
# rmw_zenoh: TCP unless asked otherwise; KEEP_ALL blocks where all else drops; the depth changes nothing on the wire
_OF_ZENOH = {
    "best_effort_udp": {"qos.reliability": "best_effort", "zenoh.protocol": "udp"},
    "best_effort": {"qos.reliability": "best_effort", "zenoh.protocol": "tcp"},
    "reliable_10": {"qos.reliability": "reliable", "zenoh.protocol": "tcp"},
    "reliable_all": {"qos.reliability": "reliable", "qos.depth": "null", "zenoh.congestion": "block"},
}
PROFILES = {"cyclonedds": _OF_DDS, "fastdds": _OF_FASTDDS, "zenoh": _OF_ZENOH}


@dataclass(frozen=True)
class Case:
    """One profile of a middleware on one channel, the same both ways."""

    middleware: str
    profile: str
    loss: float
    bursty: bool

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"{self.middleware}-{self.profile}-{self.loss * 100:g}{'-bursty' if self.bursty else ''}"

    def process(self) -> IndependentLoss | GilbertElliott:
        """What loses its messages."""
        if not self.bursty:
            return IndependentLoss(self.loss)
        ends = _TAU / BURST
        return GilbertElliott(self.loss / (1.0 - self.loss) * ends, ends)

    def options(self, repeat: int = 0) -> list[str]:
        """As options of the testbed; channels and repeats have random numbers of their own, profiles share them."""
        key = 10 * round(1000 * self.loss) + 5 * self.bursty + repeat
        values = PROFILES[self.middleware][self.profile] | {
            "middleware": self.middleware, "key": key, "scenario.horizon": HORIZON, "loop.tau": _TAU,
        }  # fmt: skip
        options = [f"{name}={value}" for name, value in values.items()]
        for leg in ("uplink", "downlink"):
            if isinstance(process := self.process(), GilbertElliott):
                options.append(f"loss@network.{leg}.loss=gilbert_elliott")
                lost = {"p_good_to_bad": process.p_good_to_bad, "p_bad_to_good": process.p_bad_to_good}
            else:
                lost = {"probability": process.probability}
            options += [f"network.{leg}.loss.{name}={value}" for name, value in lost.items()]
        return options


def cases_of(middlewares: Iterable[str]) -> list[Case]:
    """The cases of some middlewares, those of one channel beside each other."""
    chosen = [(middleware, profile) for middleware in middlewares for profile in PROFILES[middleware]]
    return [Case(*each, loss, bursty) for loss, bursty in CHANNELS for each in chosen]


def measure(cases: Iterable[Case], folder: Path, repeats: int = REPEATS) -> list[str]:
    """Measures what the folder does not hold yet, every case once before any of them again.

    A run that is rejected is made again, a few times, and then left out.

    Returns:
        The runs that were left out.
    """
    runs = [(case, repeat) for repeat in range(repeats) for case in cases]
    return [f"{case.name}/{repeat}" for case, repeat in runs if not _counts(case, repeat, folder)]


def _counts(case: Case, repeat: int, folder: Path) -> bool:
    """Whether there is a run that counts, after making it if there is none."""
    place = folder / case.name / str(repeat)
    for _ in range(_ATTEMPTS):
        if _record(place) is not None:
            return True
        print(f"\n{case.name}, {repeat + 1}", flush=True)
        command = [
            sys.executable, "-m", "experiments.dds_testbed", *case.options(repeat), f"folder={place.resolve()}",
        ]  # fmt: skip
        status = subprocess.run(command, cwd=ROOT).returncode
        if status not in (0, 3):
            raise SystemExit(status)
    return _record(place) is not None


def _record(place: Path) -> dict | None:
    path = place / "record.json"
    record = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"rejected": True}
    return None if record["rejected"] else record


def summarise(cases: Iterable[Case], folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """A row of numbers for each run that counts, and quantiles of each case's loop times, a column each (s, inf)."""
    rows, quantiles = [], {"level": LEVELS}
    for case in cases:
        places = {place: record for place in sorted((folder / case.name).glob("*")) if (record := _record(place))}
        rows += [_row(case, place, record) for place, record in places.items()]
        files = [file for place in places for file in sorted(place.glob("loops_*.csv"))]
        if files:
            times = pd.concat([pd.read_csv(file) for file in files])["loop_time"].to_numpy()
            quantiles[case.name] = np.quantile(times, LEVELS, method="inverted_cdf")
    return pd.DataFrame(rows), pd.DataFrame(quantiles)


def _row(case: Case, place: Path, record: dict) -> dict:
    link, late = record["link"], record["lateness"]
    return (
        vars(case) | {"repeat": int(place.name)} | record["loops"]
        | {f"{leg}_bytes": link[leg]["bytes"] for leg in link}
        | {f"auc_{robot}": auc for robot, auc in enumerate(record["auc"])}
        | {f"auc_replayed_{robot}": auc for robot, auc in enumerate(record["auc_replayed"])}
        | {f"{name}_late_{p}": value for name, each in late.items() for p, value in each.items()}
    )  # fmt: skip
