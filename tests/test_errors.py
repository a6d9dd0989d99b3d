"""Bad input is refused in one sentence that names the argument, before anything is compiled."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from cases import GivenNetwork

import qocjax.batch.runner as runner
from qocjax import (
    Design,
    QocScale,
    Rules,
    Scenario,
    evaluate,
    one_at_a_time,
    paper_network,
    replay,
    run_study,
    simulate,
)

NETWORK = paper_network()
SCENARIO = Scenario(horizon=1.0)
DESIGN = Design(tau=0.1)
TIMES = np.full((10, 2), 0.15)
START = [[-2, -1.5, 0.3], [-2, 1.5, 0.0]]


@pytest.fixture(autouse=True)
def _no_compilation(monkeypatch: pytest.MonkeyPatch) -> None:
    def compiles(*_: Any, **__: Any) -> None:
        pytest.fail("got as far as compiling")

    monkeypatch.setattr(sys.modules["qocjax.single"], "_simulate", compiles)
    monkeypatch.setattr(runner, "compiled", compiles)


def refuses(name: str, call: Callable[[], Any], *words: str) -> None:
    """The call raises one sentence that begins with the argument's name and says what is expected."""
    with pytest.raises((ValueError, TypeError)) as caught:
        call()
    message = str(caught.value)
    assert message.startswith(f"{name}: ") and "expected" in message and "\n" not in message, message
    assert all(word in message for word in words), message


SCENARIOS: list[tuple[str, Any]] = [
    ("start", np.zeros((0, 3))), ("start", np.zeros((2, 2))), ("start", [[1, 2, 3], [1, 2]]), ("start", "here"),
    ("start", None), ("start", [[0, np.nan, 0], [1, 1, 1]]), ("start", jnp.array([[0, jnp.inf, 0], [1, 1, 1]])),
    ("start", np.ones((2, 3), bool)), ("start", pd.DataFrame([[0, np.nan, 0], [1, 1, 1]])), ("goal", [1, 2, 3]),
    ("goal", np.nan * np.ones(2)), ("goal", 1.0), ("goal", np.zeros((3, 2))), ("goal", [[1, 2], [3, 4]]),
    ("goal", ["a", "b"]), ("horizon", 0.0), ("horizon", -1), ("horizon", np.nan), ("horizon", np.inf),
    ("horizon", [1.0, 2.0]), ("horizon", "long"), ("reference", "straight"), ("reference", None),
    ("reference", ["nominal"]), ("normaliser", "start"), ("normaliser", np.array(["a", "b"])), ("nominal_kappa", 0.0),
    ("nominal_kappa", [1.0, 2.0]), ("nominal_v_max", np.nan), ("nominal_v_max", 1j), ("weights", [1.0, 0.0]),
    ("weights", [1.0, np.nan]), ("weights", [1.0]), ("start_jitter", (-0.1, 0.1)), ("start_jitter", 0.1),
    ("start_jitter", (np.nan, 0)), ("robot_radius", -1), ("robot_radius", [0.1, 0.2]), ("reference_per_robot", "no"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "value"), SCENARIOS, ids=lambda v: v if isinstance(v, str) else repr(v)[:20])
def test_scenarios(name: str, value: Any) -> None:
    refuses(name, lambda: Scenario(**{name: value}))


@pytest.mark.parametrize("name", ["v_max", "omega_max", "eta", "kappa", "gamma", "c_miss", "d_safe", "tau", "deadline"])
def test_designs(name: str) -> None:
    bad = [np.nan, np.inf, -1e-9, [0.1, -2.0], [0.1, np.nan], pd.Series([0.1, -1.0]), jnp.array(-1.0), "1", None, True]
    for value in [*bad, 1j, {}] + [0.0] * (name in ("v_max", "omega_max", "d_safe", "tau")):
        refuses(name, lambda value=value: Design(**{name: value}))
    Design(**{name: [0.1, 1]}), Design(**{name: pd.Series([0.1, 1])}), Design(**{name: np.float32(0.1)})


def test_start_on_the_reference_names_the_way_out() -> None:
    alone = Scenario(start=[[0, 1, 0.3]], horizon=1.0)
    between = Scenario(start=[*START, [-2, 0, 0]], horizon=1.0)
    own = Scenario(reference_per_robot=True, horizon=1.0)
    for scenario, robots in ((alone, 1), (between, 3), (own, 2)):
        times = TIMES[:, :1].repeat(robots, 1)
        refuses("start", lambda s=scenario, t=times: simulate(s, DESIGN, t), "goal_distance", "robot")
        refuses("start", lambda s=scenario: evaluate(s, DESIGN, NETWORK, [0]), "goal_distance")
    there = Scenario(start=[[2, 0, 0], [1, 1, 0]], normaliser="goal_distance", horizon=1.0)
    refuses("start", lambda: simulate(there, DESIGN, TIMES), "robot 0")


def test_loop_times_of_one_run() -> None:
    bad = [
        TIMES * np.nan, -TIMES, TIMES[:9], TIMES[:, :1], TIMES.T, TIMES[0], "late", None, [[0.1, 0.2], [0.1]],
        TIMES > 0, np.where(np.arange(20).reshape(10, 2) == 7, np.nan, TIMES), 1j * TIMES,
    ]  # fmt: skip
    for times in bad:
        refuses("loop_times", lambda times=times: simulate(SCENARIO, DESIGN, times))
    refuses("loop_times", lambda: jax.jit(lambda t: simulate(SCENARIO, DESIGN, t))(TIMES[:4]))


def test_one_run() -> None:
    refuses("scenario", lambda: simulate({}, DESIGN, TIMES))
    refuses("design", lambda: simulate(SCENARIO, None, TIMES))
    refuses("kappa", lambda: simulate(SCENARIO, Design(kappa=[1.0, 2.0], tau=0.1), TIMES))
    refuses("tau", lambda: simulate(SCENARIO, Design(tau=1.01), TIMES[:1]))
    refuses("actuation", lambda: simulate(SCENARIO, DESIGN, TIMES, "soon"), "deadline, arrival, instant")
    refuses("hold", lambda: simulate(SCENARIO, DESIGN, TIMES, "arrival", "on"), "hold, zero, timeout, decay")
    for name in ("hold_timeout", "hold_decay"):
        for value in (0.0, -1, np.nan, np.inf, "1", [1.0, 2.0], None):
            refuses(name, lambda name=name, value=value: simulate(SCENARIO, DESIGN, TIMES, **{name: value}))
            refuses(name, lambda name=name, value=value: Rules(**{name: value}))
    assert hash(Rules(hold_timeout=jnp.float32(0.5))) == hash(Rules())


@dataclass(frozen=True)
class NaNNetwork(GivenNetwork):
    def draw(self, key: jax.Array, num_ticks: int, num_robots: int, tau: float) -> jax.Array:
        return super().draw(key, num_ticks, num_robots, tau).at[3].set(jnp.nan)


EVALUATIONS: list[tuple[str, dict[str, Any]]] = [
    ("scenario", {"scenario": {}}), ("designs", {"designs": None}), ("designs", {"designs": {"kappa": 1.0}}),
    ("designs", {"designs": Design(kappa=[], tau=0.1)}),
    ("designs", {"designs": Design(kappa=[[1.0, 2.0]], tau=0.1)}),
    ("designs", {"designs": Design(kappa=[1.0, 2.0], eta=[1.0, 2.0, 3.0], tau=0.1)}),
    ("tau", {"designs": Design(tau=[0.1, 1.1])}), ("network", {"network": None}), ("network", {"network": "paper"}),
    ("seeds", {"seeds": []}), ("seeds", {"seeds": [-1]}), ("seeds", {"seeds": [1.0]}), ("seeds", {"seeds": ["one"]}),
    ("seeds", {"seeds": [True]}), ("seeds", {"seeds": 3}), ("seeds", {"seeds": None}), ("seeds", {"seeds": [2**32]}),
    ("seeds", {"seeds": [2**70]}), ("rules", {"rules": "arrival"}), ("key", {"key": 1.5}), ("key", {"key": "a"}),
    ("key", {"key": 2**40}), ("dtype", {"dtype": np.float16}), ("dtype", {"dtype": int}),
    ("dtype", {"dtype": "fine"}), ("max_runs", {"max_runs": 0}), ("max_runs", {"max_runs": 2.5}),
]  # fmt: skip


@pytest.mark.parametrize(("name", "changed"), EVALUATIONS, ids=lambda v: v if isinstance(v, str) else repr(v)[:50])
def test_evaluations(name: str, changed: dict[str, Any]) -> None:
    arguments = {"scenario": SCENARIO, "designs": DESIGN, "network": NETWORK, "seeds": [0]} | changed
    refuses(name, lambda: evaluate(**arguments))


def test_replays() -> None:
    for seed in (-1, 1.5, None):
        refuses("seed", lambda seed=seed: replay(SCENARIO, DESIGN, NETWORK, seed))
    for tau in ([0.1, 0.2], 1.1):
        refuses("tau", lambda tau=tau: replay(SCENARIO, Design(tau=tau), NETWORK, 0))


def test_loop_times_of_a_network_are_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    """NaN is neither late nor lost; only a draw can show it, so this may compile."""
    monkeypatch.undo()
    with pytest.raises(ValueError, match="NaN"):
        evaluate(SCENARIO, DESIGN, NaNNetwork(), [0])


def test_grids() -> None:
    refuses("grids", lambda: one_at_a_time(DESIGN, {}, [0.1]))
    refuses("grids", lambda: one_at_a_time(DESIGN, {"speed": [1.0]}, [0.1]), "kappa")
    refuses("grids", lambda: one_at_a_time(DESIGN, {"deadline": [1.0]}, [0.1]))
    refuses("baseline.kappa", lambda: one_at_a_time(Design(kappa=[1.0, 2.0]), {"eta": [1.0]}, [0.1]))
    for values in ([], [np.nan], [-1.0], [1, 1.0], ["a"], None):
        refuses("eta", lambda values=values: one_at_a_time(DESIGN, {"eta": values}, [0.1]))
        refuses("deadline", lambda values=values: one_at_a_time(DESIGN, {"eta": [1.0]}, values))


def test_studies() -> None:
    grid = one_at_a_time(DESIGN, {"eta": [0.5, 1.0]}, [0.2, 0.3])

    def study(selection: Any = (0, 1), evaluation: Any = (2, 3), **options: Any) -> None:
        run_study(SCENARIO, grid, NETWORK, selection, evaluation, **options)

    refuses("evaluation_seeds", lambda: study((0, 1), (1, 2)), "1")
    refuses("selection_seeds", lambda: study((0,)))
    refuses("selection_seeds", lambda: study((0, 0)))
    refuses("evaluation_seeds", lambda: study((0, 1), (2,)))
    refuses("selection_seeds", lambda: study(3))
    for value in (-0.1, 1.1, np.nan, "1"):
        refuses("min_reliability", lambda value=value: study(min_reliability=value))
    refuses("deadline", lambda: study(min_reliability=0.99), "min_reliability")
    for scale in ((0.0, 1.0), (np.nan, 1.0), (1.0, np.inf), (1.0, -1.0)):
        refuses("J_med" if scale[0] != 1 else "J_max", lambda scale=scale: QocScale(*scale))
    refuses("auc", lambda: QocScale.of([np.nan, np.inf]))


def test_importing_changes_no_setting() -> None:
    code = (
        "import os, jax, warnings; before = dict(os.environ), dict(jax.config.values), warnings.filters[:];"
        "import qocjax, qocjax.batch, qocjax.study, qocjax.network;"
        "import sys; assert not {'hydra', 'matplotlib.pyplot'} & set(sys.modules), 'imports too much';"
        "assert before[:2] == (dict(os.environ), dict(jax.config.values)), 'settings changed';"
        "from jax._src import xla_bridge; assert not xla_bridge._backends, 'backend started'"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[1], timeout=120)
