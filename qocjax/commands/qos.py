"""`python -m qocjax.qos`: BEST_EFFORT against RELIABLE, from a configuration to tables and figures."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from qocjax.commands.command_line import output_dir
from qocjax.commands.resuming import going_on, resumed
from qocjax.config.part import load
from qocjax.config.qos import QosConfig
from qocjax.figures.qos import delay_figure, qoc_figure, win_map
from qocjax.figures.save import save
from qocjax.statistics.scales import scale_text
from qocjax.store import write_json, write_table
from qocjax.store.provenance import provenance
from qocjax.study.problem import data_of
from qocjax.transport.paper_gain import paper_gain_text
from qocjax.transport.qos import QosStudy, qos_study

__all__ = ["main", "run", "text"]


def run(config: QosConfig, folder: Path | None = None, *, quiet: bool = False) -> QosStudy:
    """Runs the study of a configuration.

    Args:
        config: What to simulate.
        folder: Where pieces, tables, figures and the record go; None writes nothing.
        quiet: No progress bar (there is none anyway where standard error is no terminal).

    Raises:
        ValueError: A value of the configuration is out of range, or the folder holds another study.
        OSError: The folder cannot be written, or the disk is full.
    """
    config.surrogate_only()
    options, shown = config.qos, config.shown()
    network, edge = config.build_topics()
    scenario, total = config.build_scenario(), len(options.profiles) * len(options.loss) * len(options.burst)

    def show(what: str) -> None:
        bar.set_postfix_str(what)
        bar.update()

    with going_on(config, folder, data_of(scenario, network, None)):
        with tqdm(total=total, desc="profiles x channels", file=sys.stderr, disable=True if quiet else None) as bar:
            study = qos_study(
                scenario, config.baseline(), network, config.profiles(),
                options.loss, options.burst, [ms / 1e3 for ms in options.deadline_ms], range(options.seeds),
                rules=config.loop.build(), key=config.key, scale=config.scale(), carrier=config.carrier.build(),
                edge=edge, progress=show,
            )  # fmt: skip
        if folder is not None:
            _write(study, config, folder)
            if config.figures:
                _draw(study, shown, folder / "figures")
    return study


def text(study: QosStudy, shown: tuple[float, float]) -> str:
    """The profiles on the channel shown, and where the best of them beats the first."""
    at = (study.best["loss"] == shown[0]) & (study.best["burst"] == shown[1])
    rows = study.best[at].merge(study.transport, on=["profile", "loss", "burst"])
    table = pd.DataFrame(
        {
            "profile": rows["profile"],
            "best Δ (ms)": [f"{1e3 * r.deadline:g}{'*' if r.at_edge else ''}" for r in rows.itertuples()],
            "QoC ± SE (J_med's)": [f"{r.qoc:.4f} ± {r.qoc_se:.4f} ({r.qoc_whole_se:.4f})"
                                        for r in rows.itertuples()],
            "difference [95 %]": [_interval(r) if k else "" for k, r in enumerate(rows.itertuples())],
            "lost": rows["lost"].map("{:.2%}".format),
            "p50/p95/p99 (ms)": [f"{_ms(r.p50)}/{_ms(r.p95)}/{_ms(r.p99)}" for r in rows.itertuples()],
            "age (ms)": rows["age_mean"].map(_ms),
            "kbit/s ± sd": [f"{r.kbit_s:.1f} ± {r.kbit_s_sd:.1f}" for r in rows.itertuples()],
            "PRB up/down": [f"{r.uplink_blocks:.2f}/{r.downlink_blocks:.2f}" for r in rows.itertuples()],
        }
    )  # fmt: skip
    names = list(dict.fromkeys(study.results["profile"]))
    first = names[0]
    return (
        f"At {shown[0]:.0%} of messages lost, {_kind(shown[1])}, each profile at its best deadline:\n"
        + table.to_string(index=False)
        + f"\n\nGain in QoC over {first} (* told from 0, all of a table together), each at its own best deadline:\n"
        + _gains(study.best, names)
        + "\n\nThe same with one deadline for both, that at which it gains most:\n"
        + _gains(study.most, names, at=True)
        + "\n\nDeadlines were chosen on every other seed and judged on the rest; * at one: an end of those tried."
    )


def _kind(burst: float) -> str:
    return "independently" if burst == 1 else f"in bursts of {burst:g}"


def _gains(table: pd.DataFrame, names: list[str], at: bool = False) -> str:
    """A row for each channel, a column for each profile but the first."""
    rows = table[table["profile"] != names[0]].copy()
    told = rows["difference_told"].ne(0).map({True: "*", False: " "})
    rows["cell"] = rows["gain_percent"].map("{:+.1f} %".format) + told
    if at:
        rows["cell"] += (1e3 * rows["deadline"]).map(" at {:g} ms".format)
    rows["lost"] = [f"{row.loss:.3g}, {_kind(row.burst)}" for row in rows.itertuples()]
    rows = rows.sort_values(["burst", "loss"], kind="stable")
    grid = rows.pivot(index="lost", columns="profile", values="cell")
    return grid.loc[list(dict.fromkeys(rows["lost"])), names[1:]].to_string()


def _interval(row: object) -> str:
    low, mean, high = (getattr(row, f"difference{end}") for end in ("_low", "", "_high"))
    return f"{mean:+.4f} [{low:+.4f}, {high:+.4f}]"


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.0f}" if np.isfinite(seconds) else "-"


def _write(study: QosStudy, config: QosConfig, folder: Path) -> None:
    for name in ("results", "transport", "best", "most"):
        write_table(folder / name, getattr(study, name))
    record = {
        "j_med": study.scale.median, "j_med_se": study.scale.median_se, "j_max": study.scale.largest,
        "seeds": [0, config.qos.seeds], "key": config.key,
        "network": config.build_network().describe(), "path": dict(study.cells[0].runs.attrs),
    }  # fmt: skip
    write_json(folder / "record.json", record | provenance())


def _draw(study: QosStudy, shown: tuple[float, float], folder: Path) -> None:
    save(qoc_figure(study.best, study.transport, *shown), folder / "qoc")
    times = {c.profile: c.loop_times for c in study.cells if (c.loss, c.burst) == shown}
    save(delay_figure(times, study.transport, study.results, study.best, *shown), folder / "delay")
    first = study.best["profile"].iloc[0]
    save(win_map(study.results[study.results["profile"] != first], first), folder / "map")


def main(cfg: DictConfig) -> None:
    """Command line."""
    folder = output_dir()
    config = resumed(load(QosConfig, cfg), folder)
    study = run(config, folder)
    print(text(study, config.shown()))
    if config.compares_best_effort():
        print(f"\n{paper_gain_text(study, config.loop.hold)}")
    scale = study.scale
    print(f"\n{scale_text(scale, 'given' if config.scale() else 'of this study', True)}")
    print(f"Tables, figures and the record are in {folder}")
