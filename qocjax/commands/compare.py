"""`python -m qocjax.compare`: two or more studies on one QoC scale, as a table, a figure and a page."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from qocjax.commands.command_line import output_dir
from qocjax.commands.sweep_page import collisions_text
from qocjax.config.compare import CompareConfig
from qocjax.config.part import load
from qocjax.figures.compared import compared
from qocjax.figures.save import save
from qocjax.report import write_comparison_report
from qocjax.statistics.scales import scale_text
from qocjax.store import write_config, write_json, write_table
from qocjax.store.provenance import provenance
from qocjax.study.axes import value_words
from qocjax.study.comparison import Comparison, compare
from qocjax.study.opened import open_sweep

__all__ = ["comparison_text", "main", "run"]


def run(config: CompareConfig, folder: Path | None = None) -> Comparison:
    """Compares the studies of a configuration.

    Args:
        config: Which.
        folder: Where table, figure and page go; None writes nothing.

    Raises:
        ValueError: A folder holds no finished study, or the studies cannot be compared.
    """
    folders = config.build()
    found = compare({name: open_sweep(each) for name, each in folders.items()})
    if folder is not None:
        _write(found, config, folders, folder)
    return found


def _write(found: Comparison, config: CompareConfig, folders: dict[str, Path], folder: Path) -> None:
    write_table(folder / "comparison", found.table)
    write_table(folder / "curves", found.curves)
    write_config(folder, config.model_dump())
    record = {
        "j_med": found.scale.median,
        "j_med_se": found.scale.median_se,
        "j_max": found.scale.largest,
        "studies": {name: str(each.resolve()) for name, each in folders.items()},
        "notes": found.notes,
    }
    write_json(folder / "record.json", record | provenance())
    if config.figures:
        save(compared(found.table), folder / "figures" / "comparison")
    if config.report:
        write_comparison_report(folder / "report.html", found, {name: str(each) for name, each in folders.items()})


def comparison_text(table: pd.DataFrame) -> str:
    """The table for a terminal."""
    first = table["study"].iloc[0]
    shown = pd.DataFrame(
        {
            "sweep": table["sweep"],
            "policy": table["policy"],
            "study": table["study"],
            "value": [value_words(row) for row in table.to_dict("records")],
            "Δ (ms)": (table["deadline"] * 1e3).map("{:g}".format),
            "QoC ± SE (J_med's)": [f"{r.qoc:.4f} ± {r.qoc_se:.4f} ({r.qoc_whole_se:.4f})" for r in table.itertuples()],
            f"difference to {first} [95 %]": [_difference(row) for row in table.to_dict("records")],
            "collide [95 %]": [collisions_text(row) for row in table.itertuples()],
        }
    )
    order = {name: k for k, name in enumerate(dict.fromkeys(zip(table["sweep"], table["policy"], strict=True)))}
    place = np.argsort([order[key] for key in zip(table["sweep"], table["policy"], strict=True)], kind="stable")
    shown = shown.iloc[place]
    same = shown[["sweep", "policy"]].duplicated()
    shown["sweep"] = shown["sweep"].where(~shown["sweep"].duplicated(), "")
    shown["policy"] = shown["policy"].where(~same, "")
    return shown.to_string(index=False)


def _difference(row: dict) -> str:
    if np.isnan(row["difference"]):
        return ""
    text = f"{row['difference']:+.4f} [{row['difference_low']:+.4f}, {row['difference_high']:+.4f}]"
    return text if row["paired"] else f"{text} unpaired"


def main(cfg: DictConfig) -> None:
    """Command line."""
    config = load(CompareConfig, cfg)
    folder = output_dir()
    found = run(config, folder)
    print(comparison_text(found.table))
    print(f"\n{scale_text(found.scale, 'of all runs', True)}")
    for note in found.notes:
        print(f"note: {note}")
    print(f"Table, figure and report.html are in {folder}")
