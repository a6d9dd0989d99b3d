"""Advice: what is said of a network, the search under its limit, and the command line."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml
from hydra import compose, initialize_config_dir
from matplotlib.figure import Figure

from qocjax import Design, QocScale, Rules, paper_network
from qocjax.advice.advice import Advice, plain
from qocjax.advice.character import candidate_deadlines, characterise, quantiles
from qocjax.advice.little import Little
from qocjax.advice.margins import Margin
from qocjax.advice.reaching import Bound
from qocjax.advice.shortlist import Effort, shortlist
from qocjax.advice.target import Target
from qocjax.advice.verdict import answer_of
from qocjax.commands.advise import advice_values, page, run
from qocjax.commands.advise import run as advise_run
from qocjax.commands.codesign import run as codesign_run
from qocjax.config import conf_dir, load
from qocjax.config.advise import AdviseConfig
from qocjax.config.codesign import CodesignConfig
from qocjax.figures.margins import delay_reliability_map
from qocjax.figures.sensitivity import sensitivity_bars
from qocjax.nav2 import nav2_text
from qocjax.network import Edge, GilbertElliott, Leg, Load, LoopNetwork, Trace, TruncatedNormal, with_edge
from qocjax.search.sensitivity import Box
from qocjax.statistics.estimates import Estimate

LATE = Design(tau=0.1, deadline=0.7)
LOAD = Load(40, 2, 0.1)
BOUNDS = {"kappa": (0.5, 4.0), "gamma": (1.0, 6.0)}
# As many seeds everywhere: few programs to compile.
SMALL = ["scenario.horizon=4", "scenario.start=[[-0.6,-0.5,0.3],[-0.6,0.5,0.0]]", "scenario.goal=[1,0]", "loop.tau=0.1",
         "advise.points=4", "advise.rounds=[8]", "advise.finalists=3", "advise.fresh_seeds=8",
         "advise.max_collision_share=1", "advise.margins.delays=3", "advise.margins.seeds=8", "advise.margins.points=4",
         "advise.bounds.kappa=[0.5,4]", "advise.bounds.gamma=[1,6]", "advise.bounds.eta=null",
         "advise.bounds.c_miss=null", "advise.slowest=null", "advise.deadline_ms=700", "figures=false"]  # fmt: skip


def lossy() -> LoopNetwork:
    leg = Leg(loss=GilbertElliott(0.05, 0.2))
    return LoopNetwork(uplink=leg, compute=TruncatedNormal(0.2, 0.05), name="lossy")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("advice")


@pytest.fixture(scope="module")
def advice(folder: Path) -> Advice:
    with initialize_config_dir(str(conf_dir().resolve()), version_base="1.3"):
        return run(load(AdviseConfig, compose("advise", SMALL)), folder)


@pytest.fixture
def composer() -> Iterator[None]:
    with initialize_config_dir(str(conf_dir().resolve()), version_base="1.3"):
        yield


@pytest.mark.parametrize(("name", "value"), [("loop.tau", 20), ("network.compute", 20)])
def test_milliseconds_in_the_place_of_seconds_are_remarked(name: str, value: float, composer: None) -> None:
    options = ["network=trace", "network.path=any.csv", f"{name}={value}"]
    (said,) = load(AdviseConfig, compose("advise", options)).remarks()
    assert said == f"{name}: {value} is in seconds; {value} ms are {name}={value / 1e3:g}"
    assert load(AdviseConfig, compose("advise", options[:2])).remarks() == []


def test_quantiles_invert_reliability() -> None:
    law, levels = TruncatedNormal(0.2, 0.05), [0.01, 0.5, 0.99]
    np.testing.assert_allclose(quantiles(paper_network(), LOAD, levels), law.quantile(levels), rtol=1e-5)
    found = quantiles(lossy(), LOAD, [0.4, 0.81])  # a fifth is lost
    assert found[0] == pytest.approx(float(law.quantile(0.5)), rel=1e-4) and found[1] == np.inf


def test_candidate_deadlines_reach_their_shares() -> None:
    axis = candidate_deadlines(paper_network(), LOAD, 0.8)
    assert np.all(np.diff(axis) > 0) and axis[-1] == 0.8
    share = paper_network().reliability(axis).share
    assert 0.02 <= share[0] < 0.04 and np.sum((share > 0.05) & (share < 0.95)) >= 4
    with pytest.raises(ValueError, match="longest_deadline: got 20 ms, by which"):
        candidate_deadlines(paper_network(), LOAD, 0.02)


def test_character_of_a_trace_counts_by_hand() -> None:
    trace = Trace(np.array([1, 9, 9, 1, 1, 9, np.inf, 1]) * 1e-3, "hand")
    found = characterise(trace, LOAD, 5e-3)
    assert found["lost_share"] == pytest.approx(1 / 8) and found["reliability"] == 0.5
    assert found["mean_miss_run"] == 2.0 and found["p99_miss_run"] == 2 and found["independent_miss_run"] == 2.0
    assert found["gilbert_elliott"] == {"p_good_to_bad": pytest.approx(2 / 3), "p_bad_to_good": pytest.approx(2 / 4)}
    assert found["percentiles_ms"]["p50"] == pytest.approx(1.0) and found["percentiles_ms"]["p95"] == pytest.approx(9.0)
    calm = characterise(Trace(np.full(50, 1e-3), "calm"), LOAD, 5e-3)
    assert calm["mean_miss_run"] is None and calm["miss_correlation"] is None and calm["p99_miss_run"] == 0


def test_character_finds_the_channel_that_made_the_losses() -> None:
    found = characterise(lossy(), Load(300, 1, 0.1), 1.0)  # 32768 loops
    assert found["lost_share"] == pytest.approx(0.2, abs=1e-6)
    assert found["gilbert_elliott"]["p_good_to_bad"] == pytest.approx(0.05, abs=0.006)
    assert found["gilbert_elliott"]["p_bad_to_good"] == pytest.approx(0.2, abs=0.025)
    assert found["miss_correlation"] == pytest.approx(1 - 0.25, abs=0.03)  # 1 - p_gb - p_bg
    assert found["mean_miss_run"] == pytest.approx(5.0, rel=0.12)
    assert abs(found["delay_correlation"]) < 0.03


def test_advice_gains_on_a_deadline_that_is_too_long(advice: Advice) -> None:
    now, same_gains, by_mean, then = advice.judged.to_dict("records")
    assert by_mean["beyond"] == pytest.approx(by_mean["gain"] - then["gain"])
    assert now["gain"] == 0 and then["gain_low"] > 0
    assert same_gains["deadline"] == then["deadline"] < now["deadline"] == 0.7
    assert advice.policy == "MaxRel"
    assert float(advice.recommended.tau) == 0.1 and float(advice.recommended.eta) == LATE.eta  # not in the bounds
    for name, (low, high) in BOUNDS.items():
        assert low <= getattr(advice.recommended, name) <= high
    assert advice.margin.low.value <= advice.margin.best <= advice.margin.high.value
    assert advice.ties.iloc[0]["difference"] == 0  # the recommended ties with itself
    assert advice.seeds == {"search": 8, "choice": 8, "fresh": 8}


def test_stress_takes_loops_away(advice: Advice) -> None:
    rows = advice.stress.set_index("what")
    deadline, network = float(advice.recommended.deadline), with_edge(paper_network(), Edge(discipline="skip"))
    for factor in (1.25, 1.5):
        assert rows.loc[f"all loop times x {factor:g}", "reliability"] == pytest.approx(
            float(network.reliability(deadline / factor, LOAD).share)
        )
    assert "lost loops x 2" not in rows.index  # what a busy worker drops is not lost on the way
    shares = rows["completed_share"]
    assert shares["all loop times x 1.5"] < shares["as it is"] <= shares["as it is, deadline x 1.5"]
    assert shares["computing x 1.5"] < shares["as it is"]
    assert rows.loc["as it is", "change"] == 0 and rows["current_qoc"].notna().sum() == 5
    assert set(rows["stands"]) <= {"yes", "no", "not shown"} and rows["stands"].iloc[0] == "yes"  # 100 % may collide
    falls = rows["qoc"] < advice.target.level(rows["qoc"].iloc[0])
    assert (rows["stands"] == np.where(falls, "no", "yes")).all()


def test_nothing_written_is_nan(advice: Advice) -> None:
    values = yaml.safe_load(yaml.safe_dump(advice_values(advice)))
    flat = str({name: value for name, value in values.items() if name != "network"})  # a law may reach to infinity
    assert "nan" not in flat and "inf" not in flat.replace("info", "")
    assert values["recommended"]["deadline"] == pytest.approx(float(advice.recommended.deadline))
    assert "nan" not in page(advice).lower()
    assert plain({"a": np.float64(np.nan), "b": np.inf, "c": np.int64(3), "d": [np.bool_(True)]}) == {
        "a": None, "b": None, "c": 3, "d": [True]}  # fmt: skip


def test_nav2_fragment_is_yaml_in_their_names(advice: Advice) -> None:
    text = nav2_text(advice, Rules())
    found = yaml.safe_load(text)
    controller = found["controller_server"]["ros__parameters"]
    assert controller["controller_frequency"] == 10.0 and isinstance(controller["controller_frequency"], float)
    assert controller["FollowPath"]["vx_max"] == pytest.approx(0.7)
    smoother = found["velocity_smoother"]["ros__parameters"]
    assert smoother["max_velocity"] == [0.7, 0.0, 1.4] and 0.1 < smoother["velocity_timeout"] <= 1.0
    assert f"lifespan: {round(advice.recommended.deadline * 1e9)}" in text
    stopped = yaml.safe_load(nav2_text(advice, Rules(hold="timeout", hold_timeout=0.35)))
    assert stopped["velocity_smoother"]["ros__parameters"]["velocity_timeout"] == 0.35


class Formula:
    """In place of an objective: AUC least at kappa = 2 and 0.3 s; a gain above `wild` collides."""

    def __init__(self, wild: float) -> None:
        self.wild, self.key, self.scale = wild, 0, QocScale(1.0, 10.0)

    def units(self, seeds: range, tau: object) -> np.ndarray:
        return np.arange(len(seeds))

    def runs(self, designs: Design, seeds: range) -> xr.Dataset:
        kappa, deadline = np.asarray(designs.kappa), np.asarray(designs.deadline)
        auc = 1 + np.log(kappa / 2) ** 2 + 10 * (deadline - 0.3) ** 2
        noise = 1 + 0.01 * np.random.default_rng(0).normal(size=(len(seeds), 2))
        collided = np.repeat((kappa > self.wild)[:, None], len(seeds), axis=1)
        return xr.Dataset({"auc": (("design", "seed", "robot"), auc[:, None, None] * noise),
                           "collided": (("design", "seed"), collided)})  # fmt: skip


@pytest.mark.parametrize(("wild", "best"), [(10.0, 2.0), (1.5, 1.5)])
def test_the_search_ends_at_the_best_that_keeps_the_limit(wild: float, best: float) -> None:
    box, axis = Box(LATE, {"kappa": (0.5, 8.0), "gamma": (1.0, 2.0)}), np.array([0.1, 0.2, 0.3, 0.5])
    found = shortlist(Formula(wild), box, axis, 0.01, Effort(32, (4, 8, 16), 5, 8), range(16))
    np.testing.assert_allclose(found.kappa, best, rtol=0.12)
    assert (np.asarray(found.kappa) <= wild).all() and (np.asarray(found.deadline) == 0.3).all()


def test_no_design_without_collisions_is_said() -> None:
    box = Box(LATE, {"kappa": (0.5, 8.0)})
    with pytest.raises(ValueError, match=r"max_collision_share: got 0.5, which no design .* has 1, with kappa="):
        shortlist(Formula(0.1), box, np.array([0.2]), 0.5, Effort(4, (8,), 2, 2), range(8))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["advise.bounds.v_max=[0.1,0.9]"], "advise.bounds.v_max: got 0.9, expected at most the robot's 0.7"),
        (["advise.bounds.kappa=[1]"], r"advise.bounds.kappa: got \[1"),
        (["advise.bounds.kappa=[2,1]"], r"advise.bounds.kappa: got \[2.0, 1.0\], expected \[low, high\]"),
        (["+advise.bounds.tau=[0.1,0.2]"], "advise.bounds: got tau, expected one of v_max, "),
        (["advise.slowest=2"], "advise.slowest: got 2"),
        (["advise.margins.points=5"], "margins.points: got 5, expected a power of two"),
        (["advise.margins.delay_ms=900"], "margins.delay: got 0.9, expected <= 0.8"),
        (["advise.bounds.kappa=null", "advise.bounds.gamma=null", "advise.slowest=null"], "bounds: got none"),
        (["advise.points=5"], "points: got 5, expected a power of two"),
        (["advise.rounds=[8, 4]"], r"rounds: got \[8, 4\]"),
        (["advise.longest_deadline_ms=30"], "longest_deadline: got 30 ms"),
        (["advise.max_collision_share=2"], "max_collision_share: got 2"),
        (
            ["advise.margins.target.auc_s=6", "advise.margins.target.closest_m=0.3"],
            "advise.margins.target: got auc_s and closest_m, expected one of share_of_best, auc_s",
        ),
        (["advise.margins.target.share_of_best=2"], "margins.target.share_of_best: got 2"),
        (["advise.margins.target.time_to_goal_s=5"], "time_to_goal_s: got 5, expected at most the 4 s of a run"),
        (["advise.margins.target=0.6"], "advise.margins.target: got 0.6"),
    ],
)
def test_bad_options_are_refused_by_name(composer: None, options: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        run(load(AdviseConfig, compose("advise", [*SMALL, *options])))


def test_bounds_are_set_and_dropped_by_name(composer: None) -> None:
    own = load(AdviseConfig, compose("advise", ["advise.bounds.gamma=[1,6]", "advise.bounds.c_miss=null"])).bounds()
    assert own == {"kappa": (0.25, 6.0), "gamma": (1.0, 6.0), "eta": (0.05, 2.0), "v_max": (0.3 * 0.7, 0.7)}
    options = ["robot=turtlebot3_burger", "advise.bounds.v_max=[0.1,0.2]"]
    assert load(AdviseConfig, compose("advise", options)).bounds()["v_max"] == (0.1, 0.2)


def test_the_command_writes_what_it_says(advice: Advice, folder: Path) -> None:
    values = yaml.safe_load((folder / "advice.yaml").read_text())
    assert values["current"]["deadline"] == 0.7 and values["slack"]["delay"] == values["recommended"]["deadline"]
    assert {path.name for path in folder.glob("*.yaml")} == {"advice.yaml", "nav2_params.yaml", "config.yaml"}
    text = page(advice)
    assert text.startswith("SET THIS: ") and "IS 700 ms ACCEPTABLE?" in text and len(text.splitlines()) < 60
    assert "all loop times may grow by" in text and "Sobol" in text
    assert list(values["sobol"][0]) == list(advice.sobol) and values["growth"]["value"] >= 1
    assert {path.stem for path in folder.glob("*.csv")} == {"curve", "plane", "elasticities", "sobol"}
    drawn = sensitivity_bars(advice.elasticities, advice.sobol).axes
    assert len(drawn[0].patches) == len(advice.elasticities) and len(drawn[1].patches) == 2 * len(advice.sobol)
    points = {name: (at, share) for name, at, share in advice.policies}
    assert isinstance(delay_reliability_map(advice.slack.plane, advice.curve, points), Figure)


def test_a_missing_trace_is_one_line(tmp_path: Path) -> None:
    options = [
        "network=trace",
        "network.path=none.csv",
        "network.column=rtt",
        "network.unit=s",
        f"hydra.run.dir={tmp_path}",
    ]
    done = subprocess.run([sys.executable, "-m", "qocjax.advise", *options], capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.strip() == "error: none.csv: no such file"


@pytest.mark.parametrize("command", ["advise", "codesign"])
def test_a_trace_is_not_replayed_faster_than_it_was_measured(command: str, composer: None, tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    path.write_text("sent(ms),rtt\n" + "".join(f"{50 * k},9\n" for k in range(20)))
    options = ["network=trace", f"network.path={path}", "network.column=rtt", "network.unit=ms"]
    model, main = {"advise": (AdviseConfig, advise_run), "codesign": (CodesignConfig, codesign_run)}[command]
    with pytest.raises(ValueError, match="measured with a loop every 50 ms .* and is replayed with one every (10|5)"):
        main(load(model, compose(command, options)))
    allowed = load(model, compose(command, [*options, "network.faster_than_measured=true"]))
    allowed.check_rate(allowed.build_network(), 0.01)
    load(model, compose(command, options)).check_rate(allowed.build_network(), 0.05)


def test_what_fresh_seeds_do_not_bear_out_is_said(advice: Advice) -> None:
    judged = advice.judged.assign(gain_low=-0.1)
    assert "do not show that it is better" in page(replace(advice, judged=judged))
    assert "CAUTION" not in page(replace(advice, judged=advice.judged.assign(gain_low=0.1)))
    for verdict, words in (("unsafe", "it breaks the limit on collisions"), ("not shown", "do not show that it keeps")):
        text = page(replace(advice, verdict=verdict))
        assert text.startswith("NO RECOMMENDATION") and words in text


def test_whether_the_present_deadline_may_stay(advice: Advice) -> None:
    """YES only where both QoC and the upper end of the collision share keep their limits."""
    ends = (Bound(0.2, 0.2, 0.2, False), Bound(0.4, 0.4, 0.4, False))
    margin = Margin(Target(), 0.3, Estimate(0.6, 0.01, 0.58, 0.62), *ends)

    def answer(deadline: float, low: float, high: float) -> str:
        return answer_of(pd.Series({"deadline": deadline, "collision_low": low, "collision_high": high}), margin, 0.05)

    assert answer(0.3, 0.0, 0.04) == "yes" and answer(0.3, 0.0, 0.06) == "not shown"
    assert answer(0.3, 0.06, 0.2) == answer(0.7, 0.06, 0.2) == "no: collisions"
    assert answer(0.7, 0.0, 0.0) == "no: target"
    for found, words in (("yes", "YES: "), ("no: collisions", "NO: "), ("not shown", "NOT SHOWN: "),
                         ("no: target", "NO: asked is that QoC is at least 0.95 of its best; with")):  # fmt: skip
        assert f"ACCEPTABLE? {words}" in page(replace(advice, acceptable=found))


def test_a_delay_that_hardly_matters_is_said_first(advice: Advice) -> None:
    """With the figures at both deadlines; not where the recommended one lies beyond, nor where collisions decide."""
    target = Target(little=Little(0.012, 0.105, 7.5))
    ends = (Bound(0.04, 0.04, 0.04, False), Bound(0.75, 0.75, 0.75, False))
    margin = Margin(target, 0.05, Estimate(0.8, 0.01, 0.78, 0.82), *ends)
    judged = advice.judged.assign(auc=[0.0059, 0.0005, 0.0005, 0.0005], collision_share=0.0, collision_low=0.0,
                                  collision_high=0.0, arrival_time=[15.3, 15.0, 15.0, 15.0], arrived_share=1.0,
                                  min_distance=np.inf)  # fmt: skip
    here = replace(advice, target=target, current_margin=margin, judged=judged, acceptable="yes: hardly matters")
    text = page(here)
    assert text.startswith("THE DELAY HARDLY MATTERS HERE, for deadlines from 40 to 750 ms.")
    for words in ("AUC is 0.0059 and 0.0005 s", "there after 15.3 and 15.0 s", "They are 0.07 m further",
                  "ACCEPTABLE? YES: one robot: nobody to collide with; QoC is lower"):  # fmt: skip
        assert words in text
    assert "inf" not in text.lower().replace("info", "") and "and collisions keep" not in text.split("IF THE")[0]
    short = Margin(target, 0.05, margin.merit, ends[0], Bound(0.1, 0.1, 0.1, False))
    for other in (replace(here, current_margin=short), replace(here, acceptable="no: collisions"),
                  replace(here, target=Target())):  # fmt: skip
        assert not page(other).startswith("THE DELAY")


def test_a_target_that_nothing_reaches_is_said(advice: Advice) -> None:
    target = Target("auc_s", 0.5)
    here = replace(advice.margin, target=target, merit=Estimate(-2.0, 0.1, -2.2, -1.8), best=0.3)
    own = replace(here, merit=Estimate(-3.0, 0.1, -3.2, -2.8), best=0.2)
    text = page(replace(advice, target=target, margin=here, current_margin=own, acceptable="no: target"))
    assert (
        "CANNOT BE REACHED: AUC is at most 0.5 s in the mean. The best is an AUC of 2 [1.8, 2.2] s, at 300 ms" in text
    )
    assert "MARGIN  None: " in text and "at no deadline; the best is an AUC of 3 [2.8, 3.2] s, at 200 ms" in text
    reached = replace(own, merit=Estimate(-0.4, 0.1, -0.6, -0.2))
    assert "CANNOT" not in page(replace(advice, target=target, margin=here, current_margin=reached))


def test_a_target_in_seconds_is_asked_of_everything(composer: None, tmp_path: Path) -> None:
    """Robots that are never there within a second miss it; those that have 4 s keep it."""
    options = [*SMALL, "advise.margins.points=0", "advise.margins.target.auc_s=1000"]
    found = run(load(AdviseConfig, compose("advise", options)), tmp_path)
    assert found.margin.reached and found.slack.reached and found.slack.level == -1000.0
    assert found.acceptable in ("yes", "not shown") and (found.stress["stands"] != "no").all()
    values = yaml.safe_load((tmp_path / "advice.yaml").read_text())
    assert values["target"]["kind"] == "auc_s" and values["target"]["recommended"]["reached"] is True
    assert "AUC is at most 1000 s in the mean" in page(found)


def test_what_matters_most_is_named(advice: Advice) -> None:
    table = advice.assumptions
    assert set(table["what"]) == {
        "when commands take effect", "what a missed loop does", "what computes at the edge"
    }  # fmt: skip
    order = [(low <= advice.max_collision_share, -abs(change))
             for low, change in zip(table["collision_low"], table["change"], strict=True)]  # fmt: skip
    assert order == sorted(order)
    actuation = table.set_index("what").loc["when commands take effect"]
    assert actuation["qoc"] == pytest.approx(advice.actuation.here.given.mean)
    assert actuation["change"] == pytest.approx(actuation["qoc"] - advice.stress["qoc"].iloc[0])
    assert f"HANGS ON   {table['what'].iloc[0]}: {table['assumed'].iloc[0]}." in page(advice)


def test_a_cliff_is_said(advice: Advice) -> None:
    """When half more delay takes more than the margin; not when it takes less."""
    kept = advice.stress["what"] == "all loop times x 1.5"

    def text(change: float) -> str:
        qoc = np.where(kept, 0.5 + change, 0.5)
        stress = advice.stress.assign(change=np.where(kept, change, 0.0), qoc=qoc, completed_share=0.25)
        return page(replace(advice, stress=stress, growth=Bound(1.1, 1.05, 1.2, False)))

    assert "may grow by 10% [5%, 20%] before QoC falls by 5%" in text(-0.3)
    assert "BEWARE OF THE CLIFF: should delay grow by half, 25.0% of the loops complete" in text(-0.3)
    assert "costs 0.0000 QoC now and saves 0.3000 then" in text(-0.3)
    assert "CLIFF" not in text(-0.001) and "saves" not in text(-0.001)
    calm = page(replace(advice, growth=Bound(3.0, 3.0, 3.0, True)))
    assert "may grow by more than a factor of 3 (surely 3) before" in calm
    assert "[5%, 200% or more]" in page(replace(advice, growth=Bound(1.1, 1.05, 3.0, False, False, True)))


@pytest.mark.slow
def test_the_sampling_period_is_chosen_where_others_are_allowed(composer: None) -> None:
    """With one command in two seconds of four a robot that begins the wrong way round hardly gets anywhere."""
    away = "scenario.start=[[-0.6,-0.5,2.5],[-0.6,0.5,-2.5]]"
    options = [*SMALL, "advise.margins.points=0", "advise.margins.delays=0", away]
    found = run(load(AdviseConfig, compose("advise", [*options, "loop.tau=2", "advise.tau_ms=[100]"])))
    assert float(found.recommended.tau) == 0.1 and float(found.current.tau) == 2.0
    assert "at tau 100 ms instead of 2000 ms" in page(found) and "tau" not in found.kept
    with pytest.raises(ValueError, match="advise.tau_ms: got 0.0"):
        run(load(AdviseConfig, compose("advise", [*options, "advise.tau_ms=[0]"])))
