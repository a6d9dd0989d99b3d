"""What limits on acceleration cost, paired on the same seeds: python experiments/acceleration.py

The paper's robots obey a command at once. Here they take time, and the deadline that keeps them apart moves. Ten
seconds on two cores.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from qocjax import Acceleration, Design, Scenario, Unicycle, evaluate, paper_network
from qocjax.statistics.estimates import estimate, share

RESULTS = Path(__file__).parent / "results"
SEEDS = range(256)
DEADLINES = np.array([0.15, 0.2, 0.225, 0.25, 0.3, 0.4, 0.5])
ROBOTS = {
    "at once": None,
    "TurtleBot 3 Burger's": Acceleration(3.0, -2.5, 3.2),
    "1 m/s2, 1.5 rad/s2": Acceleration(1.0, -1.0, 1.5),
    "0.5 m/s2, 1 rad/s2": Acceleration(0.5, -0.5, 1.0),
}


def main() -> None:
    """All robots at all deadlines."""
    rows, first = [], None
    for name, limits in ROBOTS.items():
        runs = evaluate(Scenario(robot=Unicycle(limits)), Design(deadline=DEADLINES), paper_network(), SEEDS)
        auc = runs["auc"].values.mean(axis=2)
        first = auc if first is None else first
        for deadline, values, free, hits in zip(DEADLINES, auc, first, runs["collided"].values, strict=True):
            mean, more, close = estimate(values), estimate(values - free), share(hits)
            rows.append({
                "robot": name, "deadline_ms": round(1e3 * float(deadline)), "auc": mean.mean, "auc_se": mean.se,
                "more": more.mean, "more_low": more.low, "more_high": more.high, "collided": close.mean,
                "collided_low": close.low, "collided_high": close.high,
            })  # fmt: skip
    table = pd.DataFrame(rows)
    table.to_csv(RESULTS / "acceleration.csv", index=False, float_format="%.4g")
    print(table.pivot(index="robot", columns="deadline_ms", values=["auc", "more", "collided"]).round(3).T.to_string())


if __name__ == "__main__":
    main()
