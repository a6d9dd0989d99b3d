"""The paper's conclusions (model, section 7) as tests: one implementation, whatever is simulated.

A conclusion is one or more differences, each of which has to lie beyond a bound. Differences are paired over seeds;
what is compared (best values, best deadlines, designs of the policies) was chosen on other seeds. The bounds ask for
1 % of AUC or 0.0025 of QoC (the same at QoC = 1/2): less is no effect, however many seeds could show it. QoC is on the
scale of each study, taken as given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from experiments.settings import GRIDS, Bench
from experiments.verdicts import Finding, Part, ratio
from qocjax.study.sweep import qoc_by_seed

LEAST = 0.01  # of the baseline's AUC at its best deadline: the smallest effect that counts
LEAST_QOC = LEAST / 4  # the same at QoC = 1/2, where dQ = -dJ/J / 4

Found = tuple[list[Part], str]


@dataclass(frozen=True)
class Conclusion:
    """What the paper observes, and how it is put to the test."""

    number: str
    claim: str
    test: Callable[[Bench], Found]
    sweep: str = "any"  # in which a reader of a study meets it

    def judge(self, bench: Bench) -> Finding:
        """Puts it to the test."""
        return Finding(*self.test(bench))


def steep_fall(bench: Bench) -> Found:
    """Observation 1, where AUC falls."""
    axis = [0, 40, 60, 80, 100, 120, 160, 200, 300, 400, 800]
    values = dict(zip(axis, bench.auc(deadline_ms=axis), strict=True))
    best = bench.auc(deadline_ms=[bench.best[0]])[0]
    share = ratio(values[100] - values[200], values[0] - best)
    note = "AUC at " + ", ".join(map(str, axis)) + " ms: " + ", ".join(f"{values[d].mean():.3g}" for d in axis) + " s"
    return [Part("part of the fall from Δ = 0 to the best that lies between 100 and 200 ms", share, "share", 0.5)], note


def intermediate(bench: Bench) -> Found:
    """Observation 1, the best deadline."""
    zero, best, last = bench.auc(deadline_ms=[0, bench.best[0], 800]) / bench.best[1]
    return [
        Part("Δ = 0 less the best", zero - best, "J*", LEAST),
        Part("Δ = 800 ms less the best", last - best, "J*", LEAST),
        Part("Δ = 0 less Δ = 800 ms", zero - last, "J*", LEAST),
    ], f"the best Δ is {bench.best[0]:g} ms, J* = {bench.best[1]:.3g} s"


def sampling(bench: Bench) -> Found:
    """Observation 2, tau."""
    parts = []
    for deadline in (300, 400, 600):
        chosen = bench.auc(seeds=bench.choosing, deadline_ms=deadline, tau=GRIDS["tau"]).mean(axis=1)
        judged = bench.auc(deadline_ms=deadline, tau=GRIDS["tau"])
        spread = ratio(judged[chosen.argmax()], judged[chosen.argmin()]) - 1
        parts.append(Part(f"worst less best τ at {deadline} ms", spread, "spread", 0.1, above=False))
    return parts, ""


def repulsion(bench: Bench) -> Found:
    """Observation 2, eta."""
    early, late = (bench.change("eta", 0.2, 2.0, deadline) for deadline in (200, 700))
    return [
        Part("η from 0.2 to 2 at 200 ms", early, "J*", LEAST),
        Part("at 700 ms, that much more", late - early, "J*", LEAST),
    ], ""


def beaten(policy: str) -> Callable[[Bench], Found]:
    """Observation 3, against one policy."""

    def test(bench: Bench) -> Found:
        study, parts = bench.study, []
        scores = qoc_by_seed(study.evaluation, study.scale)
        table = study.policies.set_index("policy")
        for sweep in GRIDS:
            both = [scores[bench.place(sweep, name)] for name in ("Co-design", policy)]
            parts.append(Part(f"sweep of {sweep}", both[0] - both[1], "QoC", LEAST_QOC))
        best = 1e3 * table.loc["Co-design", "deadline"]
        other = 1e3 * table.loc[policy, "deadline"]
        return (
            parts,
            f"Co-design's Δ is {best.min():g} to {best.max():g} ms, {policy}'s {other.min():g} to {other.max():g} ms",
        )

    return test


def moderate(name: str) -> Callable[[Bench], Found]:
    """Observation 4: the best value inside the grid against both ends, each at its own best deadline."""

    def test(bench: Bench) -> Found:
        chosen, judged = bench.best_scores(name)
        inner = 1 + int(chosen[1:-1].argmax())
        ends = (0, len(chosen) - 1)
        parts = [Part(f"less {name} = {GRIDS[name][k]:g}", judged[inner] - judged[k], "QoC", LEAST_QOC) for k in ends]
        return parts, f"the best inside the grid is {GRIDS[name][inner]:g}"

    return test


def low_repulsion(bench: Bench) -> Found:
    """Observation 4, eta: the best up to the baseline's against those above."""
    chosen, judged = bench.best_scores("eta")
    grid = GRIDS["eta"]
    last = grid.index(0.6)
    best = int(chosen[: last + 1].argmax())
    above = range(last + 1, len(grid))
    parts = [Part(f"less η = {grid[k]:g}", judged[best] - judged[k], "QoC", LEAST_QOC) for k in above]
    collided = bench.runs(bench.judging, deadline_ms=bench.best[0], eta=grid[:2])["collided"].values.mean(axis=1)
    return parts, (
        f"the best is η = {grid[best]:g}; at the baseline's best Δ {collided[0]:.0%} of the runs come closer than two "
        f"radii with η = 0, {collided[1]:.0%} with 0.2"
    )


def fast_heading(bench: Bench) -> Found:
    """Observation 5, gamma on a fast loop."""
    values = bench.change("gamma", 2.0, 6.0, 40, bench.fast)
    return [Part("γ from 2 to 6 at Δ = 40 ms, loops of 20 ± 5 ms", values, "J*", -LEAST, above=False)], ""


def slow_heading(bench: Bench) -> Found:
    """Observation 5, gamma at high delay."""
    return [Part("γ from 2 to 6 at Δ = 600 ms", bench.change("gamma", 2.0, 6.0, 600), "J*", LEAST)], ""


def drops(bench: Bench) -> Found:
    """Observation 5, c_miss under drops."""
    shares = ", ".join(f"F = {bench.completing(d)} at {d} ms" for d in (100, 140))
    return [
        Part(f"c_miss from 0 to 0.8 at {d} ms", bench.change("c_miss", 0.0, 0.8, d), "J*", -LEAST, above=False)
        for d in (100, 140)
    ], shares


def distance_under_drops(bench: Bench) -> Found:
    """Observation 5, c_miss and the distance between robots."""
    runs = bench.runs(bench.judging, deadline_ms=120, c_miss=[0.0, 0.8])["min_distance"].values.astype(float)
    return [Part("smallest distance, c_miss from 0 to 0.8 at 120 ms", runs[1] - runs[0], "m", 0.01)], ""


def staleness(bench: Bench) -> Found:
    """Observation 5, c_miss at high delay."""
    return [Part("c_miss from 0 to 0.8 at 700 ms", bench.change("c_miss", 0.0, 0.8, 700), "J*", -LEAST)], ""


def apart(bench: Bench) -> Found:
    """No observation of the paper's: what Co-design chooses, but in the sweep of eta, keeps the robots apart."""
    collided = bench.study.evaluation["collided"].values
    return [
        Part(f"runs that come too close, sweep of {sweep}",
             collided[bench.place(sweep, "Co-design")].astype(bool), "share", 0.05, above=False)
        for sweep in GRIDS if sweep != "eta"
    ], ""  # fmt: skip


CONCLUSIONS = (
    Conclusion("1a", "AUC falls steeply between Δ = 100 and 200 ms", steep_fall),
    Conclusion("1b", "An intermediate Δ is best", intermediate),
    Conclusion("2a", "Past enough reliability AUC hardly depends on τ", sampling, "tau"),
    Conclusion("2b", "AUC worsens with η, more so at high delay", repulsion, "eta"),
    Conclusion("3a", "Co-design beats MinDelay in each sweep", beaten("MinDelay")),
    Conclusion("3b", "Co-design beats MaxRel in each sweep", beaten("MaxRel")),
    Conclusion("4a", "A moderate ν^max wins", moderate("v_max"), "v_max"),
    Conclusion("4b", "A moderate κ wins", moderate("kappa"), "kappa"),
    Conclusion("4c", "A lower to moderate η wins", low_repulsion, "eta"),
    Conclusion("5a", "A high γ hurts at high delay", slow_heading, "gamma"),
    Conclusion("5b", "A high γ helps when the loop is fast", fast_heading, "gamma"),
    Conclusion("5c", "A larger c_miss lowers AUC under drops", drops, "c_miss"),
    Conclusion("5c'", "A larger c_miss keeps robots apart under drops", distance_under_drops, "c_miss"),
    Conclusion("5d", "A larger c_miss does not help at high delay", staleness, "c_miss"),
    Conclusion("S", "Co-design's choices (but for η = 0) keep robots apart", apart),
)
