"""The paper's observations (model, section 7), each put to the simulation on seeds of its own.

    python experiments/observations.py [seeds]

Prints a Markdown table for the edge of the study, which never lets a sample wait, and for one with a worker per robot:
what the paper observes, what the simulation gives, whether it holds. Every difference is paired over seeds, with its
95 % interval. About 40 s.
"""

from __future__ import annotations

import sys

import numpy as np

from qocjax import Design, Network, QocScale, Scenario, evaluate, one_at_a_time, paper_network, run_study
from qocjax.batch.xla import request_whole_loop
from qocjax.network import Edge, LoopNetwork, TruncatedNormal, with_edge
from qocjax.study.reliability import reliability_of
from qocjax.study.statistics import Estimate, estimate, paired
from qocjax.study.sweep import qoc_by_seed

FIRST_SEED = 10_000  # far from the seeds of the studies


class Judge:
    """AUC of designs by seed, on common random numbers."""

    def __init__(self, seeds: int, network: Network | None = None) -> None:
        self.seeds = range(FIRST_SEED, FIRST_SEED + seeds)
        self.network = network or paper_network()

    def auc(self, **values: float | list[float]) -> np.ndarray:
        """[G, S] mean over robots; deadlines in ms as `deadline_ms`."""
        deadline = np.asarray(values.pop("deadline_ms"), float) / 1e3
        runs = evaluate(Scenario(), Design(deadline=deadline, **values), self.network, self.seeds)
        return runs["auc"].values.astype(float).mean(axis=-1)

    def completing(self, deadline_ms: float) -> str:
        """Share of loops that complete at the usual sampling period."""
        return f"{float(reliability_of(self.network, Scenario(), deadline_ms / 1e3, Design().tau).share):.1%}"

    def change(self, name: str, low: float, high: float, deadline_ms: float) -> Estimate:
        """AUC with the parameter at `high` less AUC with it at `low`."""
        lower, upper = self.auc(deadline_ms=deadline_ms, **{name: [low, high]})
        return paired(upper, lower)


def show(gap: Estimate) -> str:
    """A difference with its interval."""
    return f"{gap.mean:+.2f} s [{gap.low:+.2f}, {gap.high:+.2f}]"


def row(number: str, claim: str, finding: str, holds: bool | str) -> str:
    """A line of the table."""
    verdict = holds if isinstance(holds, str) else "holds" if holds else "does not hold"
    return f"| {number} | {claim} | {finding} | {verdict} |"


def regimes(judge: Judge) -> list[str]:
    """Observation 1."""
    axis = [0, 20, 40, 60, 80, 100, 120, 140, 160, 180, 200, 300, 400, 600, 800]
    mean = dict(zip(axis, judge.auc(deadline_ms=axis).mean(axis=1), strict=True))
    best = min(mean, key=mean.__getitem__)
    falls = max(d for d in axis if mean[d] > 0.9 * mean[0]), min(d for d in axis if mean[d] < 0.1 * mean[0])
    text = ", ".join(f"{mean[d]:.3g}" for d in (0, 40, 80, 100, best, 200, 400, 800))
    return [
        row(
            "1", "AUC is worst at very low Δ, improves strongly between 100 and 200 ms, worsens slowly after",
            f"AUC at 0, 40, 80, 100, {best}, 200, 400, 800 ms: {text} s; it falls to a tenth between {falls[0]} and "
            f"{falls[1]} ms, the best Δ is {best} ms",
            ("holds" if falls[0] >= 80 else "holds; the fall begins earlier") if mean[0] > mean[best] < mean[800]
            else False,
        )
    ]  # fmt: skip


def policies(judge: Judge) -> list[str]:
    """Observation 3."""
    grids = {
        "v_max": [0.2, 0.4, 0.7, 0.85, 1.0, 1.5],
        "eta": [0.0, 0.2, 0.6, 1.0, 2.0],
        "tau": [0.005, 0.01, 0.02, 0.05, 0.1],
        "kappa": [0.25, 0.5, 1.0, 2.0, 4.0, 8.0],
        "gamma": [0.5, 1.0, 2.0, 4.0, 6.0],
        "c_miss": [0.0, 0.1, 0.2, 0.8, 1.6],
    }
    grid = one_at_a_time(Design(), grids, np.arange(0, 801, 20) / 1e3)
    first = judge.seeds.start
    chosen_on, judged_on = range(first + 10_000, first + 10_032), judge.seeds
    table = run_study(Scenario(), grid, judge.network, chosen_on, judged_on).policies
    best = table[table["policy"] == "Co-design"]
    others = table[table["policy"] != "Co-design"]
    closest = others.loc[others["difference"].idxmax()]
    finding = (
        f"in every sweep; the closest is {closest['policy']} in the sweep of {closest['sweep']}, "
        f"{closest['difference']:+.3f} [{closest['difference_low']:+.3f}, {closest['difference_high']:+.3f}] QoC; "
        f"Co-design's Δ is {1e3 * best['deadline'].min():g} to {1e3 * best['deadline'].max():g} ms"
    )
    inner = (best["deadline"] > others["deadline"].min()).all() and (best["deadline"] < 0.8).all()
    claim = "Co-design beats MinDelay and MaxRel in each sweep, at an intermediate Δ"
    return [row("3", claim, finding, bool((others["difference_high"] < 0).all() and inner))]


def sampling_and_repulsion(judge: Judge) -> list[str]:
    """Observation 2."""
    parts, spread = [], {}
    for deadline in (300, 400, 600):
        values = judge.auc(deadline_ms=deadline, tau=[0.005, 0.01, 0.02, 0.05, 0.1]).mean(axis=1)
        spread[deadline] = values.max() / values.min() - 1
        parts.append(f"{100 * spread[deadline]:.0f} % at {deadline} ms")
    low, high = (judge.change("eta", 0.2, 2.0, d) for d in (200, 700))
    both = low.low > 0 and high.low > low.high
    return [
        row("2a", "Past enough reliability AUC hardly depends on τ", "spread over τ = 5 to 100 ms: " + ", ".join(parts),
            max(spread.values()) < 0.1),
        row("2b", "AUC worsens with η, more so at high delay",
            f"η from 0.2 to 2: {show(low)} at 200 ms, {show(high)} at 700 ms", both),
    ]  # fmt: skip


def moderate_values(judge: Judge) -> list[str]:
    """Observation 4."""
    rows = []
    for number, name, label, grid in (
        ("4a", "v_max", "ν^max", [0.2, 0.4, 0.7, 0.85, 1.0, 1.5]),
        ("4b", "kappa", "κ", [0.25, 0.5, 1.0, 2.0, 4.0, 8.0]),
    ):
        values = judge.auc(deadline_ms=180, **{name: grid})
        chosen_on, judged_on = np.split(values, 2, axis=1)  # the best is chosen on other seeds than it is judged on
        best = int(chosen_on.mean(axis=1).argmin())
        ends = [paired(judged_on[end], judged_on[best]) for end in (0, -1)]
        rows.append(
            row(number, f"A moderate {label} wins: less is slow, more overshoots",
                f"at Δ = 180 ms the best of {grid} is {grid[best]:g}; the ends cost {show(ends[0])}, {show(ends[1])}",
                0 < best < len(grid) - 1 and all(e.low > 0 for e in ends))
        )  # fmt: skip
    grid = [0.0, 0.2, 0.6, 1.0, 2.0]
    runs = evaluate(Scenario(), Design(deadline=0.16, eta=grid), judge.network, judge.seeds)
    scores = qoc_by_seed(runs, QocScale.of(runs["auc"].values)).mean(axis=1)
    collided = runs["collided"].values.mean(axis=1)
    rows.append(
        row("4c", "A lower to moderate η wins",
            f"QoC falls from η = {grid[int(scores.argmax())]:g} on; but at η = 0 {100 * collided[0]:.0f} % of the runs "
            f"come closer than two radii, at 0.2 {100 * collided[1]:.0f} %", bool(scores.argmax() <= 2))
    )  # fmt: skip
    return rows


def heading_gain(judge: Judge, fast: Judge) -> list[str]:
    """Observation 5, first half."""
    slow = judge.change("gamma", 2.0, 6.0, 600)
    quick = fast.change("gamma", 2.0, 6.0, 40)
    middle = judge.change("gamma", 2.0, 6.0, 180)
    return [
        row("5a", "A high γ hurts at high delay", f"γ from 2 to 6 at Δ = 600 ms: {show(slow)}", slow.low > 0),
        row("5b", "A high γ helps when the loop is fast",
            f"γ from 2 to 6: {show(quick)} at Δ = 40 ms on a network of 20 ± 5 ms, {show(middle)} at Δ = 180 ms on the "
            "paper's", quick.high < 0 and middle.high < 0),
    ]  # fmt: skip


def staleness(judge: Judge) -> list[str]:
    """Observation 5, second half."""
    drops = judge.change("c_miss", 0.0, 0.8, 100)
    few = judge.change("c_miss", 0.0, 0.8, 140)
    late = judge.change("c_miss", 0.0, 0.8, 700)
    runs = evaluate(Scenario(), Design(deadline=0.12, c_miss=[0.0, 0.8]), judge.network, judge.seeds)
    closer = estimate(runs["min_distance"].values[1].astype(float) - runs["min_distance"].values[0].astype(float))
    return [
        row("5c", "A larger c_miss helps under drops",
            f"c_miss from 0 to 0.8: AUC {show(drops)} at Δ = 100 ms (F = {judge.completing(100)}), {show(few)} at "
            f"140 ms (F = {judge.completing(140)}); smallest distance at 120 ms {closer.mean:+.3f} m "
            f"[{closer.low:+.3f}, {closer.high:+.3f}]",
            "for AUC: does not hold; for distance: " + ("holds" if closer.low > 0 else "does not hold")
            if drops.low > 0 else drops.high < 0),
        row("5d", "A larger c_miss does not help at high delay", f"at Δ = 700 ms: {show(late)}", late.high >= 0),
    ]  # fmt: skip


def main() -> None:
    """Prints the table."""
    request_whole_loop()
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 256
    judge = Judge(seeds)
    fast = Judge(seeds, LoopNetwork(compute=TruncatedNormal(0.02, 0.005), name="fast"))
    scarce = Judge(seeds, with_edge(paper_network(), Edge(workers=1, discipline="skip")))
    quick = LoopNetwork(compute=TruncatedNormal(0.02, 0.005), name="fast")
    fast_scarce = Judge(seeds, with_edge(quick, Edge(workers=1, discipline="skip")))
    print(f"Seeds {FIRST_SEED} to {FIRST_SEED + seeds - 1}; differences are paired, with 95 % intervals.")
    for title, own, other in (("Unlimited edge", judge, fast), ("One worker per robot, skip", scarce, fast_scarce)):
        print(f"\n**{title}**\n\n| | The paper observes | The simulation gives | |\n|---|---|---|---|")
        for lines in (
            regimes(own), sampling_and_repulsion(own), policies(own), moderate_values(own),
            heading_gain(own, other), staleness(own),
        ):  # fmt: skip
            print("\n".join(lines), flush=True)


if __name__ == "__main__":
    main()
