"""Commands that are stopped go on: piece by piece, to the files of a run that nobody disturbed."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from hydra import compose, initialize_config_dir

from qocjax._conf import add_resolver
from qocjax._told import told
from qocjax.config import conf_dir, load
from qocjax.store import journal as module
from qocjax.store.journal import Journal

ROOT = Path(__file__).parents[1]
LOOP = ["scenario.horizon=3", "loop.tau=0.1", "figures=false"]
COMMANDS = {
    "tune": ["tune.deadline_ms=[200,300]", "tune.steps=3", "tune.step_seeds=4", "tune.starts=2", "tune.seeds=4",
             "tune.evaluation_seeds=6"],
    "qos": ["scenario.horizon=5", "qos.loss=[0,0.2]", "qos.burst=[1]", "qos.deadline_ms=[300,500]", "qos.seeds=4",
            "qos.show={loss: 0.2, burst: 1}", "~qos.profiles.KEEP_ALL", "~qos.profiles.RELIABLE_1",
            "~qos.profiles.RELIABLE_10_100ms"],
    "validate": ["measured=surrogate", "scenario.horizon=8", "validation.delay_ms=[140,200,400,800]",
                 "validation.seeds=4", "validation.resamples=200", "calibrate=gains", "calibrate.budget=1000"],
    "codesign": ["search.methods=[random,cma_es,sobol_gradient]", "search.repetitions=1", "search.budget=1900",
                 "search.tau=[0.05,0.06]", "search.deadline_ms=[200,300]", "search.block=32",
                 "sweep.grids={kappa:[1.0,2.0]}", "sweep.deadline_ms=[210,240]", "sweep.seeds=32",
                 "sweep.evaluation_seeds=96", "limits.collision_share=0.2", "front.method=random",
                 "front.budget=1100"],
    "advise": ["scenario.horizon=4", "advise.points=4", "advise.rounds=[8]", "advise.finalists=3",
               "advise.fresh_seeds=8", "advise.max_collision_share=1", "advise.margins.delays=3",
               "advise.margins.seeds=8", "advise.margins.points=4", "advise.bounds.eta=null",
               "advise.bounds.c_miss=null", "advise.slowest=null", "advise.deadline_ms=700"],
}  # fmt: skip
SLOW = ("codesign", "advise", "qos", "validate")


@pytest.fixture(autouse=True)
def _composer() -> Iterator[None]:
    add_resolver("own_folder", lambda *given: None)
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        yield


@dataclass
class Kept:
    """What was kept, and after how many more pieces the run is stopped."""

    names: list[str]
    left: int = -1


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Kept:
    """A file for each piece, and a run that can be stopped behind any."""
    found, put = Kept([]), Journal.put

    def counted(self: Journal, name: str, arrays: Any) -> None:
        put(self, name, arrays)
        found.names.append(name)
        found.left -= 1
        if found.left == 0:
            raise KeyboardInterrupt

    monkeypatch.setattr(module, "_OFTEN", 0.0)
    monkeypatch.setattr(Journal, "unnamed", lambda _, why: pytest.fail(f"{why} has no name"))
    monkeypatch.setattr(Journal, "put", counted)
    return found


def run(command: str, folder: Path, *options: str) -> None:
    schema = import_module(f"qocjax.{command}").main.model()
    work = import_module(f"qocjax.commands.{command}")
    quiet = {} if command == "advise" else {"quiet": True}
    work.run(load(schema, compose(command, [*LOOP, *COMMANDS[command], *options])), folder, **quiet)


def files(folder: Path) -> dict[str, str]:
    """What a run wrote beside its pieces, without the time and its own place."""
    paths = [path for path in folder.rglob("*") if path.is_file() and path.parent.name != "chunks"]
    texts = {path.name: path.read_bytes().decode("latin-1") for path in paths if path.name != ".lock"}
    return {name: re.sub(r'"?written"?: .*', "", text).replace(str(folder), "") for name, text in texts.items()}


@pytest.mark.parametrize(
    "command", [pytest.param(each, marks=pytest.mark.slow) if each in SLOW else each for each in COMMANDS]
)
def test_a_command_that_is_stopped_goes_on_byte_for_byte(command: str, made: Kept, tmp_path: Path) -> None:
    run(command, whole := tmp_path / "whole")
    undisturbed = made.names.copy()
    assert len(undisturbed) == len(set(undisturbed)) > 3
    made.names.clear()
    parts = tmp_path / "parts"
    for some in (1, len(undisturbed) // 2, len(undisturbed) // 3):
        made.left = some
        with pytest.raises(KeyboardInterrupt, match=re.escape(f"resume={parts} goes on")):
            run(command, parts)
    run(command, parts)
    assert sorted(made.names) == sorted(undisturbed)  # none is computed twice
    assert files(parts) == files(whole) and len(files(whole)) > 4
    run(command, parts)
    assert len(made.names) == len(undisturbed) and files(parts) == files(whole)


LONGER = {"tune": ["tune.step_seeds=64", "tune.patience=0"], "advise": ["advise.points=16", "advise.fresh_seeds=256"]}


@pytest.mark.slow
@pytest.mark.parametrize("command", LONGER)
def test_ctrl_c_and_kill_9_on_the_command_line(command: str, tmp_path: Path) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    options = [*LONGER[command], "figures=false"]
    assert ended(started(command, *options, f"hydra.run.dir={whole}")) == (0, "")
    count = len(pieces(whole))
    code, told = stopped(started(command, *options, f"hydra.run.dir={parts}"), parts, max(1, count // 4), signal.SIGINT)
    assert code == 130 and told.endswith(f"stopped: resume={parts} goes on\n")
    there = {path: path.stat().st_mtime_ns for path in pieces(parts)}
    stopped(started(command, *options, f"hydra.run.dir={parts}"), parts, max(2, count // 2), signal.SIGKILL)
    code, told = ended(started(command, *options, "key=5", f"hydra.run.dir={parts}"))
    assert code == 2 and "holds another study (key: 0 there, 5 here)" in told
    assert ended(started(command, f"resume={parts}", "figures=false"))[0] == 0
    assert all(path.stat().st_mtime_ns == when for path, when in there.items())
    ours, theirs = (files(folder) for folder in (parts, whole))
    assert set(ours) == set(theirs)
    assert {name for name in ours if ours[name] != theirs[name]} <= {"config.yaml", "hydra.yaml", "overrides.yaml"}


def pieces(folder: Path) -> list[Path]:
    return sorted((folder / "chunks").glob("pieces-*.npz"))


def started(command: str, *options: str) -> subprocess.Popen[str]:
    line = [sys.executable, "-m", f"qocjax.{command}", *options]
    return subprocess.Popen(line, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def stopped(process: subprocess.Popen[str], folder: Path, count: int, how: signal.Signals) -> tuple[int, str]:
    """Sends a signal once a folder holds some files of pieces; code and errors."""
    deadline = time.monotonic() + 300
    while process.poll() is None and len(pieces(folder)) < count and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(how)
    return ended(process)


def ended(process: subprocess.Popen[str]) -> tuple[int, str]:
    _, told = process.communicate()
    return process.returncode, told


@pytest.mark.parametrize("choice", [f"{group}={path.stem}" for group in ("network", "robot", "controller", "scenario")
                                    for path in sorted((conf_dir() / group).glob("*.yaml"))])  # fmt: skip
def test_whatever_is_chosen_has_a_name(choice: str) -> None:
    given = {"network=trace": None, "controller=custom": None, "controller=navigation": ["scenario=hall"]}
    more = given.get(choice, [])
    if more is None:
        pytest.skip("needs a file")
    schema = import_module("qocjax.sweep").main.model()
    config = load(schema, compose("sweep", [choice, *more, "sweep=base"]))
    values = config.build_scenario(), config.build_network(), config.build_controller(), config.loop.build()
    assert list(told(values, of_run=True)) == list(told(values, of_run=True))
