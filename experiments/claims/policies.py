"""What the paper says of Co-design, MinDelay and MaxRel (section V), in each of the six sweeps."""

from __future__ import annotations

import numpy as np

from experiments.claims import COLLISIONS, LEAST, LEAST_QOC, LEAST_TIME
from experiments.settings import GRIDS, Bench
from experiments.verdicts import Finding, Part, ratio


def _beaten(bench: Bench, policy: str) -> list[Part]:
    """QoC of Co-design less that of another policy."""
    return [
        Part(f"Co-design less {policy}, sweep of {sweep}",
             bench.reached("qoc", sweep, "Co-design") - bench.reached("qoc", sweep, policy), "QoC", LEAST_QOC)
        for sweep in GRIDS
    ]  # fmt: skip


def _deadlines(bench: Bench) -> str:
    said = []
    for policy in ("Co-design", "MinDelay", "MaxRel"):
        found = sorted({1e3 * bench.chosen(sweep, policy, "deadline") for sweep in GRIDS})
        share = np.mean([bench.reached("completed_share", sweep, policy).mean() for sweep in GRIDS])
        ends = f"{found[0]:g}" + (f" to {found[-1]:g}" if len(found) > 1 else "")
        said.append(f"{policy} at {ends} ms with {share:.1%} of the loops")
    return "; ".join(said)


def min_delay(bench: Bench) -> Finding:
    """MinDelay loses QoC, misses more loops, acts on older samples and strays more."""
    parts = _beaten(bench, "MinDelay")
    for sweep in GRIDS:
        share, age, cost = (
            [bench.reached(name, sweep, policy) for policy in ("MinDelay", "Co-design")]
            for name in ("completed_share", "age_mean", "auc")
        )
        parts += [
            Part(f"loops missed, more, sweep of {sweep}", share[1] - share[0], "share", LEAST),
            Part(f"age, older, sweep of {sweep}", ratio(age[0], age[1]) - 1, "spread", LEAST),
            Part(f"AUC, more, sweep of {sweep}", (cost[0] - cost[1]) / bench.best[1], "J*", LEAST),
        ]
    return Finding(parts, _deadlines(bench))


def max_rel(bench: Bench) -> Finding:
    """MaxRel completes more loops, loses QoC, and robots come later."""
    parts = _beaten(bench, "MaxRel")
    for sweep in GRIDS:
        share, come = (
            [bench.reached(name, sweep, policy) for policy in ("MaxRel", "Co-design")]
            for name in ("completed_share", "arrival_time")
        )
        parts += [
            Part(f"loops completed, more, sweep of {sweep}", ratio(share[0], share[1]) - 1, "spread", LEAST),
            Part(f"robots come later, sweep of {sweep}", come[0] - come[1], "s", LEAST_TIME),
        ]
    return Finding(parts, _deadlines(bench))


def co_design(bench: Bench) -> Finding:
    """Co-design's deadline lies between the others', and nothing that they choose has its QoC."""
    parts = [*_beaten(bench, "MinDelay"), *_beaten(bench, "MaxRel")]
    for sweep in GRIDS:
        low, own, high = (
            1e3 * bench.chosen(sweep, policy, "deadline") for policy in ("MinDelay", "Co-design", "MaxRel")
        )
        inside = np.array(round(min(own - low, high - own), 6))
        parts.append(Part(f"Δ to the nearer of the others, sweep of {sweep}", inside, "ms", 0.0))
    return Finding(parts, _deadlines(bench))


def apart(bench: Bench) -> Finding:
    """What Co-design chooses, but in the sweep of eta, keeps the robots apart."""
    return Finding([
        Part(f"runs that come too close, sweep of {sweep}",
             bench.reached("collided", sweep, "Co-design").astype(bool), "share", COLLISIONS, above=False)
        for sweep in GRIDS if sweep != "eta"
    ])  # fmt: skip
