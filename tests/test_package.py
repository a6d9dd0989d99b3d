"""The package as people get it: the wheel in an empty folder, the command line and its refusals, every YAML file."""

from __future__ import annotations

import importlib
import json
import os
import re
import shlex
import subprocess
import sys
import sysconfig
import venv
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from guide import write_guide
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

import qocjax
from qocjax.commands.command_line import _expanded, _of_target
from qocjax.config import SimulationConfig, StudyConfig, conf_dir, load
from qocjax.config.fleet import FleetConfig
from qocjax.config.ingest import IngestConfig

ROOT = Path(__file__).parents[1]
CONF = ROOT / "conf"
SWEEPS = ["v_max", "eta", "tau", "kappa", "gamma", "c_miss"]
POLICIES = ["Co-design", "MinDelay", "MaxRel"]

# What files of the configuration leave open.
SAMPLES = {
    "network/trace": ["network.path=loop.csv", "network.column=rtt", "network.unit=ms"],
    "delay/samples": [f"network.compute.{item}" for item in ("path=loop.csv", "column=rtt", "unit=ms")],
    "delay/histogram": ["network.compute.path=delays.xml"],
    "controller/custom": ["controller._target_=qocjax.controllers.Apf"],
    "effort/custom": ["controller=custom", "controller._target_=qocjax.controllers.Apf"],
    "sweep/alpha": ["controller=cbf"],
    "sweep/cbf": ["controller=cbf"],
    "reading/default": ["path=logs"],
    "measured/csv": ["measured.path=auc.csv", "measured.unit=ms"],
    "measured/recorded": ["measured.path=runs"],
    **{f"stamps/{path.stem}": ["path=logs"] for path in (CONF / "stamps").glob("*.yaml")},
}
NEEDED = {"ingest": ["path=logs"], "compare": ["studies=[a,b]"]}  # without which a command has nothing to do
# Groups of parts of a network: the network, and the place in it.
PLACES = {
    "delay": ("loop", "delay@network.compute"),
    "loss": ("loop", "loss@network.uplink.loss"),
    "profile": ("dds", "profile@network.uplink.profile"),
    "edge": ("loop", "edge@network.edge"),
}
COMMANDS = sorted(path.stem for path in CONF.glob("*.yaml"))
MAPS = CONF / "maps"  # what scenarios name, no choices
CHOICES = sorted(
    path.relative_to(CONF).with_suffix("").as_posix() for path in CONF.glob("*/*.yaml") if path.parent != MAPS
)
DOCUMENTS = [
    "CONTRIBUTING.md",
    "README.md",
    "experiments/README.md",
    *(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md")),
    *(f"conf/help/{command}.yaml" for command in COMMANDS),
]
WITHOUT = ("docs/api.md", "docs/model.md")  # any command to be typed in

SMALL = [
    "sweep=kappa", "sweep.grids.kappa=[1,2]", "sweep.deadline_ms=[150,800]", "sweep.seeds=2",
    "sweep.evaluation_seeds=2", "scenario.horizon=5", "figures=false", "report=false",
]  # fmt: skip

# Options, and what the one line about them says.
BAD_INPUT = {
    "unknown key": (["+robot.wheels=2"], "robot.wheels: got an unknown option"),
    "wrong type": (["controller.kappa=much"], "controller.kappa: got 'much', expected a valid number"),
    "not a number": (["controller.eta=nan"], "eta: got nan, expected a finite number"),
    "negative period": (["loop.tau=-0.01"], "tau: got -0.01, expected > 0"),
    "empty grid": (["sweep.grids.kappa=[]"], "kappa: got an empty grid, expected at least one value"),
    "start on the reference": (
        ["scenario=single", "scenario.normaliser=initial_disagreement"],
        "disagreement 0 (initial_disagreement), expected it off the reference, or the normaliser 'goal_distance'",
    ),
    "nothing given": (["network=trace"], "network.path: got nothing, expected a value"),
    "no such file": (["network=trace", *SAMPLES["network/trace"]], "loop.csv: no such file"),
    "key too large": (["key=2147483648"], "key: got 2147483648, expected less than 2147483648"),
}

# What Hydra itself finds, before anything of ours runs.
BAD_OPTIONS = {
    "unknown option": (["wheels=2"], "wheels: got an unknown option"),
    "misspelt option": (["network.comput=0.02"], "did you mean network.compute?"),
    "group left out": (["tau=0.02"], "did you mean loop.tau or"),
    "misspelt group": (["netwrk=trace"], "did you mean network?"),
    "no option": (["loop.csv"], "command line: got loop.csv, expected option=value"),
    "unknown network": (["network=carrier_pigeon"], "Could not find 'network/carrier_pigeon'"),
    "another command's help": (["help=tune"], "help: got help=tune, expected --help"),
    "unknown experiment": (["experiment=missing"], "Could not find 'experiment/missing'"),
}

# Runs the command line once for each list of options in one process: most of the time of such a run is its imports.
ONE_BY_ONE = """
import contextlib, io, json, sys
from qocjax.sweep import main
for options in json.loads(sys.argv[1]):
    sys.argv = ["qocjax.sweep", *options]
    out, err, code = io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main()
        except SystemExit as stop:
            code = stop.code
    print(json.dumps([code, out.getvalue(), err.getvalue()]))
"""


def test_the_citations_are_of_this_version() -> None:
    assert OmegaConf.load(ROOT / "CITATION.cff").version == qocjax.__version__
    assert f"version = {{{qocjax.__version__}}}" in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """For commands: the checkout first on the path, and compiled programs shared among them."""
    cache = tmp_path_factory.mktemp("xla")
    return os.environ | {"PYTHONPATH": str(ROOT), "JAX_COMPILATION_CACHE_DIR": str(cache), "JAX_PLATFORMS": "cpu"}


def sweep(options: list[str], folder: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return python(sys.executable, ["-m", "qocjax.sweep", *options], folder, environment)


def python(
    executable: str | Path, arguments: list[str], folder: Path, environment: dict[str, str]
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(executable), *arguments], cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True,
        encoding="utf-8", timeout=300,
    )  # fmt: skip


@pytest.fixture(scope="module")
def refusals(tmp_path_factory: pytest.TempPathFactory, environment: dict[str, str]) -> dict[str, tuple[int, str, str]]:
    """Exit code, output and errors of each command with bad input."""
    cases = BAD_INPUT | BAD_OPTIONS
    options = json.dumps([options for options, _ in cases.values()])
    done = python(sys.executable, ["-c", ONE_BY_ONE, options], tmp_path_factory.mktemp("refused"), environment)
    assert done.returncode == 0, done.stderr
    return {case: json.loads(line) for case, line in zip(cases, done.stdout.splitlines(), strict=True)}


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_input_ends_with_one_line_that_names_it(case: str, refusals: dict[str, tuple[int, str, str]]) -> None:
    code, out, err = refusals[case]
    assert (code, out) == (2, "")
    (line,) = err.splitlines()
    assert line.startswith("error: ")
    assert BAD_INPUT[case][1] in line


@pytest.mark.parametrize("case", BAD_OPTIONS)
def test_unknown_options_are_refused(case: str, refusals: dict[str, tuple[int, str, str]]) -> None:
    code, out, err = refusals[case]
    assert (code, out) == (2, "")
    (line,) = err.splitlines()
    assert line.startswith("error: ") and BAD_OPTIONS[case][1] in line


def test_a_bad_command_fails_and_leaves_nothing_behind(environment: dict[str, str], tmp_path: Path) -> None:
    done = sweep(["loop.tau=-0.01", f"hydra.run.dir={tmp_path / 'bad'}"], tmp_path, environment)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", "error: tau: got -0.01, expected > 0\n")
    assert not list(tmp_path.rglob("*.csv"))


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from the source distribution."""
    pytest.importorskip("build")
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    done = subprocess.run(command, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stdout + done.stderr
    (path,) = folder.glob("qocjax-*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of a new environment with the wheel; what it depends on is taken from that of the tests."""
    pytest.importorskip("pip")
    home = tmp_path_factory.mktemp("fresh")
    venv.create(home, symlinks=os.name == "posix", with_pip=False)
    paths = sysconfig.get_paths(vars={"base": str(home), "platbase": str(home)})
    executable = Path(paths["scripts"]) / Path(sys.executable).name
    borrowed = {sysconfig.get_paths()[kind] for kind in ("purelib", "platlib")}
    Path(paths["purelib"], "borrowed.pth").write_text("\n".join(borrowed), encoding="utf-8")
    install = ["-m", "pip", "--python", str(executable), "install", "--quiet", "--no-deps", "--no-index"]
    done = python(sys.executable, [*install, "--force-reinstall", str(wheel)], home, dict(os.environ))
    assert done.returncode == 0, done.stderr
    return executable


@pytest.fixture(scope="module")
def away(environment: dict[str, str]) -> dict[str, str]:
    """Environment of commands that must not see the checkout."""
    return {name: value for name, value in environment.items() if name != "PYTHONPATH"}


@pytest.fixture(scope="module")
def study(
    installed: Path, away: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> tuple[subprocess.CompletedProcess[str], Path]:
    """The study `ci`, run from the wheel in an empty folder; and the folder of its results."""
    folder = tmp_path_factory.mktemp("empty")
    done = python(installed, ["-m", "qocjax.sweep", "experiment=ci"], folder, away)
    assert done.returncode == 0, done.stderr
    (results,) = (folder / "results" / "sweep").iterdir()
    return done, results


def test_wheel_holds_configuration_tables_and_licence(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    wanted = {f"qocjax/conf/{path.relative_to(CONF).as_posix()}" for path in CONF.rglob("*.yaml")}
    wanted |= {f"qocjax/conf/maps/{path.name}" for path in MAPS.iterdir()}
    wanted |= {path.relative_to(ROOT).as_posix() for path in (ROOT / "qocjax").rglob("*.py")}
    wanted |= {path.relative_to(ROOT).as_posix() for path in (ROOT / "qocjax" / "report" / "assets").iterdir()}
    wanted |= {"qocjax/py.typed", "qocjax/network/tables/kth_5g.csv", "qocjax/network/tables/README.md"}
    wanted |= {"qocjax/nav2/facts.csv", "qocjax/study/tables/choices.csv", "qocjax/config/scales/paper.yaml"}
    assert {name for name in names if name.startswith("qocjax/")} == wanted
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_what_runs_is_the_wheel(installed: Path, away: dict[str, str], tmp_path: Path) -> None:
    code = "import qocjax, qocjax.config, importlib.metadata as m, json; print(json.dumps([qocjax.__file__, " \
           "str(qocjax.config.conf_dir()), qocjax.__version__, m.version('qocjax')]))"  # fmt: skip
    done = python(installed, ["-c", code], tmp_path, away)
    assert done.returncode == 0, done.stderr
    package, conf, *versions = json.loads(done.stdout)
    home = installed.parents[1].resolve()
    assert Path(package).resolve().is_relative_to(home)
    assert Path(conf).resolve().is_relative_to(home)
    assert versions == [qocjax.__version__] * 2


def test_study_prints_its_table_and_no_progress_bar(study: tuple[subprocess.CompletedProcess[str], Path]) -> None:
    done, folder = study
    assert "simulating" not in done.stderr
    lines = done.stdout.splitlines()
    assert [line.split()[:2] for line in lines[1:19:3]] == [[name, "Co-design"] for name in SWEEPS]
    assert lines[-1] == f"Tables, figures and the record are in {folder}"


def test_policies_come_out_in_order(study: tuple[subprocess.CompletedProcess[str], Path]) -> None:
    table = pd.read_csv(study[1] / "policies.csv")
    assert not table.drop(columns="at_edge").isna().to_numpy().any()
    assert list(zip(table["sweep"], table["policy"], strict=True)) == [(s, p) for s in SWEEPS for p in POLICIES]
    other = table[table["policy"] != "Co-design"]
    best = table[table["policy"] == "Co-design"].set_index("sweep")["qoc"]
    assert (other["qoc"].to_numpy() <= best[other["sweep"]].to_numpy()).all()
    free = table[table["policy"] == "Co-design"].set_index("sweep")["unconstrained_qoc"]
    assert (other["unconstrained_qoc"].to_numpy() < free[other["sweep"]].to_numpy()).all()
    assert (other.loc[other["sweep"] != "eta", "difference_high"] < 0).all()
    # With eta = 0 robots run into each other, and QoC alone would choose it; so the limit on collisions decides.
    eta = table[table["sweep"] == "eta"].set_index("policy")
    assert eta.loc["Co-design", "value"] > 0 and eta.loc["Co-design", "within_limit"]
    assert (
        eta.loc["Co-design", "unconstrained_value"] == 0 and eta.loc["Co-design", "unconstrained_collision_share"] > 0.5
    )
    assert not eta.loc["MaxRel", "within_limit"]
    differences = other["qoc"].to_numpy() - best[other["sweep"]].to_numpy()
    np.testing.assert_allclose(other["difference"], differences, atol=1e-8)
    assert (table["qoc_low"] < table["qoc"]).all() and (table["qoc"] < table["qoc_high"]).all()
    assert set(table.loc[table["policy"] == "MaxRel", "deadline"]) == {0.8}
    assert set(table.loc[table["policy"] == "MinDelay", "deadline"]) == {0.1}


def test_results_hold_the_whole_grid(study: tuple[subprocess.CompletedProcess[str], Path]) -> None:
    table = pd.read_csv(study[1] / "results.csv")
    config = OmegaConf.load(study[1] / "config.yaml")
    assert not table.isna().to_numpy().any()
    grids = {str(name): list(values) for name, values in config.sweep.grids.items()}
    assert list(grids) == SWEEPS
    for name, values in grids.items():
        rows = table[table["sweep"] == name]
        assert sorted(set(rows["value"])) == values
        np.testing.assert_allclose(rows["value"], rows[name])
        assert len(rows) == len(values) * len(config.sweep.deadline_ms)
    assert table["qoc"].between(0, 1).all()
    assert (table["diverged_share"] == 0).all()


def test_files_can_be_read_and_agree(study: tuple[subprocess.CompletedProcess[str], Path]) -> None:
    folder = study[1]
    for name in ("results", "policies"):
        parquet = pytest.importorskip("pyarrow.parquet").read_table(folder / f"{name}.parquet").to_pandas()
        table = pd.read_csv(folder / f"{name}.csv")
        if "at_edge" in table:  # empty where the choice lies within
            table["at_edge"] = table["at_edge"].astype(object).where(table["at_edge"].notna(), "")
        pd.testing.assert_frame_equal(table, parquet, check_dtype=False, rtol=1e-8)
    record = json.loads((folder / "record.json").read_text(encoding="utf-8"))
    assert record["versions"]["qocjax"] == qocjax.__version__
    assert record["j_max"] >= record["j_med"] > 0
    assert "policies" in (folder / "report.html").read_text(encoding="utf-8")
    figures = {path.stem for path in (folder / "figures").iterdir()}
    assert {"policies", "trajectories", *(f"qoc_{name}" for name in SWEEPS)} <= figures
    for path in (folder / "figures").iterdir():
        assert path.read_bytes().startswith({".png": b"\x89PNG", ".pdf": b"%PDF"}[path.suffix])


def test_help_tells_choices_and_options(environment: dict[str, str], tmp_path: Path) -> None:
    done = sweep(["--help"], tmp_path, environment)
    assert done.returncode == 0, done.stderr
    for text in (
        "network: cell, dds, fastdds, kth_5g, loop, paper, trace", "python -m qocjax.sweep --multirun",
        "sweep.seeds=32  ", "Monte Carlo seeds on which designs are chosen", "${robot.v_max}",
    ):  # fmt: skip
        assert text in done.stdout
    for group in ("calibrate", "help", "maps", "measured", "optimiser", "output", "profile", "reading", "stamps"):
        assert f"\n{group}: " not in done.stdout  # those of others
    assert max(map(len, done.stdout.splitlines())) <= 120
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_multirun_runs_one_study_after_the_other(environment: dict[str, str], tmp_path: Path) -> None:
    options = ["--multirun", "loop.hold=hold,zero", f"hydra.sweep.dir={tmp_path / 'both'}", *SMALL]
    done = sweep(options, tmp_path, environment)
    assert done.returncode == 0, done.stderr
    scores = []
    for number, hold in enumerate(("hold", "zero")):
        folder = tmp_path / "both" / str(number)
        assert OmegaConf.load(folder / "config.yaml").loop.hold == hold
        scores.append(pd.read_csv(folder / "results.csv")["completed_share"])
        assert not (folder / "figures").exists()
    pd.testing.assert_series_equal(*scores)  # the same loop times


def groups(command: str) -> set[str]:
    """Groups of options that a command has."""
    defaults = OmegaConf.load(CONF / f"{command}.yaml").defaults
    return {str(group) for item in defaults if not isinstance(item, str) for group in item}


def commands(text: str) -> Iterator[tuple[str, list[str]]]:
    """Each `python -m qocjax.<command> ...` in a text with its options; what follows two blanks is not part of it.

    Nodes, `qocjax.ros.<node>`, take no such options.
    """
    for line in re.sub(r"\\\n\s*", "", text).splitlines():
        for command, rest in re.findall(r"python3? -m qocjax\.(\w+)(?!\w|\.\w)([^`]*)", line):
            if "[option" not in rest:
                yield command, shlex.split(re.split(r"\s{2,}", rest)[0], comments=True)


def command_of(experiment: str) -> str:
    """The command in the comment that an experiment begins with."""
    comment = re.match(r"(#.*\n)+", (CONF / "experiment" / f"{experiment}.yaml").read_text(encoding="utf-8"))
    assert comment is not None
    named = [command for command, options in commands(comment[0]) if f"experiment={experiment}" in options]
    return named[0]


@pytest.fixture
def composer() -> Iterator[None]:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        yield


def composed(command: str, options: list[str]) -> SimulationConfig | FleetConfig | IngestConfig:
    """A configuration, checked against the command's schema."""
    door = importlib.import_module(f"qocjax.{command}").main
    return load(door.model(), compose(command, door.rewrite(options)))


def build(config: FleetConfig | IngestConfig) -> None:
    """All that such a configuration says, short of running it."""
    config.check() if isinstance(config, FleetConfig) else config.build()


@pytest.mark.parametrize("choice", CHOICES)
def test_every_choice_composes(choice: str, composer: None) -> None:
    group, name = choice.split("/")
    if group == "experiment":
        command = command_of(name)
    else:
        wanted = "network" if group in PLACES else group
        command = next(command for command in ("sweep", *COMMANDS) if wanted in groups(command))
    network, place = PLACES.get(group, (None, group))
    others = [f"network={network}"] if network else []
    config = composed(command, [*others, f"{place}={name}", *SAMPLES.get(choice, [])])
    if not isinstance(config, SimulationConfig):
        build(config)
        return
    config.build_scenario()
    config.loop.build()
    if isinstance(config, StudyConfig) and config.sweep.grids:
        assert set(config.build_grid().sweep) == set(config.sweep.grids) - set(config.robot.unread)


@pytest.mark.parametrize("document", DOCUMENTS)
def test_commands_of_the_documents_compose(
    document: str, composer: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_guide(tmp_path)  # whose law they name
    monkeypatch.syspath_prepend(tmp_path)
    found = list(commands((ROOT / document).read_text(encoding="utf-8")))
    assert bool(found) == (document not in WITHOUT)
    for command, options in found:
        flags = [option for option in options if option.startswith("--")]
        assert set(flags) <= {"--multirun", "--help"}
        jobs = [option.split(",")[0] if "--multirun" in flags and "[" not in option else option for option in options]
        ours = [option for option in jobs if not option.startswith(("hydra/", "hydra.launcher"))]  # of a plugin
        given = [option for option in ours if option not in flags]
        if command == "advise":
            given = _expanded(given, {"path": ("network=trace", "network.path")})
        config = composed(command, _of_target(given) or NEEDED.get(command, []))
        config.baseline() if isinstance(config, SimulationConfig) else build(config)


@pytest.mark.parametrize("document", [each for each in DOCUMENTS if not each.startswith("conf/help/")])
def test_folders_that_a_command_reads_were_written_before(document: str) -> None:
    """Someone who runs the commands of a document in its order meets no folder that is not there."""
    written: set[str] = set()
    for command, options in commands((ROOT / document).read_text(encoding="utf-8")):
        given = dict(option.split("=", 1) for option in options if "=" in option)
        listed = given.get("studies", "").strip("[]").split(",")
        read = [option for option in options if command == "compare" and "=" not in option]
        wanted = {each for each in (*read, *listed, given.get("resume", "")) if each.startswith("results/")}
        assert wanted <= written, (command, options)
        written.add(given.get("hydra.run.dir", ""))


def test_code_of_the_readme_runs(environment: dict[str, str], tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    done = python(sys.executable, ["-c", code], tmp_path, environment)
    assert done.returncode == 0, done.stderr
    best, *others = [float(text) for text in done.stdout.splitlines()[-1].strip("[]").split()]
    assert all(best < other for other in others)  # at this deadline the smallest goal gain is the best of the three
