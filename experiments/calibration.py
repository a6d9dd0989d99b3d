"""Gains of the surrogate fitted to the navigation stack: over settings of the stack, judged on what was held out.

    python experiments/calibration.py measure [setting ...]   # E of the settings (all by default), 2 to 3 minutes each
    python experiments/calibration.py fit                     # fits, judges, writes tables and figures; 3 minutes

E is simulated once per setting and kept in experiments/results/calibration_runs.csv (a row per run), with what made it
in calibration_runs.json; a setting that is there already is not simulated again unless it is named. Half of the seeds
are for fits, the others for judging. One set of gains is fitted to each setting by itself, and one to all settings of
`FITTED` together; the latter is also judged on `HELD_OUT`, scenarios and settings that no fit has seen.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from qocjax import Design, paper_network
from qocjax._xla import request_whole_loop
from qocjax.config import conf_dir, load
from qocjax.config.validate import StackConfig, ValidateConfig
from qocjax.figures.save import save
from qocjax.figures.validation import calibration_figure
from qocjax.store import write_json
from qocjax.store.provenance import provenance
from qocjax.validation import Curve, Fit, Judged, Setting, fit, judge_gains, simulated_curve

RESULTS = Path(__file__).resolve().parent / "results"
RUNS = RESULTS / "calibration_runs"
DELAYS = np.array([120, 140, 160, 200, 250, 350, 500, 650, 800]) / 1e3  # s
# Fits begin here: at 120 ms the runs differ so much (a first command comes or does not) that its noise would rule.
FIRST = 0.14  # s
SEEDS = range(24)
FIT_SEEDS, JUDGE_SEEDS = range(0, 24, 2), range(1, 24, 2)
BUDGET = 768 + 12 * 600
KEY = 0


@dataclass(frozen=True)
class Case:
    """A scenario and a setting of the stack, as options of `qocjax.validate`."""

    options: tuple[str, ...] = ()
    shown: str = ""
    held_out: bool = False


def _apart(distance: float) -> str:
    return f"scenario.start=[[-2.0,{-distance / 2},0.3],[-2.0,{distance / 2},0.0]]"


_STACK = "measured.controller."
CASES = {
    "default": Case((), "default"),
    "close": Case((_apart(1.5),), "starts 1.5 m apart"),
    "wide_inflation": Case(
        (f"{_STACK}inflation.inflation_radius=0.9", f"{_STACK}inflation.cost_scaling_factor=3.0"),
        "inflation 0.9 m, 3 1/m",
    ),
    "heavy_cost": Case((f"{_STACK}mppi.critics.CostCritic.cost_weight=12.0",), "CostCritic 12"),
    "weak_path": Case(
        (f"{_STACK}mppi.critics.PathAlignCritic.cost_weight=4.0",
         f"{_STACK}mppi.critics.PathFollowCritic.cost_weight=5.0"),
        "PathAlign 4, PathFollow 5",
    ),
    "far": Case((_apart(4.2),), "starts 4.2 m apart", held_out=True),
    "close_wide_inflation": Case(
        (_apart(1.5), f"{_STACK}inflation.inflation_radius=0.9", f"{_STACK}inflation.cost_scaling_factor=3.0"),
        "1.5 m apart, inflation 0.9 m", held_out=True,
    ),
    "crossing": Case(("scenario=crossing",), "crossing", held_out=True),
}  # fmt: skip


def config_of(case: Case) -> ValidateConfig:
    """The configuration of a case, as the command composes it."""
    from hydra import compose, initialize_config_dir

    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return load(ValidateConfig, compose("validate", list(case.options)))


def measure(names: list[str]) -> None:
    """Simulates E of the settings, and keeps it."""
    for name in names:
        config = config_of(CASES[name])
        assert isinstance(config.measured, StackConfig)
        e = simulated_curve(
            config.build_scenario(), config.baseline(), config.build_network(), DELAYS, SEEDS,
            controller=config.controller_of(config.measured), rules=config.loop.build(), key=KEY, source=name,
        )  # fmt: skip
        rows = [{"setting": name, "delay": delay, "seed": seed, "auc": auc}
                for delay, each in zip(e.delays, e.values, strict=True)
                for seed, auc in zip(SEEDS, each, strict=True)]  # fmt: skip
        kept = pd.read_csv(RUNS.with_suffix(".csv")) if RUNS.with_suffix(".csv").exists() else pd.DataFrame()
        others = kept[kept["setting"] != name] if len(kept) else kept
        pd.concat([others, pd.DataFrame(rows)], ignore_index=True).to_csv(
            RUNS.with_suffix(".csv"), index=False, float_format="%.7g"
        )
        made: dict[str, Any] = (
            json.loads(RUNS.with_suffix(".json").read_text()) if RUNS.with_suffix(".json").exists() else {}
        )
        made[name] = {
            "options": list(CASES[name].options), "controller": config.measured.controller.model_dump(),
            "scenario": config.scenario.model_dump(), "key": KEY, **provenance(),
        }  # fmt: skip
        write_json(RUNS.with_suffix(".json"), made)
        print(f"{name}: AUC {', '.join(f'{value:.3g}' for value in e.mean)} s", flush=True)


def known() -> dict[str, Curve]:
    """E of the settings that were simulated."""
    if not RUNS.with_suffix(".csv").exists():
        return {}
    table = pd.read_csv(RUNS.with_suffix(".csv"))
    table = table[table["delay"] >= FIRST - 1e-9]
    found = {}
    for name, rows in table.groupby("setting", sort=False):
        auc = rows.pivot(index="delay", columns="seed", values="auc")
        found[str(name)] = Curve.of_table(
            auc.index.to_numpy(), auc.to_numpy(), [int(s) for s in auc.columns], str(name)
        )
    return found


@dataclass
class Report:
    """Rows of the tables."""

    gains: list[dict[str, Any]] = field(default_factory=list)
    scores: list[dict[str, Any]] = field(default_factory=list)
    curves: list[pd.DataFrame] = field(default_factory=list)

    def add(self, kind: str, name: str, fitted: Fit, judged: Judged) -> None:
        """One fit judged in one setting."""
        row = {"fit": kind, "held_out": CASES[name].held_out} | judged.row()
        self.scores.append(row | {f"gain_{key}": value for key, value in fitted.gains.items()})
        self.curves.append(judged.curve.assign(fit=kind))


def fit_all() -> None:
    """Fits each setting by itself and all together, and judges both."""
    curves = known()
    if missing := [name for name in CASES if name not in curves]:
        raise SystemExit(f"no runs of {', '.join(missing)}: python experiments/calibration.py measure")
    network, baseline = paper_network(), config_of(CASES["default"]).baseline()
    scenarios = {name: config_of(case).build_scenario() for name, case in CASES.items()}
    report = Report()

    def setting(name: str, seeds: range) -> Setting:
        return Setting(CASES[name].shown, scenarios[name], curves[name].of_seeds(list(seeds)))

    def judged(name: str, design: Design) -> Judged:
        return judge_gains(setting(name, JUDGE_SEEDS), baseline, design, network, JUDGE_SEEDS, key=KEY)

    fitted = [setting(name, FIT_SEEDS) for name, case in CASES.items() if not case.held_out]
    joint = fit(fitted, baseline, network, budget=BUDGET, key=KEY)
    print(
        "joint:", {name: round(value, 3) for name, value in joint.gains.items()}, f"RMSE {joint.rmse:.2f}", flush=True
    )
    for name in CASES:
        report.add("joint", name, joint, judged(name, joint.design))
        own = fit([setting(name, FIT_SEEDS)], baseline, network, budget=BUDGET, key=KEY)
        report.add("own", name, own, judged(name, own.design))
        print(name, {each: round(value, 3) for each, value in own.gains.items()}, f"RMSE {own.rmse:.2f}", flush=True)
    write(report)


def write(report: Report) -> None:
    """Tables and figures."""
    scores, curve = pd.DataFrame(report.scores), pd.concat(report.curves, ignore_index=True)
    scores.to_csv(RESULTS / "calibration.csv", index=False, float_format="%.4g")
    curve.to_csv(RESULTS / "calibration_curve.csv", index=False, float_format="%.5g")
    for kind in ("joint", "own"):
        (path, _) = save(
            calibration_figure(curve[curve["fit"] == kind].drop(columns="fit")), RESULTS / f"calibration_{kind}"
        )
        path.with_suffix(".pdf").unlink()
    print(
        scores[["fit", "setting", "rmse_before", "rmse_after", "gain", "gain_low", "gain_high"]].to_string(index=False)
    )


def main(arguments: list[str]) -> None:
    """Command line."""
    request_whole_loop()
    if arguments[:1] == ["measure"]:
        names = arguments[1:] or [name for name in CASES if name not in known()]
        if unknown := [name for name in names if name not in CASES]:
            raise SystemExit(f"settings: got {unknown[0]}, expected some of {', '.join(CASES)}")
        measure(names)
    elif arguments == ["fit"]:
        fit_all()
    else:
        raise SystemExit(__doc__)


if __name__ == "__main__":
    main(sys.argv[1:])
