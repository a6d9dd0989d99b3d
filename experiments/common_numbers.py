"""What sampling periods have in common, by tick and by time: python experiments/common_numbers.py

A seed's loop number p draws the same random numbers at each sampling period, whenever it starts. The other way, numbers
that belong to an instant, is tried beside it. Ten seconds on two cores.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import jax
import numpy as np
import pandas as pd

from qocjax import Design, Network, Scenario, evaluate, paper_network
from qocjax.statistics.estimates import paired, standard_error

RESULTS = Path(__file__).parent / "results"
SEEDS = range(256)
TAUS = (0.005, 0.01, 0.02, 0.05)
DEADLINES = (0.1, 0.2)
FROM = 1  # of these sampling periods, the one that the others are compared with


@dataclass(frozen=True)
class ByTime:
    """A network of loops that do not know of each other, whose numbers belong to instants every 5 ms."""

    network: Network
    name: str = "by time"

    def draw(self, key: jax.Array, num_ticks: int, num_robots: int, tau: float) -> jax.Array:
        """Loop times [P, N] s."""
        step = round(tau / TAUS[0])
        return self.network.draw(key, num_ticks * step, num_robots, TAUS[0])[::step]


def main() -> None:
    """The error of the difference in AUC from one sampling period to another, with common numbers and without."""
    rows = []
    for common, network in (("tick", paper_network()), ("time", ByTime(paper_network()))):
        for deadline in DEADLINES:
            auc = evaluate(Scenario(), Design(tau=TAUS, deadline=deadline), network, SEEDS)["auc"].values.mean(axis=2)
            for tau, values in zip(TAUS, auc, strict=True):
                if tau == TAUS[FROM]:
                    continue
                apart = float(np.hypot(standard_error(values), standard_error(auc[FROM])))
                rows.append({
                    "common": common, "deadline_ms": round(1e3 * deadline), "tau_ms": round(1e3 * tau),
                    "correlation": np.corrcoef(values, auc[FROM])[0, 1], "difference": paired(values, auc[FROM]).mean,
                    "paired_se": paired(values, auc[FROM]).se, "independent_se": apart,
                })  # fmt: skip
    table = pd.DataFrame(rows)
    table.to_csv(RESULTS / "common_numbers.csv", index=False, float_format="%.3g")
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
