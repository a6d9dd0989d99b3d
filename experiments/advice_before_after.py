"""Advice by the mean and advice that stands up to changes, on fresh seeds: python experiments/advice_before_after.py

`results/advice_before.csv` holds what `advise` recommended when it looked at the mean QoC alone, and took a share of
collisions for what it was on 128 seeds; `results/advice/` what it recommends now. Both are simulated on seeds that
neither has seen, on each network as it is and after each change. A minute on two cores; reads the measured networks.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from advise_all import DATA, RESULTS, cases
from hydra import compose, initialize_config_dir

from qocjax import Design, QocScale
from qocjax.advice.stress import on_network, worse
from qocjax.config import conf_dir, load
from qocjax.config.advise import AdviseConfig
from qocjax.search import stacked
from qocjax.search.objective import Objective

SEEDS = range(100_000, 100_512)
BEFORE = RESULTS.parent / "advice_before.csv"


def before(row: pd.Series, tau: float) -> Design:
    """The design that was advised."""
    gains = {name: float(row[name]) for name in ("kappa", "gamma", "eta", "c_miss", "v_max")}
    return Design(**gains, tau=tau, deadline=float(row["deadline_ms"]) / 1e3)


def rows_of(name: str, options: list[str], old: pd.Series) -> list[dict]:
    """Both designs on a network and its changes."""
    advice = yaml.safe_load((RESULTS / f"{name}.yaml").read_text(encoding="utf-8"))
    with initialize_config_dir(str(conf_dir().resolve()), version_base="1.3"):
        config = load(AdviseConfig, compose("advise", options))
    scale = QocScale(advice["j_med"], advice["j_max"])
    objective = Objective(config.build_scenario(), config.build_network(), scale, config.loop.build(), config.key)
    now = Design(**advice["recommended"])
    designs = stacked([before(old, float(np.asarray(now.tau))), now])
    found = []
    for what, network in {"as it is": objective.network, **worse(objective, float(np.asarray(now.tau)))}.items():
        runs, scores = on_network(objective, network, designs, SEEDS)
        gap, close = (scores[1] - scores[0]).mean().given, runs["collided"].values.mean(axis=1)
        found.append({
            "network": name, "what": what, "before_ms": old["deadline_ms"], "now_ms": 1e3 * float(now.deadline),
            "before": scores.values[0].mean(), "now": scores.values[1].mean(), "difference": gap.mean,
            "difference_low": gap.low, "difference_high": gap.high, "before_collisions": close[0],
            "now_collisions": close[1], "verdict": advice["verdict"],
        })  # fmt: skip
    return found


def main() -> None:
    """All networks."""
    if not DATA.is_dir():
        sys.exit(f"no measured data at {DATA}")
    old = pd.read_csv(BEFORE).set_index("network", drop=False)
    with tempfile.TemporaryDirectory() as folder:
        rows = [row for name, options in cases(Path(folder)).items() for row in rows_of(name, options(), old.loc[name])]
    table = pd.DataFrame(rows)
    table.to_csv(RESULTS.parent / "advice_before_after.csv", index=False, float_format="%.4g")
    changed = table[table["what"] != "as it is"].groupby("network", sort=False)[["before", "now"]].min()
    plain = table[table["what"] == "as it is"].set_index("network")
    columns = ["before_ms", "now_ms", "before", "now", "difference", "before_collisions", "now_collisions", "verdict"]
    print(plain[columns].join(changed.add_prefix("worst_")).to_string(float_format="%.4g"))


if __name__ == "__main__":
    main()
