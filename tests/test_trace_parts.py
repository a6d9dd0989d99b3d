"""The worst part of a trace as a change of its own: which it is, who judges it, and where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qocjax import Design, QocScale, Scenario, paper_network
from qocjax.advice.robust import _Bench
from qocjax.advice.stress import stress_table
from qocjax.advice.trace_parts import WORST_PART, worst_part, worst_stretch
from qocjax.network import ComputedTrace, Constant, Edge, Trace
from qocjax.network.edge_network import EdgeNetwork
from qocjax.search import stacked
from qocjax.search.objective import Objective
from qocjax.statistics.scores import Scores
from qocjax.statistics.units import judged_apart, rows_of_stretch, seeds_apart, seeds_in, units_of

SCENARIO = Scenario(start=[[-0.6, -0.5, 0.3], [-0.6, 0.5, 0.0]], goal=[1.0, 0.0], horizon=4.0)
BASE = Design(tau=0.1, deadline=0.15)
SCALE = QocScale(1.0, 10.0)
ROWS = 16 * 80  # 16 stretches, each of two runs


def trace(slow: tuple[int, ...] = (5, 10)) -> Trace:
    """Independent loops, 30 % of them late; 80 % on some stretches, by default one that chooses and one that judges."""
    rng = np.random.default_rng(3)
    late = np.repeat([0.8 if stretch in slow else 0.3 for stretch in range(16)], ROWS // 16)
    return Trace(np.where(rng.random(ROWS) < late, 0.3, rng.uniform(0.05, 0.1, ROWS)), "parts", period=0.1)


def goal(network=None) -> Objective:
    return Objective(SCENARIO, trace() if network is None else network, SCALE)


def test_the_worst_stretch_is_the_least_mean() -> None:
    scores = Scores(np.array([[0.5, 0.1, 0.3, 0.3]]), np.zeros((1, 4)), SCALE, np.array([-1, -1, -2, -2]))
    np.testing.assert_allclose(worst_stretch(scores), [0.3])
    np.testing.assert_allclose(worst_stretch(replace(scores, units=np.array([-1, -2, -2, -1]))), [0.2])


def test_further_seeds_of_the_stretch_judge_it() -> None:
    objective = goal()
    fresh = seeds_apart(objective.network, 0, [32, 64], SCENARIO.horizon, 0.1)[-1]
    designs = stacked([BASE, replace(BASE, deadline=0.35)])
    scores = objective.judged(objective.runs(designs, fresh))
    part = worst_part(objective, scores, designs)
    assert part is not None
    first, end = rows_of_stretch(objective.network, -1 - 5, SCENARIO.horizon, 0.1)
    assert (first, end) == (400, 480)
    seeds = part.runs["seed"].values
    assert len(seeds) == 64 and not set(seeds.tolist()) & set(fresh)
    assert (units_of(objective.network, seeds, 0, SCENARIO.horizon, 0.1) == -1 - 5).all()
    late = np.asarray(objective.network.delays)[first:end] > 0.15
    assert part.reliability.share == pytest.approx(1 - late.mean()) and 0.7 < late.mean() < 0.9
    assert part.change.given.mean == pytest.approx(part.scores.values[0].mean() - scores.values[0].mean())
    assert part.change.given.high < 0.0  # most loops are missed there
    assert part.scores.units is None and np.isfinite(part.scores[0].mean().given.se)


@pytest.mark.parametrize("behind_an_edge", [False, True])
def test_a_trace_with_a_computation_has_a_worst_part_too(behind_an_edge: bool) -> None:
    network = ComputedTrace(trace(), Constant(0.01))
    objective = goal(EdgeNetwork(network, Edge()) if behind_an_edge else network)
    fresh = seeds_apart(objective.network, 0, [32, 64], SCENARIO.horizon, 0.1)[-1]
    scores = objective.judged(objective.runs(stacked([BASE]), fresh))
    part = worst_part(objective, scores, stacked([BASE]))
    assert part is not None and part.change.given.high < 0.0
    late = np.asarray(trace().delays)[400:480] > 0.14
    near = 4 * float(part.reliability.error) + 1e-6  # behind an edge F is simulated
    assert (near > 1e-5) == behind_an_edge and float(part.reliability.share) == pytest.approx(1 - late.mean(), abs=near)


@pytest.mark.slow
def test_it_is_a_row_of_its_own_where_the_trace_is_long_enough() -> None:
    table = stress_table(goal(), BASE, {"current": replace(BASE, deadline=0.35)}, range(64)).set_index("what")
    assert table.index[1] == WORST_PART
    row = table.loc[WORST_PART]
    assert row["qoc"] < table.loc["as it is", "qoc"] and row["current_qoc"] > row["qoc"]  # 0.35 s waits for all
    for network in (paper_network(), Trace(np.asarray(trace().delays)[:320], "short", period=0.1)):
        assert not judged_apart(network, SCENARIO.horizon, 0.1)
        scores = goal(network).judged(goal(network).runs(stacked([BASE]), range(8)))
        assert worst_part(goal(network), scores, stacked([BASE])) is None


def test_seeds_of_a_stretch_are_beyond_all_others() -> None:
    found = seeds_in(trace(), 0, -1 - 5, 40, SCENARIO.horizon, 0.1)
    assert len(set(found)) == 40 and min(found) >= 1 << 24
    assert (units_of(trace(), found, 0, SCENARIO.horizon, 0.1) == -6).all()
    with pytest.raises(ValueError, match="unit: got -17, expected a stretch of trace 'parts'"):
        seeds_in(trace(), 0, -17, 1, SCENARIO.horizon, 0.1)


def test_what_chooses_looks_at_its_own_worst_stretch_alone() -> None:
    objective = goal(trace(slow=(10,)))
    choice, fresh = seeds_apart(objective.network, 0, [64, 64], SCENARIO.horizon, 0.1)
    units = [units_of(objective.network, seeds, 0, SCENARIO.horizon, 0.1) for seeds in (choice, fresh)]
    assert -11 in units[0] and -11 not in units[1]
    designs = stacked([BASE, replace(BASE, deadline=0.3)])
    scores = objective.judged(objective.runs(designs, choice))
    bench = _Bench(objective, choice, scores.values.mean(axis=0))
    assert (bench.worst(designs, scores) <= worst_stretch(scores)).all()
    low = replace(scores, values=scores.values - 1.0)  # stretches that are worse than any change of the network
    np.testing.assert_allclose(bench.worst(designs, low), worst_stretch(scores) - 1.0)
