"""`python -m qocjax.tune`: tuning by gradients, from a configuration to tables and figures."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from qocjax.commands.command_line import output_dir
from qocjax.commands.resuming import going_on, note, resumed
from qocjax.config import load
from qocjax.config.scale import yardstick
from qocjax.config.tune import TuneConfig
from qocjax.figures.save import save
from qocjax.figures.tuning import tuning_map, tuning_progress
from qocjax.search.objective import Objective, pilot_scale
from qocjax.statistics.scales import scale_text
from qocjax.statistics.units import trace_remark
from qocjax.store import write_json, write_table
from qocjax.store.provenance import provenance
from qocjax.study.edges import bounds_text
from qocjax.study.problem import data_of
from qocjax.study.reliability import share_text
from qocjax.tuning import Slopes, Tuning, tune

__all__ = ["design_text", "landscape", "main", "run"]

_SCORES = ("qoc", "qoc_se", "qoc_whole_se")


def run(config: TuneConfig, folder: Path | None = None, *, quiet: bool = False) -> Tuning:
    """Runs the tuning of a configuration.

    Args:
        config: What to tune, and how.
        folder: Where pieces, tables, figures and the record go; None writes nothing.
        quiet: No progress bar (there is none anyway where standard error is no terminal).

    Raises:
        ValueError: A value of the configuration is out of range, derivatives are not finite, or the folder holds
            another tuning.
        OSError: The folder cannot be written, or the disk is full.
    """
    controller = config.build_controller()
    scenario, network, bounds = config.build_scenario(), config.build_network(), config.build_bounds()
    baseline, settings, deadlines = config.baseline_with(bounds.names), config.build_search(), config.deadlines()
    rules, (selection, evaluation) = config.loop.build(), config.seeds()
    if (remark := config.rate_remark(network, config.loop.tau)) is not None:
        note(remark)

    def progress(slopes: Slopes) -> None:
        best = int(slopes.qoc.argmax())
        bar.set_postfix_str(f"QoC {slopes.qoc[best]:.4f} ± {slopes.qoc_se[best]:.4f}", refresh=False)
        bar.update()

    with going_on(config, folder, data_of(scenario, network, controller)):
        scale = config.scale() or pilot_scale(
            scenario, network, baseline, deadlines.tolist(), selection, rules=rules, key=config.key,
            controller=controller,
        )  # fmt: skip
        objective = Objective(scenario, network, scale, rules, config.key, controller=controller)
        with tqdm(total=settings.steps, desc="tuning", unit=" steps", file=sys.stderr, disable=quiet or None) as bar:
            tuning = tune(
                objective, baseline, bounds, deadlines, settings,
                starts=config.tune.starts, from_baseline=config.tune.from_baseline,
                selection_seeds=selection, evaluation_seeds=evaluation, progress=progress,
            )  # fmt: skip
        if folder is not None:
            _write(tuning, config, folder)
            if config.figures:
                _draw(tuning, config, folder / "figures")
    return tuning


def landscape(tuning: Tuning, deadlines: np.ndarray, side: int, seeds: range) -> pd.DataFrame:
    """QoC on a grid of side x side values of kappa and gamma between their bounds, at each of the deadlines (s).

    Both must be tuned; whatever else is tuned is held at Co-design's value.
    """
    problem, bounds = tuning.problem, tuning.problem.bounds
    ends = dict(zip(bounds.names, zip(bounds.low, bounds.high, strict=True), strict=True))
    axes = [np.geomspace(low, high, side) if low > 0 else np.linspace(low, high, side)
            for low, high in (ends["kappa"], ends["gamma"])]  # fmt: skip
    kappa, gamma, deadline = (a.ravel() for a in np.meshgrid(*axes, deadlines, indexing="ij"))
    points = {name: float(tuning.chosen[name]) for name in bounds.names} | {"kappa": kappa, "gamma": gamma}
    scores = problem.objective.scores(problem.baseline.having(points | {"deadline": deadline}), seeds)
    return pd.DataFrame({"deadline": deadline, "kappa": kappa, "gamma": gamma, "qoc": scores.mean(axis=1)})


def design_text(tuning: Tuning) -> str:
    """The best start at each deadline, for a terminal."""
    table = tuning.designs
    best = table.loc[table.groupby("deadline")["qoc_selection"].idxmax()]
    shown = {
        "Δ (ms)": (best["deadline"] * 1e3).map("{:g}".format),
        "F(Δ)": [*map(share_text, best["reliability"], best["reliability_se"])],
    }
    shown |= {name: best[name].map("{:.3g}".format) for name in tuning.problem.bounds.names}
    shown["QoC ± SE (J_med's)"] = [f"{r.qoc:.4f} ± {r.qoc_se:.4f} ({r.qoc_whole_se:.4f})"
                                        for r in best.itertuples()]  # fmt: skip
    shown["gain over the baseline [95 %]"] = [
        f"{row.gain:+.4f} [{row.gain_low:+.4f}, {row.gain_high:+.4f}]" for row in best.itertuples()
    ]
    shown[""] = ["Co-design" if row.chosen else "tied" if row.tied else "better here" if row.better else ""
                 for row in best.itertuples()]  # fmt: skip
    return pd.DataFrame(shown).to_string(index=False)


def _trace_text(tuning: Tuning) -> str | None:
    """What a measured trace is too short to say of the chosen deadline."""
    setting, tau = tuning.problem.objective, tuning.problem.baseline.tau
    return trace_remark(setting.network, tuning.chosen["deadline"], setting.scenario.horizon, tau)


def _write(tuning: Tuning, config: TuneConfig, folder: Path) -> None:
    write_table(folder / "designs", tuning.designs)
    write_table(folder / "trace", tuning.trace)
    objective, chosen = tuning.problem.objective, tuning.chosen
    selection, evaluation = config.seeds()
    record = {
        "j_med": objective.scale.median,
        "j_max": objective.scale.largest,
        "j_med_se": objective.scale.median_se,
        "yardstick": yardstick(objective.scenario),
        "chosen": {name: float(chosen[name]) for name in ("deadline", *tuning.problem.bounds.names, *_SCORES)},
        "at_edge": chosen["at_edge"],
        "simulations": tuning.simulations,
        "dropped_derivatives": tuning.dropped,
        "stopped_early": tuning.stopped_early,
        "seeds": {"selection": [selection.start, selection.stop], "evaluation": [evaluation.start, evaluation.stop]},
        "key": config.key,
        "network": objective.network.describe(),
    }
    write_json(folder / "record.json", record | provenance(objective.controller))


def _draw(tuning: Tuning, config: TuneConfig, folder: Path) -> None:
    """Progress; and the map of kappa and gamma at Co-design's deadline where both are tuned."""
    save(tuning_progress(tuning.trace), folder / "progress")
    if {"kappa", "gamma"} <= set(tuning.problem.bounds.names):
        at = np.array([tuning.chosen["deadline"]])
        found = landscape(tuning, at, config.tune.landscape, config.seeds()[0])
        save(tuning_map(found, tuning.trace, tuning.designs), folder / "map")


def main(cfg: DictConfig) -> None:
    """Command line."""
    folder = output_dir()
    config = resumed(load(TuneConfig, cfg), folder)
    tuning = run(config, folder)
    print(design_text(tuning))
    scale, spent = tuning.problem.objective.scale, tuning.simulations
    print(f"\n{scale_text(scale, 'given' if config.scale() else 'of the baseline over the deadline axis', True)}")
    print(f"{spent['search']} simulations to search, {spent['selection']} to choose, {spent['evaluation']} to judge.")
    if text := _trace_text(tuning):
        print(f"note: {text}")
    if text := bounds_text(tuning.chosen["at_edge"]):
        print(text)
    if tuning.stopped_early:
        print(f"Stopped after {tuning.trace['step'].max() + 1} of {config.tune.steps} steps: QoC had stopped growing.")
    if tuning.dropped:
        print(f"{tuning.dropped} derivatives of single runs were not finite and left out.")
    print(f"Tables, figures and the record are in {folder}")
