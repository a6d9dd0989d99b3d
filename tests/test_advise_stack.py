"""Advice with the navigation stack in the loop: what it searches, what it says, what it refuses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hydra import compose, initialize_config_dir

from qocjax import Design, Scenario, paper_network
from qocjax.advice.assumptions import _alternatives
from qocjax.advice.plan import plan_of
from qocjax.advice.shortlist import Effort
from qocjax.advice.slack import Asked
from qocjax.commands.advise import page, run
from qocjax.config import conf_dir, load
from qocjax.config.advise import AdviseConfig
from qocjax.navigation import NavigationStack, open_floor
from qocjax.network.schedule import Rules
from qocjax.quality import QocScale
from qocjax.search.objective import Objective

TINY = [
    "controller.mppi.batch_size=40", "controller.mppi.time_steps=12", "controller.mppi.model_dt=0.1", "loop.tau=0.1",
    "scenario.horizon=6", "advise.points=2", "advise.rounds=[2]", "advise.finalists=2", "advise.choice_seeds=2",
    "advise.fresh_seeds=3", "advise.beside_seeds=2", "advise.deadlines=3", "figures=false",
]  # fmt: skip
OWN = [
    "controller.inflation.inflation_radius",
    *(f"controller.mppi.critics.{name}.cost_weight" for name in ("CostCritic", "PathAlignCritic", "PathFollowCritic")),
]


@pytest.fixture
def composer() -> Iterator[None]:
    with initialize_config_dir(str(conf_dir().resolve()), version_base="1.3"):
        yield


def config(*options: str) -> AdviseConfig:
    return load(AdviseConfig, compose("advise", ["controller=navigation", *options]))


def test_it_searches_what_the_stack_reads(composer: None) -> None:
    stack, law = config(), load(AdviseConfig, compose("advise"))
    own = stack.bounds()
    assert own.pop("v_max") == (pytest.approx(0.21), 0.7) and set(law.bounds()) > {"kappa", "v_max"}
    assert set(own) == set(OWN)
    assert stack.loop.tau == 0.05 and config("loop.tau=0.1").loop.tau == 0.1
    effort = stack.effort()
    assert (effort.fresh_seeds, effort.deadlines) == (72, 5) and law.effort() == Effort()
    assert stack.advise.max_collision_share == 0.05


def test_deadlines_are_thinned_out_evenly() -> None:
    def deadlines(most: int | None) -> np.ndarray:
        plan = plan_of(
            Scenario(), paper_network(), Design(), {"kappa": (1.0, 2.0)}, rules=Rules(), key=0, longest=0.8,
            limit=0.01, how="mean", taus=(), effort=Effort(deadlines=most), scale=QocScale(3.0, 30.0), asked=Asked(),
        )  # fmt: skip
        return plan.axis(Design())

    every, few = deadlines(None), deadlines(5)
    assert few.size == 5 and every.size > 10 and set(few) < set(every)
    assert (few[0], few[-1]) == (every[0], every[-1])


def test_what_it_cannot_do_is_refused(composer: None) -> None:
    with pytest.raises(ValueError, match=r"actuation: got 'arrival' with predict=True, expected 'deadline'"):
        run(config("controller.predict=true", "loop.actuation=arrival"))
    with pytest.raises(ValueError, match="advise.bounds.kappa: got .*, expected null: controller=navigation"):
        run(config("advise.bounds.kappa=[1,2]", *TINY))
    with pytest.raises(ValueError, match=r"deadlines: got 2, expected"):
        run(config("advise.deadlines=2"))


def test_a_prediction_is_left_out_where_commands_act_as_they_come() -> None:
    stack = NavigationStack(open_floor(Scenario()), predict=True)
    goal = Objective(Scenario(), paper_network(), QocScale(3.0, 30.0), controller=stack)
    (assumed, instead, other), *_ = _alternatives(goal).values()
    assert (assumed[:5], instead[:5]) == ("at st", "as th") and other.rules.actuation == "arrival"
    assert other.controller == replace(stack, predict=False) and goal.controller.predict


@pytest.mark.slow
def test_advice_with_the_stack(composer: None, tmp_path: Path) -> None:
    """The page speaks of what the stack reads, and the files hold no gain of the surrogate law."""
    advice = run(config(*TINY), tmp_path)
    text = page(advice)
    assert "with the navigation stack" in text and "kappa" not in text.split("IS 300 ms ACCEPTABLE")[0]
    assert advice.seeds == {"search": 2, "choice": 2, "fresh": 3} and advice.simulations < 600
    kept = yaml.safe_load((tmp_path / "advice.yaml").read_text())
    assert set(kept["recommended"]) == {"v_max", "omega_max", "tau", "deadline", *OWN}
    fragment = (tmp_path / "nav2_params.yaml").read_text()
    assert "surrogate law" not in fragment
    told = yaml.safe_load(fragment)["controller_server"]["ros__parameters"]["FollowPath"]
    assert (told["batch_size"], told["time_steps"], told["model_dt"]) == (40, 12, 0.1)
    assert told["prune_distance"] == 2.5 and 2 <= told["PathFollowCritic"]["cost_weight"] <= 30
    layer = yaml.safe_load(fragment)["local_costmap"]["local_costmap"]["ros__parameters"]["inflation_layer"]
    assert 0.3 <= layer["inflation_radius"] <= 1.0
    assert np.isfinite(advice.judged["qoc"]).all()
