"""Laws from outside the package: the guide's, those of the package by their names, and whatever is wrong with one."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from guide import GUIDE, write_guide
from hydra import compose, initialize_config_dir

import qocjax.commands.sweep
import qocjax.commands.tune
from qocjax.commands.command_line import _of_target
from qocjax.config import SimulationConfig, StudyConfig, build_problem, conf_dir, load
from qocjax.config.target import law_of
from qocjax.config.tune import TuneConfig
from qocjax.controllers import Apf, Cbf
from qocjax.navigation import NavigationStack

ROOT = Path(__file__).parents[1]
SMALL = [
    "sweep=kappa", "sweep.grids.kappa=[1,2]", "sweep.deadline_ms=[150,400]", "sweep.seeds=2",
    "sweep.evaluation_seeds=2", "scenario.horizon=5", "figures=false", "report=false",
]  # fmt: skip
TUNED = [
    "tune.steps=2", "tune.starts=1", "tune.step_seeds=2", "tune.seeds=2", "tune.evaluation_seeds=2",
    "tune.deadline_ms=[200]", "scenario.horizon=3", "figures=false",
]  # fmt: skip

# Runs the command line once for each list of options.
ONE_BY_ONE = """
import json, sys
from qocjax.sweep import main
for options in json.loads(sys.argv[1]):
    sys.argv = ["qocjax.sweep", *options]
    try:
        main()
    except SystemExit as stop:
        print(stop.code)
"""

LAWS = """
from dataclasses import dataclass
import jax.numpy as jnp
from qocjax.controllers import Apf, Law
from qocjax.robots import Command

class Still(Law):
    unread = ("eta",)
    def command(self, task, memory, sight):
        return memory, Command(0 * sight.pose.x, 0 * sight.pose.x), ()
class Stubborn(Apf):
    smooth = False
class Grand(Apf):
    costly = True
class Unwritten(Law):
    pass
class Raises(Law):
    def command(self, task, memory, sight):
        return memory, sight.pose.z, ()
class Few(Still):
    def command(self, task, memory, sight):
        return memory, Command(jnp.zeros(3), jnp.zeros(3)), ()
class Short(Still):
    def command(self, task, memory, sight):
        return Command(sight.pose.x, sight.pose.x)
class Grows(Still):
    def begin(self, task, pose, keys):
        return pose.x
    def command(self, task, memory, sight):
        return jnp.stack([memory] * 2), Command(sight.pose.x, sight.pose.x), ()
class Talks(Still):
    def report(self, memory):
        return {"one": jnp.zeros(3)}
class Plans(Still):
    def plan(self, task, memory, sight, length):
        return self.command(task, memory, sight)
@dataclass
class Soft(Still):
    weight: float = 1.0
class Takes(Still):
    def __init__(self, kappa):
        self.kappa = kappa
class Needs(Still):
    def __init__(self, much):
        self.much = much
class Fails(Still):
    def __init__(self):
        self.much = 1 / 0
class Odd(Still):
    unread = "eta"
def lonely():
    pass
"""


@pytest.fixture
def laws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Modules with laws, where Python finds them; another folder, and so other modules, for each test."""
    write_guide(tmp_path)
    (tmp_path / "somelaws.py").write_text(LAWS, encoding="utf-8")
    (tmp_path / "lacking.py").write_text("import nothing_there\n", encoding="utf-8")
    (tmp_path / "broken.py").write_text("x = (\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("lab", "somelaws", "lacking", "broken"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    law_of.cache_clear()
    return tmp_path


def loaded(schema: type[SimulationConfig], command: str, options: Sequence[str]) -> Any:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return load(schema, compose(command, _of_target(list(options))))


def configured(*options: str) -> StudyConfig:
    return loaded(StudyConfig, "sweep", [*SMALL, *options])


def sweeps(runs: list[list[str]], folder: Path) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "JAX_PLATFORMS": "cpu"}
    return subprocess.run([sys.executable, "-c", ONE_BY_ONE, json.dumps(runs)], cwd=folder, env=environment,
                          capture_output=True, encoding="utf-8", timeout=300)  # fmt: skip


def test_the_law_of_the_guide(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the document to tables: it is the surrogate law without its repulsion; resumed, and refused once changed."""
    file = write_guide(tmp_path)
    assert len(file.read_text(encoding="utf-8").splitlines()) <= 30
    (command,) = re.findall(r"^python -m qocjax.sweep (.*lab.*)$", GUIDE.read_text(encoding="utf-8"), re.MULTILINE)
    mine = [option for option in command.split() if option.startswith("controller.")]
    assert mine == ["controller._target_=lab.Straight", "controller.share=0.5"]
    small = [*SMALL, "sweep.grids.kappa=[2]", "sweep.deadline_ms=[150]", "scenario.horizon=2"]
    done = sweeps([
        [*mine, *small, "controller.kappa=4", "sweep.grids.kappa=[4]", "hydra.run.dir=lab"],
        ["controller.eta=0", *small, "scenario.reference.kappa=4", "hydra.run.dir=apf"], ["resume=lab"],
    ], tmp_path)  # fmt: skip
    assert done.returncode == 0 and not done.stderr, done.stderr
    ours, apf = (pd.read_csv(tmp_path / name / "results.csv") for name in ("lab", "apf"))
    assert list(ours["auc"]) == list(apf["auc"])  # half of twice the gain
    records = [json.loads((tmp_path / name / "record.json").read_text(encoding="utf-8")) for name in ("lab", "apf")]
    assert (records[0]["law"]["class"], records[0]["law"]["file"]) == ("lab.Straight", str(file))
    assert "law" not in records[1]

    file.write_text(file.read_text(encoding="utf-8") + "# another\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "lab", raising=False)
    law_of.cache_clear()
    config = StudyConfig.model_validate(records[0]["configuration"])
    with pytest.raises(ValueError, match="lab: holds a study of other data, expected the files .* law as they were"):
        qocjax.commands.sweep.run(config, tmp_path / "lab", quiet=True)


@pytest.mark.slow
def test_workers_find_the_law(tmp_path: Path) -> None:
    """Those of this machine do, and compute the same."""
    pytest.importorskip("distributed")
    write_guide(tmp_path)
    law, workers = "controller._target_=lab.Straight", ["engine=dask", "engine.workers=2"]
    done = sweeps([[law, *SMALL, *workers, "hydra.run.dir=far"], [law, *SMALL, "hydra.run.dir=near"]], tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "far" / "results.csv").read_bytes() == (tmp_path / "near" / "results.csv").read_bytes()


def test_the_packages_own_laws_by_their_names() -> None:
    """They are what their own configurations make; and the options make them again."""
    assert configured("controller._target_=qocjax.controllers.Apf").build_controller() == Apf()
    config = configured("controller._target_=qocjax.controllers.Cbf", "controller.alpha=3.0")
    again = build_problem(json.loads(json.dumps(config.model_dump())))
    assert again.controller == Cbf(3.0) and again.data() == config.build_problem().data()
    assert again.data() == configured("controller=cbf", "controller.alpha=3.0").build_problem().data()
    assert config.identity()["controller"] == {
        "_target_": "qocjax.controllers.Cbf", "kappa": 2.0, "eta": 0.6, "gamma": 2.0, "c_miss": 0.2, "d_safe": 0.5,
        "alpha": 3.0,
    }  # fmt: skip


WRONG = {
    "no name of a module": (["Straight"], "got 'Straight', expected a class by its full name"),
    "no such module": (["nowhere.Law"], "there is no module nowhere, expected one that Python finds"),
    "no such submodule": (["qocjax.nowhere.Law"], "there is no module qocjax.nowhere"),
    "a module that lacks another": (["lacking.Law"], r"lacking failed .* 'nothing_there' \(.*lacking.py, line 1\)"),
    "a module that is broken": (["broken.Law"], r"broken failed as it was imported: SyntaxError: .*broken.py, line 1"),
    "no such class": (["lab.Curved"], "lab has no Curved, expected a class, such as Straight"),
    "a function": (["somelaws.lonely"], "that is a function, expected a class"),
    "no controller": (["json.JSONEncoder"], "without check, check_start, begin, command, report, expected a subclass"),
    "no command": (["somelaws.Unwritten"], "which is no controller without command"),
    "an unknown argument": (["lab.Straight", "controller.shore=1"], "controller.shore: .* lab.Straight .share. or one"),
    "an argument that is missing": (["somelaws.Needs"], "controller.much: got nothing, expected a value"),
    "an argument of the design": (["somelaws.Takes"], "controller.kappa: got a value of the design"),
    "an option of instantiate": (["lab.Straight", "controller._partial_=true"], "controller._partial_: got an option"),
    "one inside": (["somelaws.Needs", "controller.much={_target_: a.B}"], "controller.much._target_: got an option"),
    "beside another law": (["lab.Straight", "controller=apf"], "controller.law: got an unknown option"),
    "a value that is none": (["lab.Straight", "controller.kappa=much"], "controller.kappa: got 'much', expected a"),
    "a value that it reads left out": (["lab.Straight", "controller.gamma=null"], "controller.gamma: got nothing"),
    "made with an error": (["somelaws.Fails"], r"failed as it was made: ZeroDivisionError: .*somelaws.py, line \d+\)"),
    "no hash": (["somelaws.Soft"], "has no hash .*, expected a frozen dataclass"),
    "a text for a tuple": (["somelaws.Odd"], "with unread='eta', expected a tuple"),
    "a command that fails": (["somelaws.Raises"], r"Raises: AttributeError: .*'z' \(.*somelaws.py, line \d+\)"),
    "a command of another shape": (["somelaws.Few"], r"got nu of float32\[3\], expected float32\[2, 2, 3\]"),
    "a command alone": (["somelaws.Short"], "Short.command: got Command, expected"),
    "memory that grows": (["somelaws.Grows"], r"got memory of float32\[2, 2, 2, 3\] after float32\[2, 2, 3\]"),
    "a report of another shape": (["somelaws.Talks"], r"Talks.report: got one of shape \(3,\), expected one number"),
    "a plan of one command": (
        ["somelaws.Plans"], r"Plans.plan: got nu of float32\[2, 2, 3\], expected float32\[3, 2, 2, 3\], for each"
    ),
    "a sweep over what it does not read": (
        ["lab.Straight", "+sweep.grids.eta=[0.1,0.2]"], "eta: got several values, but Straight does not read it"
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_with_a_law_is_one_line(case: str, laws: Path) -> None:
    (target, *options), told = WRONG[case]
    with pytest.raises(ValueError, match=told) as raised:
        qocjax.commands.sweep.run(configured(f"controller._target_={target}", *options), quiet=True)
    assert "\n" not in str(raised.value)


@pytest.mark.slow
def test_a_law_from_outside_fills_packets(laws: Path) -> None:
    """Its plans are rolled as the surrogate law's are, which without repulsion it is."""
    plans = ("loop.hold=buffer", "loop.plan_length=4", "sweep.grids.kappa=[2]", "scenario.horizon=2")
    found, wanted = (
        qocjax.commands.sweep.run(configured(law, *plans), quiet=True).runs["auc"]
        for law in ("controller._target_=lab.Straight", "controller.eta=0")
    )
    np.testing.assert_allclose(found, wanted, rtol=1e-6)


def test_what_a_law_does_not_read_may_be_left_out(laws: Path) -> None:
    options = ["controller._target_=lab.Straight", *(f"controller.{name}=null" for name in ("eta", "c_miss", "d_safe"))]
    config = configured(*options)
    assert config.model_dump()["controller"] == {"_target_": "lab.Straight", "kappa": 2.0, "gamma": 2.0}
    assert config.baseline().eta == qocjax.Design().eta
    assert build_problem(json.loads(json.dumps(config.model_dump()))).data() == config.build_problem().data()


def tuning(*options: str) -> TuneConfig:
    return loaded(TuneConfig, "tune", [*TUNED, *options])


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["smoothed", "pathwise"])
def test_a_law_is_tuned(estimator: str, laws: Path) -> None:
    """The guide's law as the surrogate law without its repulsion, whose derivatives they share."""
    how = f"tune.estimator={estimator}"
    found, wanted = (
        qocjax.commands.tune.run(tuning(how, each), quiet=True)
        for each in ("controller._target_=lab.Straight", "controller.eta=0")
    )
    np.testing.assert_allclose(found.designs[["kappa", "gamma"]], wanted.designs[["kappa", "gamma"]], rtol=1e-5)


def test_what_cannot_be_tuned_is_refused(laws: Path) -> None:
    for options, told in (
        (["controller._target_=lab.Straight", "tune.wrt=[eta]"], "tune.wrt: got eta, which lab.Straight does not read"),
        (["controller._target_=somelaws.Stubborn", "tune.estimator=blend"], "does not say that it is smooth"),
        (["controller=cbf", "tune.wrt=[kappa,eta]"], "tune.wrt: got eta, which cbf does not read"),
    ):
        with pytest.raises(ValueError, match=told):
            qocjax.commands.tune.run(tuning(*options), quiet=True)


def test_own_laws_say_of_themselves_what_a_controller_says() -> None:
    assert [(law.costly, law.sees_speed, law.smooth) for law in (Apf, Cbf, NavigationStack)] == [
        (False, False, True), (False, False, False), (True, True, False),
    ]  # fmt: skip
