"""What the paper says of AUC over the deadline (sections III and IV)."""

from __future__ import annotations

from experiments.claims import LEAST
from experiments.settings import GRIDS, Bench
from experiments.verdicts import Finding, Part, ratio

_EARLY = 40  # ms: a very low deadline
_AXIS = [0, 40, 60, 80, 100, 120, 160, 200, 300, 400, 800]


def worse_early(bench: Bench) -> Finding:
    """AUC at a very low deadline against that at the best one, for each eta and tau."""
    parts = []
    for name in ("eta", "tau"):
        early = bench.auc(deadline_ms=_EARLY, **{name: GRIDS[name]})
        best = bench.runs(bench.judging, deadline_ms=bench.best_deadlines(name), **{name: GRIDS[name]})
        for value, j, least in zip(GRIDS[name], early, bench.numbers(best, "auc"), strict=True):
            parts.append(Part(f"AUC at {_EARLY} ms over the best, {name} = {value:g}", ratio(j, least), "times", 2.0))
    return Finding(parts)


def drops(bench: Bench) -> Finding:
    """Whether missed loops make AUC worse early: it is compared with loops that all complete by the same deadline."""
    early, missed = bench.auc(deadline_ms=_EARLY)[0], 1 - bench.metric("completed_share", deadline_ms=_EARLY)[0]
    fast = bench.auc(deadline_ms=_EARLY, network=bench.fast)[0]
    best = bench.auc(deadline_ms=bench.best[0])[0]
    return Finding([
        Part(f"loops missed at {_EARLY} ms", missed, "share", 0.9),
        Part("part of the worsening that loops of 20 ± 5 ms undo", ratio(early - fast, early - best), "share", 0.5),
    ])  # fmt: skip


def sampling(bench: Bench) -> Finding:
    """Worst against best tau, past enough reliability."""
    parts = []
    for deadline in (300, 400, 600):
        chosen = bench.auc(seeds=bench.choosing, deadline_ms=deadline, tau=GRIDS["tau"]).mean(axis=1)
        judged = bench.auc(deadline_ms=deadline, tau=GRIDS["tau"])
        spread = ratio(judged[chosen.argmax()], judged[chosen.argmin()]) - 1
        parts.append(Part(f"worst less best τ at {deadline} ms", spread, "spread", 0.1, above=False))
    return Finding(parts)


def repulsion(bench: Bench) -> Finding:
    """A larger eta, late and early."""
    early, late = (bench.change("eta", 0.2, 2.0, deadline) for deadline in (200, 700))
    return Finding([
        Part("η from 0.2 to 2 at 700 ms", late, "J*", LEAST),
        Part("that much more than at 200 ms", late - early, "J*", LEAST),
    ])  # fmt: skip


def reliability(bench: Bench) -> Finding:
    """F from 100 to 200 ms, out of what it gains from 0 to 800 ms."""
    zero, low, high, last = bench.metric("completed_share", deadline_ms=[0, 100, 200, 800])
    return Finding(
        [Part("part of the rise of F that lies between 100 and 200 ms", ratio(high - low, last - zero), "share", 0.25)],
        f"loops completed: {low.mean():.1%} at 100 ms, {high.mean():.1%} at 200 ms, {last.mean():.1%} at 800 ms",
    )


def steep_fall(bench: Bench) -> Finding:
    """The same read of AUC: where it falls."""
    values = dict(zip(_AXIS, bench.auc(deadline_ms=_AXIS), strict=True))
    best = bench.auc(deadline_ms=[bench.best[0]])[0]
    share = ratio(values[100] - values[200], values[0] - best)
    said = ", ".join(f"{v.mean():.3g}" for v in values.values())
    note = f"AUC at {', '.join(map(str, _AXIS))} ms: {said} s"
    return Finding([Part("part of the fall of AUC that lies between 100 and 200 ms", share, "share", 0.5)], note)


def regimes(bench: Bench) -> Finding:
    """Worst at a deadline of 0, best between, worse again at 800 ms."""
    zero, best, last = bench.auc(deadline_ms=[0, bench.best[0], 800]) / bench.best[1]
    return Finding([
        Part("Δ = 0 less the best", zero - best, "J*", LEAST),
        Part("Δ = 800 ms less the best", last - best, "J*", LEAST),
        Part("Δ = 0 less Δ = 800 ms", zero - last, "J*", LEAST),
    ], f"the best Δ is {bench.best[0]:g} ms, J* = {bench.best[1]:.3g} s")  # fmt: skip
