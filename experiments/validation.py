"""The surrogate against the navigation stack in the paper's scenario, and how the verdict hangs on the first delay.

    python experiments/validation.py      # 4 minutes on one core

Runs `python -m qocjax.validate` with delays from 80 ms on, keeps its small tables in experiments/results, and compares
the same runs again with later first delays: the normalised scale is that of the delays that are looked at.
"""

from __future__ import annotations

import shutil
import tempfile
from functools import partial
from pathlib import Path

import pandas as pd
from hydra import compose, initialize_config_dir

from qocjax._xla import request_whole_loop
from qocjax.commands.validate import report, run
from qocjax.config import conf_dir, load
from qocjax.config.validate import ValidateConfig
from qocjax.study.reliability import load_of
from qocjax.validation import Validation, compare

RESULTS = Path(__file__).resolve().parent / "results"
OPTIONS = ["validation.delay_ms=[80,100,120,140,160,200,250,350,500,650,800]"]
FIRST = (0.08, 0.1, 0.12, 0.14, 0.16)  # s


def row(first: float, found: Validation) -> dict[str, float]:
    """Agreement and regimes of the delays from the first on."""
    values: dict[str, float] = {"first_delay": first}
    for item in found.agreement_table.itertuples():
        values |= {str(item.measure): item.value, f"{item.measure}_low": item.low, f"{item.measure}_high": item.high}
    for curve, regimes in found.regimes.items():
        for name in ("begins", "best", "rise"):
            each = getattr(regimes, name)
            values |= {
                f"{curve}_{name}": each.value,
                f"{curve}_{name}_low": each.low,
                f"{curve}_{name}_high": each.high,
            }
    return values


def main() -> None:
    """Runs, compares, writes."""
    request_whole_loop()
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        config = load(ValidateConfig, compose("validate", OPTIONS))
    with tempfile.TemporaryDirectory() as folder:
        outcome = run(config, Path(folder))
        for name in ("curve", "agreement", "regimes", "simulated", "measured"):
            table = pd.read_csv(Path(folder) / f"{name}.csv")
            table.to_csv(RESULTS / f"validation_{name}.csv", index=False, float_format="%.5g")
        shutil.copy(Path(folder) / "record.json", RESULTS / "validation.json")
        shutil.copy(Path(folder) / "figures" / "validation.png", RESULTS / "validation.png")
    print(report(outcome))
    found, network = outcome.validation, config.build_network()
    completing = partial(network.reliability, load=load_of(config.build_scenario(), config.loop.tau))
    rows = []
    for first in FIRST:
        kept = [k for k, delay in enumerate(found.simulated.delays) if delay >= first - 1e-9]
        s, e = found.simulated.at(kept), found.measured.at(kept)
        rows.append(row(first, compare(s, e, completing, resamples=config.validation.resamples)))
    table = pd.DataFrame(rows)
    table.to_csv(RESULTS / "validation_first_delay.csv", index=False, float_format="%.4g")
    print(table[["first_delay", "spearman", "kendall", "rmse", "rmse_log", "rmse_of_noise"]].to_string(index=False))


if __name__ == "__main__":
    main()
