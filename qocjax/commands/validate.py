"""`python -m qocjax.validate`: the surrogate law held against measured runs, to tables and figures."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from qocjax.commands.command_line import output_dir
from qocjax.commands.recordings import read_runs
from qocjax.commands.resuming import going_on, resumed
from qocjax.commands.validation_page import page
from qocjax.config import load
from qocjax.config.bounds import built_bounds
from qocjax.config.validate import CsvConfig, RecordedConfig, Simulated, ValidateConfig
from qocjax.figures.save import save
from qocjax.figures.validation import calibration_figure, validation_figure
from qocjax.network.interface import Network
from qocjax.recorded import find_runs
from qocjax.scenario import num_ticks
from qocjax.statistics.units import trace_remark
from qocjax.store import write_json, write_table
from qocjax.store.provenance import provenance
from qocjax.study.problem import data_of
from qocjax.study.reliability import load_of
from qocjax.validation import (
    Curve,
    Fit,
    Judged,
    Setting,
    Validation,
    compare,
    curve_of_runs,
    fit,
    halves,
    judge_gains,
    run_points,
    simulated_curve,
)

__all__ = ["Outcome", "main", "report", "run"]


@dataclass(frozen=True)
class Outcome:
    """What a validation came to."""

    validation: Validation
    points: pd.DataFrame | None  # recorded runs, and which of them count
    fit: Fit | None
    judged: Judged | None  # on what the fit has not seen


def run(config: ValidateConfig, folder: Path | None = None, *, quiet: bool = False) -> Outcome:
    """Runs the validation of a configuration.

    Args:
        config: What to compare.
        folder: Where pieces, tables, figures and the record go; None writes nothing.
        quiet: No progress bars (there are none anyway where standard error is no terminal).

    Raises:
        ValueError: A value of the configuration is out of range, a file cannot be read, curves cannot be compared, or
            the folder holds another validation.
        OSError: The folder cannot be written, or the disk is full.
    """
    if config.controller.law != "apf":
        raise ValueError(f"controller: got {config.controller.law}, expected apf, which is S; E is given by `measured`")
    network = config.build_network()
    with going_on(config, folder, _data(config, network)):
        outcome = _validated(config, network, quiet)
        if folder is not None:
            _write(outcome, config, network, folder)
            if config.figures:
                _draw(outcome, folder / "figures")
    return outcome


def _data(config: ValidateConfig, network: Network) -> str:
    """Digest of what lies behind the options of what is simulated; measured files are read each time."""
    source = config.measured
    law = None if isinstance(source, CsvConfig | RecordedConfig) else config.controller_of(source)
    return data_of(config.build_scenario(), network, law)


def _validated(config: ValidateConfig, network: Network, quiet: bool) -> Outcome:
    """S and E, what they say of each other, and gains that follow E."""
    measured, points = _measured(config, network, quiet)
    simulated = _simulate(config, network, measured.delays, None, "surrogate", quiet)
    options, load = config.validation, load_of(config.build_scenario(), config.loop.tau)
    completing = partial(network.reliability, load=load)
    found = compare(simulated, measured, completing, resamples=options.resamples, random=config.key % 2**32,
                    share=options.regime_share)  # fmt: skip
    fitted, judged = _calibrate(config, network, found.measured, quiet) if config.calibrate else (None, None)
    return Outcome(found, points, fitted, judged)


def _measured(config: ValidateConfig, network: Network, quiet: bool) -> tuple[Curve, pd.DataFrame | None]:
    """E, and for recorded runs the point of each."""
    source, delays = config.measured, config.delays()
    if isinstance(source, CsvConfig):
        return _only(source.read(), delays), None
    if isinstance(source, RecordedConfig):
        points = _recorded_points(config, source, delays, quiet)
        return curve_of_runs(points, source.path), points
    assert delays is not None  # as `delays` says
    return _simulate(config, network, delays, source, source.kind, quiet), None


def _only(curve: Curve, delays: np.ndarray | None) -> Curve:
    """The delays of a measured curve that are asked for."""
    if delays is None:
        return curve
    rows = np.flatnonzero(np.abs(curve.delays[:, None] - delays[None, :]).min(axis=1) <= 1e-6)
    if not rows.size:
        shown = ", ".join(f"{1e3 * delay:g}" for delay in curve.delays)
        raise ValueError(f"validation.delay_ms: got none of the delays of {curve.source} ({shown} ms), expected some, "
                         "or null for all")  # fmt: skip
    return curve.at(rows)


def _recorded_points(
    config: ValidateConfig, source: RecordedConfig, delays: np.ndarray | None, quiet: bool
) -> pd.DataFrame:
    rules, labels, grouping = source.rules(config.robot.radius), source.labels.build(), source.grouping(delays)
    files = find_runs(source.place(), rules.stamps, rules.poses, rules.kind)
    labels.check([each.name for each in files])
    found, failed = read_runs(files, rules, quiet)
    points = run_points(found, [labels(each.name) for each in found], grouping)
    left_out = pd.DataFrame([{"run": name, "left_out": why} for name, why in failed.items()])
    return pd.concat([points, left_out], ignore_index=True) if failed else points


def _simulate(
    config: ValidateConfig, network: Network, delays: np.ndarray, source: Simulated | None, name: str, quiet: bool
) -> Curve:
    """A curve of the simulator: S without a source, else E."""
    scenario, seeds = config.build_scenario(), config.seeds()
    total = num_ticks(scenario.horizon, config.loop.tau) * scenario.num_robots * len(seeds) * len(delays)
    bar = tqdm(total=total, desc=f"simulating {name}", unit=" robot-steps", unit_scale=True, file=sys.stderr,
               disable=True if quiet else None)  # fmt: skip

    def advance(steps: int) -> None:
        bar.update(min(steps, bar.total - bar.n))

    with bar:
        design, controller = config.baseline(), None
        if source is not None:
            design, controller = config.design_of(source), config.controller_of(source)
        return simulated_curve(scenario, design, network, delays, seeds, controller=controller,
                               rules=config.loop.build(), key=config.key, source=name, progress=advance)  # fmt: skip


def _calibrate(config: ValidateConfig, network: Network, measured: Curve, quiet: bool) -> tuple[Fit, Judged]:
    """Gains fitted to every other measured run, judged on the others and on seeds that the fit has not seen."""
    options, scenario = config.calibrate, config.build_scenario()
    assert options is not None
    known, held_out = halves(measured)
    common = {"rules": config.loop.build(), "key": config.key}
    bounds = built_bounds("calibrate.bounds", options.bounds, config, limited=False)
    if not quiet:
        print("fitting gains", file=sys.stderr)
    fitted = fit([Setting("E", scenario, known)], config.baseline(), network, bounds, method=options.method,
                 budget=options.budget, **common)  # type: ignore[arg-type]  # fmt: skip
    seeds = list(held_out.seeds) if held_out.seeds is not None else list(config.seeds())
    judged = judge_gains(Setting("held out", scenario, held_out), config.baseline(), fitted.design, network, seeds,
                         resamples=config.validation.resamples, random=config.key % 2**32, **common)  # type: ignore[arg-type]  # fmt: skip
    return fitted, judged


def _write(outcome: Outcome, config: ValidateConfig, network: Network, folder: Path) -> None:
    found = outcome.validation
    tables = {"curve": found.curve, "agreement": found.agreement_table, "regimes": found.regime_table}
    tables |= {"simulated": _runs(found.simulated), "measured": _runs(found.measured)}
    if outcome.points is not None:
        tables["points"] = outcome.points
    if outcome.judged is not None:
        tables |= {"calibration": pd.DataFrame([outcome.judged.row()]), "calibration_curve": outcome.judged.curve}
    for name, table in tables.items():
        write_table(folder / name, table)
    fitted = outcome.fit
    record = {
        "seeds": {"simulated": list(found.simulated.seeds or ()), "measured": list(found.measured.seeds or ())},
        "paired": found.agreement.paired,
        "key": config.key,
        "network": network.describe(),
        "fit": None if fitted is None else {"gains": fitted.gains, "method": fitted.method, "looks": fitted.looks},
    }
    write_json(folder / "record.json", record | provenance())


def _draw(outcome: Outcome, folder: Path) -> None:
    save(validation_figure(outcome.validation.curve, outcome.validation.regime_table), folder / "validation")
    if outcome.judged is not None:
        save(calibration_figure(outcome.judged.curve), folder / "calibration")


def _runs(curve: Curve) -> pd.DataFrame:
    """A row per run, as `measured=csv` reads it: delay (s), AUC (s), and the seed where there is one."""
    rows = [{"delay": delay, "auc": auc} | ({} if curve.seeds is None else {"seed": curve.seeds[k]})
            for delay, each in zip(curve.delays, curve.values, strict=True) for k, auc in enumerate(each)]  # fmt: skip
    return pd.DataFrame(rows)


def report(outcome: Outcome) -> str:
    """The validation as a few lines for a terminal."""
    return page(outcome.validation, outcome.points, outcome.fit, outcome.judged)


def main(cfg: DictConfig) -> None:
    """Command line."""
    folder = output_dir()
    config = resumed(load(ValidateConfig, cfg), folder)
    outcome = run(config, folder)
    print(report(outcome))
    network, delays = config.build_network(), outcome.validation.simulated.delays
    if text := trace_remark(network, delays, config.scenario.horizon, config.loop.tau):
        print(f"note: {text}")
    print(f"\nTables, figures and the record are in {folder}")
