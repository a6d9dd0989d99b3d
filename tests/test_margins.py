"""Margins and sensitivity: exact answers on made-up scores, single evaluations, laws of worse networks."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest
import xarray as xr
from scipy import special

from qocjax import Design, QocScale, Rules, Scenario, paper_network
from qocjax.advice.margins import deadline_margin
from qocjax.advice.plane import Plane, delay_reliability_plane, largest_delay, smallest_reliability
from qocjax.advice.reaching import reach
from qocjax.advice.slack import Asked, find_slack
from qocjax.advice.stress import GROWTHS, largest_growth, stress_table
from qocjax.advice.target import Target, collision_excess
from qocjax.network import (
    Constant,
    Edge,
    GilbertElliott,
    IndependentLoss,
    Leg,
    Load,
    LoopNetwork,
    Trace,
    loop_times,
    with_edge,
)
from qocjax.network.stressed import Stressed
from qocjax.search.objective import Objective
from qocjax.search.sensitivity import Box, elasticities, sobol
from qocjax.statistics.estimates import share
from qocjax.statistics.scores import Scores

SCENARIO = Scenario(start=[[-0.6, -0.5, 0.3], [-0.6, 0.5, 0.0]], goal=[1.0, 0.0], horizon=4.0)
BASE = Design(tau=0.1, deadline=0.3)
LOAD = Load(40, 2, 0.1)
SCALE = QocScale(1.0, 10.0)


def a_plane(seeds: int = 20) -> Plane:
    """QoC = 0.7 - delay + 0.3 F + noise of the seed: what is linear, interpolation gets exactly."""
    delay, share = np.linspace(0.1, 0.5, 5), np.array([0.1, 0.4, 1.0])
    noise = np.random.default_rng(0).normal(0, 0.02, seeds)
    scores = 0.7 - delay[None, :, None] + 0.3 * share[:, None, None] + noise
    return Plane(delay, share, scores, scores, np.zeros(scores.shape, bool), 2)


def test_inverse_questions_on_a_linear_plane() -> None:
    plane = a_plane()
    shift = plane.qoc[0, 0] - (0.7 - 0.1 + 0.03)
    found = largest_delay(plane, 0.6, 0.7)
    assert found.value == pytest.approx(0.7 + 0.21 - 0.6 + shift)
    assert found.low < found.value < found.high and not found.at_edge
    # Its interval is that of the mean of the noise: about 1.96 standard errors each way.
    se = np.std(plane.scores[0, 0], ddof=1) / np.sqrt(20)
    assert (found.high - found.low) / 2 == pytest.approx(1.96 * se, rel=0.25)
    back = smallest_reliability(plane, 0.6, found.value)
    assert back.value == pytest.approx(0.7)
    assert back.low < 0.7 < back.high


def test_what_is_met_nowhere_or_everywhere_is_said() -> None:
    plane = a_plane()
    nowhere, everywhere = largest_delay(plane, 2.0, 0.4), largest_delay(plane, 0.0, 0.4)
    assert (nowhere.value, nowhere.low, nowhere.high, nowhere.at_edge) == (None, None, None, False)
    assert (everywhere.value, everywhere.at_edge) == (0.5, True)
    assert smallest_reliability(plane, 2.0, 0.2).value is None
    assert smallest_reliability(plane, 0.0, 0.2) == replace(
        smallest_reliability(plane, 0.0, 0.2), value=0.1, at_edge=True
    )
    sometimes = largest_delay(plane, float(plane.qoc[1, 0]), 0.4)  # half of the resamples fall short of it everywhere
    assert sometimes.low is None and sometimes.high > 0.1


def test_margin_of_a_tent() -> None:
    axis = np.array([0.1, 0.2, 0.3, 0.45, 0.6, 0.7, 0.8])
    scores = 1.0 - 0.5 * np.abs(axis - 0.3)
    scores[-1] = 0.99  # as good, but not connected to the best
    margin = deadline_margin(axis, np.tile(scores[:, None], 4), Target("share_of_best", 0.95))
    assert (margin.best, margin.merit.mean) == (0.3, 1.0) and margin.reached
    assert margin.low.value == pytest.approx(0.2) and margin.high.value == pytest.approx(0.4)
    assert [margin.low.low, margin.low.high] == pytest.approx([0.2, 0.2])  # all seeds alike: nothing to be unsure of
    assert margin.holds(0.2) and margin.holds(0.4) and not margin.holds(0.41)
    whole = deadline_margin(axis, np.tile(scores[:, None], 4), Target("share_of_best", 0.5))
    assert (whole.low.value, whole.high.value) == (0.1, 0.8)
    assert whole.low.at_edge and whole.high.at_edge


@pytest.mark.parametrize("actuation", ["deadline", "arrival"])
def test_a_cell_of_the_plane_is_a_network_of_its_own(actuation: str) -> None:
    objective = Objective(SCENARIO, paper_network(), SCALE, Rules(actuation), key=3)
    plane = delay_reliability_plane(objective, BASE, [0.25, 0.1], [0.3], range(4))
    np.testing.assert_array_equal(plane.delay, [0.1, 0.25])
    assert plane.scores.shape == (1, 2, 4) and objective.simulations == 8
    network = LoopNetwork(uplink=Leg(loss=IndependentLoss(0.7)), compute=Constant(0.25), name="one")
    alone = replace(objective, network=network).scores(replace(BASE, deadline=0.25), range(4))
    np.testing.assert_allclose(plane.scores[0, 1], alone[0], rtol=1e-5)
    table = plane.to_table()
    assert len(table) == 2 and np.isfinite(table.to_numpy()).all()


def test_bad_input_of_margins() -> None:
    objective = Objective(SCENARIO, paper_network(), SCALE)
    with pytest.raises(ValueError, match="reliabilities: got 1.2"):
        delay_reliability_plane(objective, BASE, [0.1], [0.5, 1.2], range(4))
    with pytest.raises(ValueError, match="delays: got .* each once"):
        delay_reliability_plane(objective, BASE, [0.1, 0.1], [1.0], range(4))
    with pytest.raises(ValueError, match="seeds: got 1"):
        delay_reliability_plane(objective, BASE, [0.1], [1.0], range(1))
    with pytest.raises(ValueError, match="reliability: got 0.05"):
        largest_delay(a_plane(), 0.5, 0.05)
    with pytest.raises(ValueError, match="deadlines: got"):
        deadline_margin([0.2, 0.1], np.zeros((2, 3)))
    with pytest.raises(ValueError, match="axis: got"):
        reach([0.2, 0.1], np.zeros((2, 3)), 0.5)
    for name, value in (("plane_seeds", 1), ("reliability", 0.0), ("delay", -1.0), ("delays", 2),
                        ("points", 12), ("seeds", 1)):  # fmt: skip
        with pytest.raises(ValueError, match=f"margins.{name}: got {value}"):
            Asked(**{name: value})
    with pytest.raises(ValueError, match="margins.delay: got 0.9"):
        find_slack(objective, BASE, 0.5, range(4), Asked(delay=0.9))


def test_a_target_in_each_of_its_units() -> None:
    """Merits by hand: seeds that keep a time or a distance count 1, AUC counts by itself."""
    runs = xr.Dataset({
        "auc": (("design", "seed", "robot"), [[[2.0, 4.0], [np.inf, 5.0], [1.0, 1.0]]]),
        "arrival_time": (("design", "seed", "robot"), [[[3.0, 7.9], [np.inf, 2.0], [8.0, 8.0]]]),
        "min_distance": (("design", "seed"), [[0.3, 0.1, 0.5]]),
    })  # fmt: skip
    scores = Scores.of(runs["auc"].values, SCALE)
    for target, merits, level in (
        (Target("share_of_best", 0.9), scores.values[0], 0.45),
        (Target("auc_s", 6.0), [-3.0, -5.0, -1.0], -6.0),
        (Target("time_to_goal_s", 8.0), [1.0, 0.0, 1.0], 0.95),
        (Target("closest_m", 0.3), [1.0, 0.0, 1.0], 0.95),
    ):
        np.testing.assert_allclose(target.merits(runs, scores)[0], merits)
        assert target.level(0.5) == pytest.approx(level) and f"{target.value:g}" in target.text
    for kind, value in (("share_of_best", 1.2), ("auc_s", 0.0), ("time_to_goal_s", -1.0), ("closest_m", 0.0)):
        with pytest.raises(ValueError, match=f"margins.target.{kind}: got {value:g}"):
            Target(kind, value)
    with pytest.raises(ValueError, match="margins.target: got 'qoc'"):
        Target("qoc", 0.5)
    with pytest.raises(ValueError, match="time_to_goal_s: got 9, expected at most the 4 s of a run"):
        Target("time_to_goal_s", 9.0).check(SCENARIO)
    with pytest.raises(ValueError, match="closest_m: got it for one robot"):
        Target("closest_m", 1.0).check(Scenario(start=[[0.0, 0.0, 0.0]]))


def test_a_margin_ends_where_collisions_break_their_limit() -> None:
    axis, flat = np.array([0.1, 0.2, 0.3, 0.4]), np.tile([[0.9], [1.0], [0.99], [0.98]], 4)
    excess = np.array([-0.1, -0.1, -0.1, 0.3])
    margin = deadline_margin(axis, flat, Target(), excess=excess)
    assert margin.low.value == pytest.approx(0.15) and margin.high.value == pytest.approx(0.325)
    missed = deadline_margin(axis, -flat, Target("auc_s", 0.5), excess=excess)
    assert not missed.reached and missed.low.value is None and missed.high.value is None and missed.best == 0.1
    assert not missed.holds(0.1) and missed.best_text == "an AUC of 0.9 [0.9, 0.9] s, at 100 ms"
    with pytest.raises(ValueError, match="excess: got 0.1"):
        deadline_margin(axis, flat, Target(), excess=0.1)
    hits = np.zeros((2, 400), bool)
    hits[1, :40] = True
    upper = special.betaincinv(41, 360, 0.975)  # Clopper and Pearson
    close = [share(each) for each in hits]
    np.testing.assert_allclose(collision_excess(close, 0.05), [1 - 0.025 ** (1 / 400) - 0.05, upper - 0.05], atol=1e-9)
    assert collision_excess(close, 0.0)[0] == 0.0  # that none breaks a limit of 0 cannot be shown
    plane = a_plane(400)
    risky = replace(plane, collided=np.broadcast_to(plane.delay[None, :, None] > 0.35, plane.scores.shape))
    found = largest_delay(risky, 0.3, 0.4, limit=0.05)
    ends = np.array([1 - 0.025 ** (1 / 400), 1.0]) - 0.05
    assert found.value == pytest.approx(0.3 + 0.1 * ends[0] / (ends[0] - ends[1])) and found.value < 0.31
    table = risky.to_table().set_index("delay")
    assert (table.loc[0.5, "collision_low"] > 0.98).all() and (table.loc[0.1, "collision_high"] < 0.01).all()


class Formula:
    """In place of an objective: QoC by a formula of the design, times a factor of the seed."""

    def __init__(self, formula) -> None:
        self.formula, self.simulations = formula, 0

    def scores(self, designs: Design, seeds) -> np.ndarray:
        noise = 1 + 0.1 * np.random.default_rng(1).normal(size=len(seeds))
        return self.formula(designs)[:, None] * noise

    def units(self, seeds, tau) -> np.ndarray:
        return np.asarray(seeds)


def test_elasticities_of_a_power_law() -> None:
    objective = Formula(lambda d: 0.3 * np.asarray(d.kappa) ** 0.5 * np.asarray(d.gamma) ** -0.2 * (1 + 0 * d.eta))
    table = elasticities(objective, BASE, range(16), ["kappa", "gamma", "eta"], step=0.1).set_index("parameter")
    for name, power in (("kappa", 0.5), ("gamma", -0.2), ("eta", 0.0)):
        assert table.loc[name, "elasticity"] == pytest.approx(np.sinh(0.1 * power) / 0.1, abs=1e-12)
        assert table.loc[name, "se"] < 1e-12  # the factor of the seed cancels
    with pytest.raises(ValueError, match="eta: got 0"):
        elasticities(objective, replace(BASE, eta=0.0), range(4), ["eta"])
    with pytest.raises(ValueError, match="names: got 'weight'"):
        elasticities(objective, BASE, range(4), ["weight"])


def test_sobol_indices_of_a_sum() -> None:
    """Of x1 + 2 x2 with independent uniforms the shares of variance are 1/5 and 4/5, of a third one 0."""
    bounds = {"kappa": (1.0, np.e), "c_miss": (0.0, 1.0), "gamma": (1.0, 2.0)}
    objective = Formula(lambda d: np.log(d.kappa) + 2 * d.c_miss)
    table = sobol(objective, Box(BASE, bounds), [0.1, 0.2], range(4), points=512).set_index("parameter")
    for name, part in (("kappa", 0.2), ("c_miss", 0.8), ("gamma", 0.0), ("deadline", 0.0)):
        assert table.loc[name, "first"] == pytest.approx(part, abs=0.03)
        assert table.loc[name, "total"] == pytest.approx(part, abs=0.03)
        assert table.loc[name, "total_low"] <= part + 0.02 and table.loc[name, "total_high"] >= part - 0.02
    with pytest.raises(ValueError, match="same all over"):
        sobol(Formula(lambda d: 1 + 0 * d.kappa), Box(BASE, bounds), [0.1], range(4), points=8)
    with pytest.raises(ValueError, match="power of two"):
        sobol(objective, Box(BASE, bounds), [0.1], range(4), points=12)


def test_box_spans_its_bounds() -> None:
    box = Box(BASE, {"kappa": (0.5, 8.0), "c_miss": (0.0, 1.0)})
    designs = box.designs(np.array([[0, 0], [0.5, 0.25], [1, 1]]), np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(designs.kappa, [0.5, 2.0, 8.0])  # log scale
    np.testing.assert_allclose(designs.c_miss, [0.0, 0.25, 1.0])
    np.testing.assert_allclose(designs.tau, 0.1)
    for bounds, message in (({}, "bounds: got none"), ({"tau": (0.1, 1)}, "bounds: got 'tau'"),
                            ({"eta": (2, 1)}, "bounds.eta: got"), ({"eta": (-1, 1)}, "bounds.eta: got")):  # fmt: skip
        with pytest.raises(ValueError, match=message):
            Box(BASE, bounds)


def test_slower_network_has_the_same_draws_longer() -> None:
    network, key = paper_network(), jax.random.key(0)
    slow = Stressed(network, delay_factor=1.5)
    keys = jax.random.split(key, 3)
    np.testing.assert_allclose(loop_times(slow, keys, 50, 2, 0.1), 1.5 * loop_times(network, keys, 50, 2, 0.1))
    np.testing.assert_allclose(slow.reliability([0.3, 0.45], LOAD).share, network.reliability([0.2, 0.3]).share)


def test_doubled_losses_and_misses() -> None:
    lossy = LoopNetwork(uplink=Leg(loss=GilbertElliott(0.05, 0.25)), compute=Constant(0.1), name="bursts")
    p = 0.05 / 0.3
    double = Stressed(lossy, double_losses=True)
    assert double.reliability(0.2, LOAD).share == pytest.approx((1 - p) ** 2)
    lost = ~np.isfinite(loop_times(double, jax.random.key(1)[None], 40_000, 1, 0.1))[0, :, 0]
    assert lost.mean() == pytest.approx(1 - (1 - p) ** 2, abs=0.02)
    assert lost[1:][lost[:-1]].mean() > 0.6  # still in bursts; independent ones would follow at 0.31
    paper = paper_network()
    missing = Stressed(paper, miss_deadline=0.2)
    assert missing.reliability(0.2, LOAD).share == pytest.approx(float(paper.reliability(0.2).share) ** 2)
    times = np.asarray(loop_times(missing, jax.random.key(2)[None], 20_000, 1, 0.1))
    assert (times <= 0.2).mean() == pytest.approx(0.25, abs=0.015)
    assert Stressed(Trace([0.1, 0.2], "t"), 2.0).describe()["network"]["name"] == "t"


def test_slack_answers_what_is_asked() -> None:
    objective = Objective(SCENARIO, paper_network(), SCALE)
    asked = Asked(Target("share_of_best", 0.95), reliability=0.45, delay=0.22, delays=3)
    found = find_slack(objective, BASE, 0.6, range(4), asked)
    assert (found.delay, found.reliability, found.reached) == (0.22, 0.45, True)
    plane = found.plane
    assert {0.22, 0.3} <= set(plane["delay"]) and 0.45 in set(plane["reliability"])
    row = plane[plane["reliability"] == 0.45].set_index("delay")["qoc"]
    assert row.index[0] <= 0.5 * 0.22 and row.iloc[0] > found.level > row.iloc[-1]  # no cliff is hidden
    assert np.interp(found.largest_delay.value, row.index, row) == pytest.approx(found.level, abs=1e-6)
    own = find_slack(objective, BASE, 0.6, range(4), Asked(Target("share_of_best", 0.9), delays=3))
    here = float(paper_network().reliability(0.3).share)
    cell = own.plane.set_index(["reliability", "delay"])["qoc"][here, 0.3]
    assert own.level == pytest.approx(0.9 * cell) and own.reliability == here and own.delay == 0.3
    quick = find_slack(objective, BASE, 0.6, range(4), Asked(Target("auc_s", 1e-3), delays=3))
    assert not quick.reached and quick.largest_delay.value is None and quick.smallest_reliability.value is None


def test_loops_may_grow_until_they_miss_the_deadline() -> None:
    """Constant loops of 0.2 s just meet 0.3 s at 1.5 times their length; beyond it none completes."""
    network = LoopNetwork(compute=Constant(0.2), name="constant")
    objective = Objective(SCENARIO, network, SCALE)
    found = largest_growth(objective, BASE, range(4), Target())
    place = GROWTHS.index(1.5)
    assert GROWTHS[place] <= found.value < GROWTHS[place + 1]
    assert objective.simulations == 4 * len(GROWTHS)
    table = stress_table(objective, BASE, {"current": replace(BASE, deadline=0.2)}, range(4)).set_index("what")
    assert table.loc["all loop times x 1.5", "change"] == 0
    assert table.loc["as it is", "current_qoc"] > table.loc["all loop times x 1.25", "current_qoc"]  # 0.25 s miss 0.2 s
    safe = largest_growth(objective, replace(BASE, deadline=0.7), range(4), Target())
    assert safe.value == GROWTHS[-1] and safe.at_edge


def test_worse_networks_that_differ_in_numbers_share_their_programs() -> None:
    """The draws of all are those of the network, and the factor is a number that a program takes."""
    edge = with_edge(paper_network(), Edge(discipline="skip"))
    networks = [Stressed(edge, delay_factor=factor) for factor in (1.05, 1.3, 2.0)]
    assert len({network.drawn_as for network in networks}) == 1
    assert len({jax.tree.structure(network) for network in networks}) == 1
    assert Stressed(edge, double_losses=True).drawn_as != networks[0].drawn_as
    back = jax.tree.unflatten(jax.tree.structure(networks[0]), jax.tree.leaves(networks[1]))
    assert back == networks[1]
