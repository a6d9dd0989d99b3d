"""The QoC scale of the paper's scenario, once for all: J_med over the study of its six sweeps, on many seeds.

    python experiments/scale.py [seeds]

Writes qocjax/config/scales/paper.yaml, which `sweep.scale=paper` reads, so that QoC of two studies of the paper's
scenario can be compared. J_max is the AUC of robots that never move. A minute on two cores with 512 seeds.
"""

from __future__ import annotations

import sys
from pathlib import Path

import yaml
from hydra import compose, initialize_config_dir

from qocjax._xla import request_whole_loop
from qocjax.config import StudyConfig, conf_dir, load
from qocjax.config.scale import yardstick
from qocjax.statistics.scales import scale_of_runs

FIRST_SEED = 1_000_000  # far from the seeds of the studies


def main() -> None:
    """Computes and writes."""
    request_whole_loop()
    from qocjax import evaluate

    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 512
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        problem = load(StudyConfig, compose("sweep")).build_problem()
    runs = evaluate(problem.scenario, problem.designs, problem.network, range(FIRST_SEED, FIRST_SEED + seeds),
                    rules=problem.rules, key=problem.key)  # fmt: skip
    scale = scale_of_runs(runs["auc"].values, problem.scenario)
    found = {"j_med": float(f"{scale.median:.4g}"), "j_max": float(f"{scale.largest:.6g}")}
    about = (
        f"# QoC scale of the paper's scenario: J_med over its six sweeps, {seeds} seeds ({scale.median:.5g} ± "
        f"{scale.median_se:.2g} s), made by\n# python experiments/scale.py; J_max of robots that never move (s)\n"
    )
    path = Path(__file__).resolve().parents[1] / "qocjax" / "config" / "scales" / "paper.yaml"
    path.write_text(about + yaml.safe_dump(found | {"yardstick": yardstick(problem.scenario)}, sort_keys=False))
    print(path.read_text())


if __name__ == "__main__":
    main()
