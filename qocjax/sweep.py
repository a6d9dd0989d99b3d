"""`python -m qocjax.sweep`: the paper's study from a configuration to tables and figures."""

from __future__ import annotations

import sys
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import fields
from pathlib import Path

import jax
import numpy as np
import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from qocjax._command import command, output_dir
from qocjax.config import StudyConfig, load
from qocjax.figures.beside import process_beside
from qocjax.figures.study import draw_study
from qocjax.network.interface import Network
from qocjax.scenario import Design, num_ticks
from qocjax.simulate import Run
from qocjax.store import provenance, write_config, write_json, write_table
from qocjax.study import Study, replay, run_study

__all__ = ["main", "policy_text", "run"]


def run(
    config: StudyConfig, folder: Path | None = None, *, quiet: bool = False, drawing: Executor | None = None
) -> Study:
    """Runs the study of a configuration.

    Args:
        config: What to simulate.
        folder: Where tables, figures and the record go; None writes nothing.
        quiet: No progress bar (there is none anyway where standard error is no terminal).
        drawing: A process that draws half of the figures, from `process_beside`.

    Raises:
        ValueError: A value of the configuration is out of range.
    """
    scenario, network, grid = config.build_scenario(), config.build_network(), config.build_grid()
    rules, scale = config.loop.build(), config.scale()
    selection, evaluation = config.seeds()
    ticks = sum(num_ticks(scenario.horizon, tau) for tau in np.asarray(grid.designs.tau))
    bar = tqdm(
        total=ticks * len(selection) * scenario.num_robots,
        desc="simulating", unit=" robot-steps", unit_scale=True, file=sys.stderr, disable=True if quiet else None,
    )  # fmt: skip
    with bar:
        study = run_study(
            scenario, grid, network, selection, evaluation,
            rules=rules, key=config.key, min_reliability=config.sweep.min_reliability, scale=scale,
            progress=lambda steps: bar.update(min(steps, bar.total - bar.n)),
        )  # fmt: skip
    if folder is not None:
        _write(study, config, network, folder)
        if config.figures:
            shown = jax.tree.map(np.asarray, representative_run(study, config, network))
            draw_study(study.results, study.policies, shown, folder / "figures", drawing)
    return study


def representative_run(study: Study, config: StudyConfig, network: Network) -> Run:
    """The baseline, at the deadline of its best QoC, on the evaluation seed whose AUC there is the median."""
    row = _baseline_row(study.results, config.baseline())
    design = Design(**{item.name: float(study.results.loc[row, item.name]) for item in fields(Design)})
    runs = study.runs.isel(design=_design_at(study, design))
    auc = runs["auc"].mean("robot").values
    seed = int(runs["seed"].values[np.argsort(auc)[len(auc) // 2]])
    rules = config.loop.build()
    return replay(config.build_scenario(), design, network, seed, rules=rules, key=config.key)


def _baseline_row(results: pd.DataFrame, baseline: Design) -> int:
    """Row of the best QoC among those that hold the baseline; the best of all where no grid holds it."""
    names = [item.name for item in fields(Design) if item.name != "deadline"]
    held = np.all([np.isclose(results[name], getattr(baseline, name)) for name in names], axis=0)
    rows = results[held] if held.any() else results
    return int(rows["qoc"].idxmax())


def _design_at(study: Study, design: Design) -> int:
    same = [np.isclose(study.runs[item.name].values, getattr(design, item.name)) for item in fields(Design)]
    return int(np.flatnonzero(np.all(same, axis=0))[0])


def policy_text(policies: pd.DataFrame) -> str:
    """The policies' table for a terminal."""
    table = pd.DataFrame(
        {
            "sweep": policies["sweep"],
            "policy": policies["policy"],
            "value": policies["value"].map("{:g}".format),
            "Δ (ms)": (policies["deadline"] * 1e3).map("{:g}".format),
            "F(Δ)": policies["reliability"].map("{:.3f}".format),
            "QoC ± SE": [f"{q:.4f} ± {se:.4f}" for q, se in zip(policies["qoc"], policies["qoc_se"], strict=True)],
            "difference to Co-design [95 %]": [
                "" if row.policy == "Co-design"
                else f"{row.difference:+.4f} [{row.difference_low:+.4f}, {row.difference_high:+.4f}]"
                for row in policies.itertuples()
            ],
        }
    )  # fmt: skip
    table["sweep"] = table["sweep"].where(~table["sweep"].duplicated(), "")
    return table.to_string(index=False)


def _write(study: Study, config: StudyConfig, network: Network, folder: Path) -> None:
    write_table(folder / "results", study.results)
    write_table(folder / "policies", study.policies)
    write_config(folder, config.model_dump())
    selection, evaluation = config.seeds()
    record = {
        "j_med": study.scale.median,
        "j_max": study.scale.largest,
        "seeds": {"selection": [selection.start, selection.stop], "evaluation": [evaluation.start, evaluation.stop]},
        "key": config.key,
        "network": network.describe(),
        "path": dict(study.runs.attrs),
    }
    write_json(folder / "record.json", record | provenance())


@command("sweep")
def main(cfg: DictConfig) -> None:
    """Command line."""
    config = load(StudyConfig, cfg)
    folder = output_dir()
    with process_beside() if config.figures else nullcontext() as drawing:
        study = run(config, folder, drawing=drawing)
    print(policy_text(study.policies))
    scale = study.scale
    print(f"\nQoC is relative to J_med = {scale.median:.4g} s and J_max = {scale.largest:.4g} s of this study.")
    print(f"Tables, figures and the record are in {folder}")


if __name__ == "__main__":
    main()
