"""What the paper says of each parameter (section V, its observations i to vi)."""

from __future__ import annotations

import numpy as np

from experiments.claims import COLLISIONS, LATE, LEAST, LEAST_DISTANCE, LEAST_QOC, LEAST_TIME, RELIABLE, Test
from experiments.settings import GRIDS, Bench
from experiments.verdicts import Finding, Part, ratio
from qocjax.study.sweep import qoc_by_seed


def mobility_hurts(bench: Bench) -> Finding:
    """i: a higher cap under MinDelay, and whether staleness is what makes it hurt."""
    low, best = (bench.change("v_max", 0.7, 1.5, deadline) for deadline in (bench.low, bench.best[0]))
    return Finding([
        Part(f"ν^max from 0.7 to 1.5 at {bench.low:g} ms", low, "J*", LEAST),
        Part("that much more than at the best Δ", low - best, "J*", LEAST),
    ])  # fmt: skip


def mobility_pays(bench: Bench) -> Finding:
    """i: Co-design's deadline lies between the others', its cap gains there, and robots stay apart."""
    low, own, high = _deadlines(bench, "v_max")
    cap = bench.chosen("v_max", "Co-design")
    gain, collided = -bench.change("v_max", 0.7, cap, own), bench.reached("collided", "v_max", "Co-design").astype(bool)
    return Finding([
        Part("Δ to the nearer of the others", np.array(min(own - low, high - own)), "ms", 0.0),
        Part(f"AUC that ν^max from 0.7 to {cap:g} takes off at {own:g} ms", gain, "J*", LEAST),
        Part("runs that come too close", collided, "share", COLLISIONS, above=False),
    ], f"MinDelay takes ν^max = {bench.chosen('v_max', 'MinDelay'):g}")  # fmt: skip


def _deadlines(bench: Bench, sweep: str) -> list[float]:
    """Those of MinDelay, Co-design and MaxRel (ms)."""
    policies = ("MinDelay", "Co-design", "MaxRel")
    return [round(1e3 * bench.chosen(sweep, policy, "deadline"), 6) for policy in policies]


def moderate(name: str) -> Test:
    """The best value inside the grid against both ends, each at its own best deadline."""

    def test(bench: Bench) -> Finding:
        chosen, judged = bench.best_scores(name)
        inner = 1 + int(chosen[1:-1].argmax())
        parts = [
            Part(f"less {name} = {GRIDS[name][k]:g}", judged[inner] - judged[k], "QoC", LEAST_QOC)
            for k in (0, len(chosen) - 1)
        ]
        best = bench.chosen(name, "Co-design")
        return Finding(parts, f"Co-design takes {best:g}, the best inside the grid is {GRIDS[name][inner]:g}")

    return test


def spreads(bench: Bench) -> Finding:
    """ii: the smallest distance, with and without repulsion."""
    none, most = bench.metric("min_distance", deadline_ms=bench.best[0], eta=[0.0, 2.0])
    what = f"smallest distance, η from 0 to 2 at {bench.best[0]:g} ms"
    return Finding([Part(what, most - none, "m", LEAST_DISTANCE)])


def disagreement(bench: Bench) -> Finding:
    """ii: AUC with more repulsion."""
    deadlines = (bench.best[0], 700)
    parts = [Part(f"η from 0.2 to 2 at {d:g} ms", bench.change("eta", 0.2, 2.0, d), "J*", LEAST) for d in deadlines]
    return Finding(parts, some=True)


def low_repulsion(bench: Bench) -> Finding:
    """ii: the best eta up to the baseline's against those above."""
    chosen, judged = bench.best_scores("eta")
    grid = GRIDS["eta"]
    last = grid.index(0.6)
    best = int(chosen[: last + 1].argmax())
    parts = [
        Part(f"η = {grid[best]:g} less η = {grid[k]:g}", judged[best] - judged[k], "QoC", LEAST_QOC)
        for k in range(last + 1, len(grid))
    ]
    return Finding(parts)


def keeps_apart(bench: Bench) -> Finding:
    """ii: how close robots come with the eta that is best."""
    collided = bench.reached("collided", "eta", "Co-design").astype(bool)
    best, deadline = bench.chosen("eta", "Co-design"), 1e3 * bench.chosen("eta", "Co-design", "deadline")
    others = bench.runs(bench.judging, deadline_ms=deadline, eta=GRIDS["eta"][1:3])["collided"].values.mean(axis=1)
    note = ", ".join(f"{share:.0%} with η = {eta:g}" for eta, share in zip(GRIDS["eta"][1:3], others, strict=True))
    what = f"runs that come closer than two radii, η = {best:g} at {deadline:g} ms"
    return Finding([Part(what, collided, "share", COLLISIONS, above=False)], note)


def frequent_updates(bench: Bench) -> Finding:
    """iii: what sampling ten times as often takes off AUC under MinDelay: nothing that counts, says the paper."""
    often, seldom = bench.auc(deadline_ms=bench.low, tau=[0.005, 0.05])
    gain = (seldom - often) / bench.best[1]
    part = Part(f"AUC that τ from 50 to 5 ms takes off at {bench.low:g} ms", gain, "J*", LEAST, above=False)
    return Finding([part], f"AUC {often.mean():.3g} s at 5 ms, {seldom.mean():.3g} s at 50 ms")


def fresher(bench: Bench) -> Finding:
    """iii: the best tau at 300 ms against the longest: age, which grows by tau / 2 between samples, and arrival."""
    grid = GRIDS["tau"]
    best = int(bench.auc(seeds=bench.choosing, deadline_ms=300, tau=grid[:-1]).mean(axis=1).argmin())
    pair = {"deadline_ms": 300, "tau": [grid[best], grid[-1]]}
    short, long = bench.metric("age_mean", **pair) + np.array(pair["tau"])[:, None] / 2
    soon, late = bench.metric("arrival_time", **pair)
    what = f"age at 300 ms, τ of {1e3 * grid[-1]:g} ms over {1e3 * grid[best]:g} ms"
    return Finding([
        Part(what, ratio(long, short) - 1, "spread", LEAST),
        Part("robots come later by it", soon - late, "s", LEAST_TIME, above=False),
    ])  # fmt: skip


def oscillation(bench: Bench) -> Finding:
    """iv: the way that robots drive with a large kappa, at each deadline at which information is stale."""
    parts = []
    for deadline in (bench.low, *LATE):
        less, more = bench.metric("path_length", deadline_ms=deadline, kappa=[1.0, 8.0])
        parts.append(Part(f"path, κ from 1 to 8 at {deadline:g} ms", more - less, "m", LEAST_DISTANCE))
    return Finding(parts)


def stiff(some: bool) -> Test:
    """iv: the best kappa inside the grid against the largest, at each deadline at which information is stale."""

    def test(bench: Bench) -> Finding:
        grid, parts = GRIDS["kappa"], []
        for deadline in (bench.low, *LATE):
            chosen = bench.auc(seeds=bench.choosing, deadline_ms=deadline, kappa=grid[1:-1]).mean(axis=1)
            best = grid[1 + int(chosen.argmin())]
            runs = bench.runs(bench.judging, deadline_ms=deadline, kappa=[best, grid[-1]])
            better, worse = qoc_by_seed(runs, bench.study.scale)
            parts.append(Part(f"κ = {best:g} less κ = 8 at {deadline:g} ms", better - worse, "QoC", LEAST_QOC))
        late = bench.auc(deadline_ms=700, kappa=[1.0, 8.0]).mean(axis=1)
        return Finding(parts, f"AUC at 700 ms {late[0]:.2f} s with κ = 1, {late[1]:.2f} s with 8", some)

    return test


def slow(bench: Bench) -> Finding:
    """iv: when robots come with a small kappa."""
    small, usual = bench.metric("arrival_time", deadline_ms=bench.best[0], kappa=[0.25, 2.0])
    what = f"robots come later, κ from 2 to 0.25 at {bench.best[0]:g} ms"
    return Finding([Part(what, small - usual, "s", LEAST_TIME)])


def between(sweep: str) -> Test:
    """iv, v: whether Co-design's deadline lies between the others', and robots come sooner than with MaxRel."""

    def test(bench: Bench) -> Finding:
        low, own, high = _deadlines(bench, sweep)
        sooner = bench.reached("arrival_time", sweep, "MaxRel") - bench.reached("arrival_time", sweep, "Co-design")
        return Finding([
            Part("Δ above MinDelay's", np.array(own - low), "ms", 0.0),
            Part("Δ below MaxRel's", np.array(high - own), "ms", 0.0),
            Part("robots come sooner than with MaxRel", sooner, "s", LEAST_TIME),
        ], f"{sweep} = {bench.chosen(sweep, 'Co-design'):g} at {own:g} ms")  # fmt: skip

    return test


def reliable(sweep: str) -> Test:
    """iv, v: whether more loops complete than are missed where Co-design operates."""

    def test(bench: Bench) -> Finding:
        share, own = bench.reached("completed_share", sweep, "Co-design"), bench.chosen(sweep, "Co-design", "deadline")
        return Finding([Part(f"loops completed at {1e3 * own:g} ms", share, "share", RELIABLE)])

    return test


def late_heading(bench: Bench) -> Finding:
    """v: a high gamma at high delay."""
    return Finding([Part(f"γ from 2 to 6 at {d} ms", bench.change("gamma", 2.0, 6.0, d), "J*", LEAST) for d in LATE])


def heading_pays(bench: Bench) -> Finding:
    """v: Co-design takes more gamma than MaxRel, and gains by it."""
    own, deadline = bench.chosen("gamma", "Co-design"), 1e3 * bench.chosen("gamma", "Co-design", "deadline")
    change = bench.change("gamma", 2.0, own, deadline)
    more = np.array(own - bench.chosen("gamma", "MaxRel"))
    return Finding([
        Part(f"γ from 2 to {own:g} at {deadline:g} ms", change, "J*", -LEAST, above=False),
        Part("γ above MaxRel's", more, "1/s", 0.0),
    ])  # fmt: skip


def fast_heading(bench: Bench) -> Finding:
    """A high gamma where loops take 20 ms."""
    values = bench.change("gamma", 2.0, 6.0, 40, bench.fast)
    return Finding([Part("γ from 2 to 6 at Δ = 40 ms, loops of 20 ± 5 ms", values, "J*", -LEAST, above=False)])


def margins(bench: Bench) -> Finding:
    """vi: the smallest distance under MinDelay, where loops are missed."""
    none, most = bench.metric("min_distance", deadline_ms=bench.low, c_miss=[0.0, 1.6])
    what = f"smallest distance, c_miss from 0 to 1.6 at {bench.low:g} ms"
    return Finding([Part(what, most - none, "m", LEAST_DISTANCE)])


def under_drops(bench: Bench) -> Finding:
    """vi: a larger c_miss where loops are missed."""
    deadlines = (bench.low, bench.low + 40)
    shares = ", ".join(f"F = {bench.completing(d)} at {d:g} ms" for d in deadlines)
    return Finding([
        Part(f"c_miss from 0 to 0.8 at {d:g} ms", bench.change("c_miss", 0.0, 0.8, d), "J*", -LEAST, above=False)
        for d in deadlines
    ], shares)  # fmt: skip


def restrictive(bench: Bench) -> Finding:
    """vi: a larger c_miss at high delay."""
    parts = [Part(f"c_miss from 0 to 1.6 at {d} ms", bench.change("c_miss", 0.0, 1.6, d), "J*", LEAST) for d in LATE]
    same = all(not part.values.any() for part in parts)
    return Finding(parts, "every loop completes, the age never passes Δ: c_miss acts nowhere (Eq. 5)" if same else "")
