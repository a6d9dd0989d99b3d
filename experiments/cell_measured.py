"""Delays of a simulated cell beside measured ones: which quantiles come out of which few settings, and which do not.

    python experiments/cell_measured.py

Settings are chosen on the 5, 50 and 95 % quantiles of one half of each measurement and judged on six quantiles of the
other half. Data is read from ../shared/data, or from the folder that QOCJAX_DATA names, and left out without it. About
two minutes; the table and the figure are kept in experiments/results/cell_measured.*.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from qocjax.figures.save import save
from qocjax.figures.style import DOUBLE_COLUMN, OKABE_ITO, paper_style
from qocjax.network import QuantileTable, read_histogram
from qocjax.network.cell import Access, CellNetwork, Direction, Frame
from qocjax.network.contention import contend
from qocjax.network.demand import Carrier

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("QOCJAX_DATA", ROOT / ".." / "shared" / "data"))
RESULTS = ROOT / "experiments" / "results" / "cell_measured"
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
CHOSEN_ON = (0.05, 0.5, 0.95)
MESSAGES = 20_000  # simulated for each setting
TAU = 10.127e-3  # s, at which the uplink of OpenAirInterface was measured; it drifts past the slots
ANY_INSTANT = QuantileTable(np.array([0.0, 1.0]), np.array([0.0, 10e-3]), "uniform")  # commands at any phase of slots
SYMBOLS = 3 / 14  # of an uplink slot that OpenAirInterface gave to data


@dataclass(frozen=True)
class Setting:
    """What is chosen."""

    frame: Frame
    access: Access = Access()
    bler: float = 0.0
    harq_rtt: float = 0.0
    core: float = 0.0
    slots: float = 1e-3  # that a message takes

    def network(self, way: str) -> CellNetwork:
        """One robot alone on the cell."""
        message = Direction(1250.0 * self.slots, 10_000.0, self.bler)
        ways = {"uplink": Direction(1.0, 10_000.0), "downlink": Direction(1.0, 10_000.0)} | {way: message}
        return CellNetwork(**ways, compute=ANY_INSTANT, frame=self.frame, access=self.access, harq_rtt=self.harq_rtt,
                           core=self.core)  # fmt: skip

    def describe(self) -> str:
        """For the table."""
        parts = [f"{self.frame.pattern} at {1e3 * self.frame.slot:g} ms"]
        for name, seconds in (("request period", self.access.request_period), ("grant", self.access.grant)):
            parts += [f"{name} {1e3 * seconds:.3g} ms"] * (seconds > 0)
        parts += [f"HARQ {100 * self.bler:.3g} % after {1e3 * self.harq_rtt:.3g} ms"] * (self.bler > 0)
        return ", ".join([*parts, f"core {1e3 * self.core:.3g} ms"])


def simulated(setting: Setting, way: str) -> np.ndarray:
    """Delays of one direction (ms), message by message, inf where lost; what chance decides is always the same."""
    network = setting.network(way)
    drawn = _draw(Setting(Frame(), bler=setting.bler).network(way).source)  # chance knows nothing of slots and access
    found = contend(network, drawn, MESSAGES, TAU, jnp.zeros(1))
    began, times, busy = (np.asarray(part)[0, 0, :, 0] for part in (found.began, found.loop_times, found.busy))
    return 1e3 * (began if way == "uplink" else times - began - busy)


@partial(jax.jit, static_argnames="network")
def _draw(network: CellNetwork) -> Any:
    return jax.vmap(lambda key: network.draw(key, MESSAGES, 1, TAU))(jax.random.key(0)[None])


def quantiles(delays: np.ndarray, at: tuple[float, ...]) -> np.ndarray:
    """Of the messages that arrive (ms)."""
    return np.quantile(delays[np.isfinite(delays)], at)


class Compared(NamedTuple):
    """One quantity of one measurement beside the simulation, in ms."""

    data: str
    quantity: str
    setting: str
    chosen: np.ndarray  # measured, the half that settings were chosen on
    judged: np.ndarray  # measured, the other half
    model: np.ndarray

    def rows(self) -> Iterator[dict]:
        """One for each quantile."""
        numbers = (quantiles(values, QUANTILES) for values in (self.judged, self.model, self.chosen))
        for at, judged, model, chosen in zip(QUANTILES, *numbers, strict=True):
            yield {"data": self.data, "quantity": self.quantity, "setting": self.setting, "quantile": at,
                   "chosen_on": at in CHOSEN_ON, "measured_ms": judged, "model_ms": model, "error_ms": model - judged,
                   "halves_differ_ms": chosen - judged}  # fmt: skip


# OpenAirInterface, uplink: parts of the delay are known.
PARTS = {
    "queuing": "queuing_delay",
    "segmentation": "segmentation_delay",
    "retransmission": "retransmission_delay",
    "link": "link_delay",
    "all": "ran_delay",
}


def oai() -> list[Compared]:
    """The frame and HARQ as they were recorded; access, PRBs and the constant are chosen."""
    whole = pd.read_parquet(DATA / "oai-5g-uplink" / "res.parquet").sort_values("seqno")
    first, second = whole[: len(whole) // 2], whole[len(whole) // 2 :]
    repeated = first["retransmission_delay"] > 1.0
    mcs = int(first["rlc.reassembled.0.mac.demuxed.mcs"].median())
    frame = Frame("DDDSU", 0.5e-3)  # one uplink slot in five, by the slot numbers in the record
    access = best_access(frame, first["queuing_delay"].to_numpy())
    setting = Setting(frame, access, float(repeated.mean()), first["retransmission_delay"][repeated].median() / 1e3)
    blocks, slots = best_blocks(setting, mcs, first["segmentation_delay"].to_numpy())
    setting = Setting(frame, access, setting.bler, setting.harq_rtt, slots=slots)
    core = np.median(first["ran_delay"]) - quantiles(model_parts(setting)["all"], (0.5,))[0]
    setting = Setting(frame, access, setting.bler, setting.harq_rtt, max(core, 0.0) / 1e3, slots)
    text = f"{setting.describe()}, {blocks} PRBs of 3 symbols at MCS {mcs}"
    found = model_parts(setting)
    return [
        Compared(
            "OpenAirInterface uplink", name, text, first[column].to_numpy(), second[column].to_numpy(), found[name]
        )
        for name, column in PARTS.items()
    ]


def best_access(frame: Frame, queuing: np.ndarray) -> Access:
    """Scheduling requests whose waits for the first slot are nearest to those measured (ms)."""
    wanted = quantiles(queuing, CHOSEN_ON)
    best, least = Access(), np.inf
    for period in (0.0, 2.5, 5.0, 7.5, 10.0, 15.0, 20.0):
        wait = simulated(Setting(frame, Access(period / 1e3)), "uplink") - 1e3 * frame.slot
        found = quantiles(wait, CHOSEN_ON)
        grant = max(wanted[1] - found[1], 0.0)  # adds to every wait, as messages meet all phases of the slots
        error = np.abs(found + grant - wanted).mean()
        if error < least:
            best, least = Access(period / 1e3, grant / 1e3), error
    return best


def best_blocks(setting: Setting, mcs: int, segmentation: np.ndarray) -> tuple[int, float]:
    """PRBs of a grant, and the slots that a packet then takes, by how long segments follow each other (ms)."""
    wanted = quantiles(segmentation, CHOSEN_ON)
    slot_bits = Carrier(40, 1, mcs_uplink=mcs).rate_per_block("uplink") * setting.frame.slot * SYMBOLS

    def slots(blocks: int) -> float:
        return 8 * 131 / (blocks * slot_bits)  # 128 bytes and the header of PDCP

    def error(blocks: int) -> float:
        parts = model_parts(Setting(setting.frame, setting.access, slots=slots(blocks)))
        return float(np.abs(quantiles(parts["segmentation"], CHOSEN_ON) - wanted).mean())

    blocks = min(range(4, 19), key=error)
    return blocks, slots(blocks)


def model_parts(setting: Setting) -> dict[str, np.ndarray]:
    """Parts of the simulated delay (ms), from the same messages made short, and without failures."""
    frame, access = setting.frame, setting.access
    slot, core = 1e3 * frame.slot, 1e3 * setting.core
    alone = simulated(Setting(frame, access), "uplink")
    sent = simulated(Setting(frame, access, slots=setting.slots), "uplink")
    whole = simulated(setting, "uplink")
    parts = {"queuing": alone - slot, "segmentation": sent - alone, "retransmission": whole - core - sent}
    return parts | {"link": whole - (alone - slot), "all": whole}


# KTH's private 5G, of which only the one-way delays are known.
PATTERNS = ("B", "DSU", "DDSU", "DDDSU", "DDSUU", "DDDDDDDSUU", "DDDDDSUUUU", "DDSUUUUUUU")
HISTOGRAMS = {"uplink": "s1_wall.xml", "downlink": "s10-DL_wall.xml"}


def kth(way: str) -> Compared:
    """Frame, access and HARQ are chosen, and a constant."""
    path = DATA / "kth-5g-owd-histograms" / HISTOGRAMS[way]
    law = read_histogram(path)
    rng = np.random.default_rng(0)  # a histogram has lost the order in time: halves at random
    halves = [1e3 * law.quantile(rng.random(law_count(path) // 2)) for _ in range(2)]
    setting = best_setting(way, halves[0])
    return Compared(f"KTH 5G {way}", "all", setting.describe(), *halves, simulated(setting, way))


def law_count(path: Path) -> int:
    """Messages that a histogram holds."""
    return int(pd.read_xml(path, parser="etree")["bin"].sum())


def best_setting(way: str, measured: np.ndarray) -> Setting:
    """The setting whose quantiles are nearest to those measured (ms)."""
    wanted = quantiles(measured, CHOSEN_ON)
    periods = (0.0, 1.0, 2.5, 5.0) if way == "uplink" else (0.0,)
    again = np.random.default_rng(1).random(MESSAGES)
    best, least = None, np.inf
    for pattern, slot, period in itertools.product(PATTERNS, (0.5e-3, 1e-3), periods):
        frame, access = Frame(pattern, slot), Access(period / 1e3)
        once = simulated(Setting(frame, access), way)
        for bler, rtt in [(0.0, 0.0), *itertools.product((0.02, 0.05, 0.1, 0.15, 0.2), (2.5, 4.0, 5.0, 7.5, 10.0))]:
            # Nothing waits for a repetition on an empty cell, so each is one more period.
            repetitions = np.floor(np.log(again) / np.log(bler)) if bler else 0.0
            found = quantiles(once + rtt * repetitions, CHOSEN_ON)
            core = wanted[1] - found[1]
            error = np.abs(found + core - wanted).mean()
            if core >= 0.0 and error < least:
                best, least = Setting(frame, access, bler, rtt / 1e3, core / 1e3), error
    return best


def draw(compared: list[Compared]) -> Figure:
    """Distributions: measured, the half that judges, and simulated."""
    with paper_style():
        figure = Figure(figsize=(DOUBLE_COLUMN, 3.6), layout="constrained")
        for axes, each in zip(figure.subplots(2, 4).flat, compared, strict=False):
            for values, colour, name in ((each.judged, "0.2", "measured"), (each.model, OKABE_ITO[1], "simulated")):
                arrived = np.sort(values[np.isfinite(values)])
                thin = arrived[np.linspace(0, arrived.size - 1, 2000).astype(int)]
                axes.plot(thin, np.linspace(0, 1, thin.size), color=colour, label=name, drawstyle="steps-post")
                axes.plot(quantiles(values, QUANTILES), QUANTILES, ".", color=colour, markersize=4)
            axes.set_title(f"{each.data}: {each.quantity}", fontsize=7)
            axes.set_xlim(0, max(1.3 * quantiles(each.judged, (0.99,))[0], 1.0))
            axes.set_ylim(0, 1.02)
        for axes in figure.axes[len(compared) :]:
            axes.axis("off")
        figure.axes[0].legend(loc="lower right")
        figure.supxlabel("delay (ms)", fontsize=8)
        figure.supylabel("share of messages", fontsize=8)
    return figure


def main() -> None:
    """Compares what is there."""
    compared = []
    for folder, make in (("oai-5g-uplink", oai), ("kth-5g-owd-histograms", lambda: [kth(way) for way in HISTOGRAMS])):
        if (DATA / folder).is_dir():
            compared += make()
        else:
            print(f"left out: no {folder} in {DATA}")
    if not compared:
        print("nothing to compare: QOCJAX_DATA names the folder of the measured data")
        return
    table = pd.DataFrame([row for each in compared for row in each.rows()])
    RESULTS.parent.mkdir(exist_ok=True)
    table.round(4).to_csv(RESULTS.with_suffix(".csv"), index=False)
    _, pdf = save(draw(compared), RESULTS)
    pdf.unlink()
    print(table.drop(columns="setting").round(2).to_string(index=False))
    print("\n".join(table.groupby("data", sort=False)["setting"].first()))


if __name__ == "__main__":
    main()
