"""The paper's conclusions (model, section 7) as tests: one implementation, whatever is simulated.

A conclusion is one or more differences, each of which has to lie beyond a bound. Differences are paired over seeds;
what is compared (best values, best deadlines, designs of the policies) was chosen on other seeds. A conclusion *holds*
where the 95 % interval of every difference lies on the right side of its bound, *does not hold* where that of one (of
m, at 1 - 0.05/m) lies on the wrong side, and is *undecided* else. The bounds ask for 1 % of AUC or 0.0025 of QoC (the
same at QoC = 1/2): less is no effect, however many seeds could show it. QoC is on the scale of each study, taken as
given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy import special

from qocjax import Design, Network, QocScale, Rules, Scenario, evaluate, one_at_a_time, paper_network, run_study
from qocjax.network import Edge, LoopNetwork, TruncatedNormal, with_edge
from qocjax.network.edge_network import Path
from qocjax.study.chosen import place_of
from qocjax.study.policies import MIN_RELIABILITY
from qocjax.study.reliability import reliability_of
from qocjax.study.statistics import Estimate, estimate
from qocjax.study.sweep import Study, qoc_by_seed

FIRST_SEED = 10_000  # far from the seeds of the studies
AXIS_MS = np.arange(0, 801, 20)
GRIDS = {
    "v_max": [0.2, 0.4, 0.7, 0.85, 1.0, 1.5],
    "eta": [0.0, 0.2, 0.6, 1.0, 2.0],
    "tau": [0.005, 0.01, 0.02, 0.05, 0.1],
    "kappa": [0.25, 0.5, 1.0, 2.0, 4.0, 8.0],
    "gamma": [0.5, 1.0, 2.0, 4.0, 6.0],
    "c_miss": [0.0, 0.1, 0.2, 0.8, 1.6],
}
LEAST = 0.01  # of the baseline's AUC at its best deadline: the smallest effect that counts
LEAST_QOC = LEAST / 4  # the same at QoC = 1/2, where dQ = -dJ/J / 4


class Unit(NamedTuple):
    """How numbers are shown: J* is the baseline's AUC at its best deadline."""

    name: str
    scale: float
    form: str


UNITS = {
    "J*": Unit("% of J*", 100.0, "+.1f"),
    "spread": Unit("%", 100.0, "+.1f"),
    "share": Unit("%", 100.0, ".1f"),
    "QoC": Unit("QoC", 1.0, "+.4f"),
    "m": Unit("m", 1.0, "+.3f"),
}


@dataclass(frozen=True)
class Setting:
    """What is simulated, and how it is scored."""

    scenario: Scenario = field(default_factory=Scenario)
    rules: Rules = field(default_factory=Rules)
    path: Path = field(default_factory=paper_network)
    edge: Edge = field(default_factory=Edge)
    baseline: Design = field(default_factory=Design)
    min_reliability: float = MIN_RELIABILITY
    scale_of_baseline: bool = False  # J_med and J_max of the baseline's runs alone


@dataclass(frozen=True)
class Part:
    """A difference by seed [S], or whether something happened [S], and the side of a bound that is claimed for it."""

    what: str
    values: np.ndarray
    unit: str  # of `UNITS`
    bound: float
    above: bool = True

    def interval(self, confidence: float = 0.95) -> Estimate:
        """Mean with its interval: Student's, and Wilson's for shares."""
        if self.values.dtype != bool:
            return estimate(self.values, confidence)
        share, count = float(self.values.mean()), self.values.size
        z2 = float(special.ndtri(0.5 + confidence / 2)) ** 2
        middle, half = share + z2 / (2 * count), np.sqrt(z2 * (share * (1 - share) / count + z2 / (4 * count**2)))
        se = float(np.sqrt(share * (1 - share) / count))
        return Estimate(share, se, *((middle + sign * half) / (1 + z2 / count) for sign in (-1, 1)))

    def room(self) -> float:
        """Standard errors from the bound, negative on the wrong side."""
        found = self.interval()
        gap = (found.mean - self.bound) * (1 if self.above else -1)
        half = (found.high - found.low) / 2
        return gap / half if half > 0 else np.copysign(np.inf, gap)

    def side(self, confidence: float = 0.95) -> int:
        """1 where the interval lies on the right side of the bound, -1 on the wrong one, 0 across it."""
        found = self.interval(confidence)
        side = int(found.low > self.bound) - int(found.high < self.bound)
        return side if self.above else -side

    def text(self) -> str:
        """What it came to, for a reader."""
        found, shown = self.interval(), UNITS[self.unit]
        mean, low, high = (format(shown.scale * each, shown.form) for each in (found.mean, found.low, found.high))
        return f"{self.what}: {mean} [{low}, {high}] {shown.name}"


@dataclass(frozen=True)
class Finding:
    """What became of a conclusion."""

    conclusion: Conclusion
    parts: list[Part]
    note: str = ""

    @property
    def verdict(self) -> str:
        """`holds`, `does not hold` or `undecided`."""
        if all(part.side() > 0 for part in self.parts):
            return "holds"
        each = 1 - 0.05 / len(self.parts)
        return "does not hold" if any(part.side(each) < 0 for part in self.parts) else "undecided"

    @property
    def deciding(self) -> Part:
        """The difference that is farthest on the wrong side, or nearest to it."""
        return min(self.parts, key=Part.room)


class Bench:
    """A setting on common random numbers: half as many seeds to choose on as to judge on."""

    def __init__(self, setting: Setting, seeds: int) -> None:
        self.setting = setting
        self.judging = range(FIRST_SEED, FIRST_SEED + seeds)
        self.choosing = range(2 * FIRST_SEED, 2 * FIRST_SEED + max(2, seeds // 2))
        self.network = with_edge(setting.path, setting.edge)
        quick = LoopNetwork(compute=TruncatedNormal(0.02, 0.005), name="fast")
        self.fast = with_edge(quick, setting.edge)

    def runs(self, seeds: range, network: Network | None = None, **values: float | list[float]) -> xr.Dataset:
        """Runs of the baseline with other values; deadlines in ms as `deadline_ms`."""
        deadline = np.asarray(values.pop("deadline_ms"), float) / 1e3
        designs = replace(self.setting.baseline, deadline=deadline, **values)
        return evaluate(self.setting.scenario, designs, network or self.network, seeds, rules=self.setting.rules)

    def auc(self, *, seeds: range | None = None, network: Network | None = None, **values: float | list[float]):
        """[G, S] mean over robots, by default on the judging seeds."""
        return self.runs(seeds or self.judging, network, **values)["auc"].values.astype(float).mean(axis=-1)

    @cached_property
    def best(self) -> tuple[float, float]:
        """The baseline's best deadline (ms) and its AUC there, J*, on the choosing seeds."""
        mean = self.auc(seeds=self.choosing, deadline_ms=AXIS_MS.tolist()).mean(axis=1)
        return float(AXIS_MS[mean.argmin()]), float(mean.min())

    def change(self, name: str, low: float, high: float, deadline_ms: float, network: Network | None = None):
        """[S] AUC with the parameter at `high` less AUC with it at `low`, relative to J*."""
        lower, upper = self.auc(network=network, deadline_ms=deadline_ms, **{name: [low, high]})
        return (upper - lower) / self.best[1]

    @cached_property
    def study(self) -> Study:
        """The six sweeps, with the policies' choices."""
        setting = self.setting
        scale = None
        if setting.scale_of_baseline:
            scale = QocScale.of(self.runs(self.choosing, deadline_ms=AXIS_MS.tolist())["auc"].values)
        return run_study(
            setting.scenario, one_at_a_time(setting.baseline, GRIDS, AXIS_MS / 1e3), self.network, self.choosing,
            self.judging, rules=setting.rules, min_reliability=setting.min_reliability, scale=scale,
        )  # fmt: skip

    def best_scores(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Each value of a sweep at its own best deadline: QoC when chosen [V], and on the judging seeds [V, S]."""
        rows = self.study.results[self.study.results["sweep"] == name]
        rows = rows.loc[rows.groupby("value")["qoc"].idxmax()]
        runs = self.runs(self.judging, deadline_ms=(1e3 * rows["deadline"]).tolist(), **{name: rows["value"].tolist()})
        return rows["qoc"].to_numpy(), qoc_by_seed(runs, self.study.scale)

    def completing(self, deadline_ms: float) -> str:
        """Share of loops that complete at the usual sampling period."""
        tau = self.setting.baseline.tau
        return f"{float(reliability_of(self.network, self.setting.scenario, deadline_ms / 1e3, tau).share):.1%}"


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
        return Finding(self, *self.test(bench))


def ratio(upper: np.ndarray, lower: np.ndarray) -> np.ndarray:
    """[S] Values whose mean is the ratio of the means, and whose spread is, to first order, that of the ratio."""
    share = upper.mean() / lower.mean()
    return share + (upper - share * lower) / lower.mean()


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
        table = study.policies.set_index(["sweep", "policy"])
        for sweep in GRIDS:
            both = [scores[_place(bench, table.loc[(sweep, name)], sweep)] for name in ("Co-design", policy)]
            parts.append(Part(f"sweep of {sweep}", both[0] - both[1], "QoC", LEAST_QOC))
        best = 1e3 * table.xs("Co-design", level="policy")["deadline"]
        other = 1e3 * table.xs(policy, level="policy")["deadline"]
        return (
            parts,
            f"Co-design's Δ is {best.min():g} to {best.max():g} ms, {policy}'s {other.min():g} to {other.max():g} ms",
        )

    return test


def _place(bench: Bench, row, sweep: str) -> int:
    design = replace(bench.setting.baseline, deadline=float(row["deadline"]), **{sweep: float(row["value"])})
    return place_of(bench.study.evaluation, design)


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
    table = bench.study.policies.set_index(["sweep", "policy"])
    collided = bench.study.evaluation["collided"].values
    return [
        Part(f"runs that come too close, sweep of {sweep}",
             collided[_place(bench, table.loc[(sweep, "Co-design")], sweep)].astype(bool), "share", 0.05, above=False)
        for sweep in GRIDS if sweep != "eta"
    ], ""  # fmt: skip


CONCLUSIONS = (
    Conclusion("1a", "AUC falls steeply between Δ = 100 and 200 ms", steep_fall),
    Conclusion("1b", "An intermediate Δ is best: worst at 0, slowly worse after", intermediate),
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
