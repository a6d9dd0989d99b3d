"""Faults and bad input by the number: what docs/faults.md counts."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from wrong_inputs import leaves

from qocjax import open_study
from qocjax.config import conf_dir
from qocjax.store.checked import read_checked
from qocjax.sweep import main

hypothesis = pytest.importorskip("hypothesis")
st = hypothesis.strategies

ROOT = Path(__file__).parents[1]
SMALL = [
    "sweep=kappa", "sweep.grids.kappa=[1,2,3]", "sweep.deadline_ms=[150,400,800]", "sweep.seeds=64",
    "sweep.evaluation_seeds=32", "scenario.horizon=10", "chunk_steps=100000", "figures=false", "report=false",
]  # fmt: skip
TABLES = ("results.csv", "results.parquet", "policies.csv", "policies.parquet")


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    cache = tmp_path_factory.mktemp("xla")
    return os.environ | {"PYTHONPATH": str(ROOT), "JAX_COMPILATION_CACHE_DIR": str(cache), "JAX_PLATFORMS": "cpu"}


def sweep(options: list[str], environment: dict[str, str], before: str = "") -> subprocess.CompletedProcess[str]:
    """The command; after `before`, in a mount namespace of its own, where that is given."""
    command = [sys.executable, "-m", "qocjax.sweep", *options]
    if before:
        command = ["unshare", "--mount", "bash", "-c", f'{before} "$@"', "bash", *command]
    return subprocess.run(command, env=environment, capture_output=True, encoding="utf-8", timeout=300)


# Malformed configurations


def default() -> dict[str, Any]:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return OmegaConf.to_container(compose("sweep", []), resolve=True)  # type: ignore[return-value]


# Whose every value of the type is allowed, or which nothing reads in the default study.
ANY_TEXT = ("network.name", "resume", "scenario.map")
LEAVES = dict(leaves(default()))
NUMBERS = [name for name, value in LEAVES.items() if isinstance(value, float) and not isinstance(value, bool)]
WHOLE = [name for name, value in LEAVES.items() if isinstance(value, int) and not isinstance(value, bool)]
FLAGS = [name for name, value in LEAVES.items() if isinstance(value, bool)]
LISTS = [name for name, value in LEAVES.items() if isinstance(value, list)]
WORDS = [name for name, value in LEAVES.items() if isinstance(value, str) and name not in ANY_TEXT]
POSITIVE = [
    "robot.v_max", "robot.omega_max", "robot.radius", "controller.d_safe", "loop.tau", "scenario.horizon",
    "scenario.reference.kappa", "scenario.reference.v_max", "chunk_steps", "loop.hold_timeout", "loop.hold_decay",
]  # fmt: skip
UNFINISHED = ["=[1", "={", "=${", "='", "=[1,,2]"]
GROUPS = ("robot", "controller", "loop", "scenario", "network", "sweep", "experiment")

no_number = st.sampled_from(
    ["much", "nan", "null", "[1]", "[]", "{a: 1}", "true", "'1'", "1s", "1..2", "${nothing}", "''"]
)
no_list = st.sampled_from(["5", "much", "true", "null", "{a: 1}", "[much]", "[[[1]]]", "[nan,nan]", "[null]"])
word = st.text("abcdefghijklmnopqrstuvwxyz_", min_size=3, max_size=12)
noise = st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=8)


def given(name: st.SearchStrategy[str], value: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.builds("{}={}".format, name, value)


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


malformed = st.one_of(
    given(st.sampled_from(NUMBERS), no_number),
    given(st.sampled_from(WHOLE), st.one_of(no_number, st.sampled_from(["1.5", "1e3", "-1e30"]))),
    given(st.sampled_from(FLAGS), st.sampled_from(["maybe", "3", "null", "[true]", "nan"])),
    given(st.sampled_from(LISTS), no_list),
    given(st.sampled_from(WORDS), st.one_of(word.map("no_".__add__), st.sampled_from(["3", "null", "[a]", "true"]))),
    given(st.sampled_from(POSITIVE), st.floats(max_value=0, allow_nan=False, allow_subnormal=False).map(repr)),
    given(st.sampled_from(["robot.v_max", "loop.tau", "key"]), noise.filter(lambda text: not is_number(text))),
    given(st.sampled_from(GROUPS), word.map("no_".__add__)),
    given(word.map("no_".__add__), word),  # an option that there is not
    given(st.tuples(st.sampled_from(GROUPS[:-1]), word).map(lambda pair: f"+{pair[0]}.no_{pair[1]}"), word),
    st.tuples(st.sampled_from(sorted(LEAVES)), st.sampled_from(UNFINISHED)).map("".join),
    st.sampled_from(sorted(LEAVES)).map("~{}".format),  # an option taken away
    given(st.just("sweep.deadline_ms"), st.sampled_from(["[]", "[-1]", "[100,100]", "[inf]", "[1]", "[a]"])),
    given(st.just("sweep.grids.kappa"), st.sampled_from(["[]", "[-1]", "[1,1]", "[inf]", "[1e39]", "{}"])),
    given(st.sampled_from(["sweep.seeds", "sweep.evaluation_seeds"]), st.integers(max_value=1).map(str)),
    given(st.just("sweep.min_reliability"), st.sampled_from(["-0.1", "1.1", "nan"])),
    st.sampled_from(["sweep.j_med=1", "sweep.j_max=1", "scenario.start=[]", "scenario.start=[[1,2]]", "key=1e99"]),
)  # fmt: skip


@pytest.fixture(scope="module")
def run_main(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The command line in this process: exit code, output and errors."""
    folder = tmp_path_factory.mktemp("bad")
    quiet = ["hydra/job_logging=none", "hydra/hydra_logging=none", "hydra.output_subdir=null"]
    with pytest.MonkeyPatch.context() as patch:
        for name in ("XLA_FLAGS", "HYDRA_FULL_ERROR"):
            patch.setenv(name, os.environ.get(name, ""))
        patch.setenv("JAX_COMPILATION_CACHE_DIR", str(folder / "xla"))

        def run(*options: str) -> tuple[int, str, str]:
            out, err = io.StringIO(), io.StringIO()
            patch.setattr(sys, "argv", ["qocjax.sweep", f"hydra.run.dir={folder / 'run'}", *quiet, *options])
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                try:
                    main()
                except SystemExit as stop:
                    return int(stop.code or 0), out.getvalue(), err.getvalue()
            return 0, out.getvalue(), err.getvalue()

        yield run
        patch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", ""))


def refused(option: str, run_main: Any) -> None:
    code, out, err = run_main("sweep=kappa", "sweep.seeds=2", "sweep.evaluation_seeds=2", "scenario.horizon=1", option)
    assert code == 2 and not out, (option, code, out)
    assert err.startswith("error: ") and err.count("\n") == 1 and "Traceback" not in err, (option, err)
    assert len(err) > 12, (option, err)


SETTINGS = {
    "database": None,
    "derandomize": True,
    "deadline": None,
    "suppress_health_check": list(hypothesis.HealthCheck),
}


@hypothesis.given(option=malformed)
@hypothesis.settings(max_examples=15, **SETTINGS)
def test_malformed_configurations_end_in_one_line(option: str, run_main: Any) -> None:
    refused(option, run_main)


@pytest.mark.slow
@hypothesis.given(option=malformed)
@hypothesis.settings(max_examples=200, **{**SETTINGS, "derandomize": False})
@hypothesis.seed(7)
def test_200_malformed_configurations_end_in_one_line(option: str, run_main: Any) -> None:
    refused(option, run_main)


# Kills, disks


# Starts the study again and again in a process of its own, and kills each at a random moment after it has begun.
KILLER = """
import json, os, random, shutil, signal, sys, time
from pathlib import Path
from hydra import compose, initialize_config_dir
from qocjax import sweep
from qocjax._xla import request_whole_loop
from qocjax.config import StudyConfig, conf_dir, load

home, options, kills = Path(sys.argv[1]), json.loads(sys.argv[2]), int(sys.argv[3])
request_whole_loop()
with initialize_config_dir(str(conf_dir()), version_base="1.3"):
    config = load(StudyConfig, compose("sweep", options))


def chunks_of(folder):
    return len(list((folder / "chunks").glob("[!.]*-*.npz")))


def start(folder, kill_after):
    child = os.fork()
    if child == 0:
        try:
            sweep.run(config, folder, quiet=True)
            os._exit(0)
        finally:
            os._exit(1)
    before = time.monotonic()
    while not (folder / "study.json").exists() and time.monotonic() < before + 60:
        time.sleep(0.001)
    begun, held = time.monotonic(), chunks_of(folder)
    while os.waitpid(child, os.WNOHANG) == (0, 0):
        if kill_after is not None and chunks_of(folder) < held + kill_after[0]:
            begun = time.monotonic()  # the moment counts from some new chunk on
        elif kill_after is not None and time.monotonic() > begun + kill_after[1]:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return time.monotonic() - begun, True
        time.sleep(0.0005)
    return time.monotonic() - begun, False


start(home / "warm", None)
duration, _ = start(home / "whole", None)
random.seed(1)
number, done, log = 0, 0, []
while done < kills:
    folder = home / f"cut{number}"
    # Some of them anywhere, as it starts too; most once chunks are being written.
    at = (0, random.uniform(0, duration)) if random.random() < 0.25 else (random.randint(1, 4), random.uniform(0, 0.03))
    spent, killed = start(folder, at)
    chunks = chunks_of(folder)
    done += killed
    number += not killed
    log.append([folder.name, round(spent, 3), killed, chunks])
start(home / f"cut{number}", None)
print(json.dumps({"duration": duration, "log": log, "folders": number + 1}))
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_kill_9_at_20_random_moments(environment: dict[str, str], tmp_path: Path) -> None:
    arguments = [sys.executable, "-W", "ignore", "-c", KILLER, str(tmp_path), json.dumps(SMALL), "20"]
    done = subprocess.run(arguments, env=environment, capture_output=True, encoding="utf-8", timeout=900)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout.splitlines()[-1])
    print(json.dumps(report))
    assert sum(killed for _, _, killed, _ in report["log"]) == 20
    assert len({chunks for _, _, killed, chunks in report["log"] if killed}) >= 4  # at different stages
    cut = sorted(tmp_path.glob("cut*"))
    assert len(cut) == report["folders"]
    for folder in cut:
        for name in TABLES:
            assert (folder / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), (folder, name)
        for path in (folder / "chunks").glob("*.npz"):
            read_checked(path)
            assert path.read_bytes() == (tmp_path / "whole" / "chunks" / path.name).read_bytes()
        assert not list(folder.rglob(".*.npz"))
        assert len(open_study(folder).runs["auc"].values)


@pytest.fixture
def mounts(tmp_path: Path) -> Path:
    """A folder to mount things on, where one may."""
    place = tmp_path / "disk"
    place.mkdir()
    probe = ["unshare", "--mount", "mount", "-t", "tmpfs", "none", str(place)]
    if shutil.which("unshare") is None or subprocess.run(probe, capture_output=True).returncode:
        pytest.skip("mounting a small disk needs root")
    return place


@pytest.mark.slow
def test_a_disk_that_is_full_and_then_is_not(environment: dict[str, str], mounts: Path, tmp_path: Path) -> None:
    """A real one, too small: the study ends in one line; with more room it goes on to the same tables."""
    whole = sweep([*SMALL, f"hydra.run.dir={tmp_path / 'whole'}"], environment)
    assert whole.returncode == 0, whole.stderr
    steps = (
        f'mount -t tmpfs -o size=100k none {mounts}; "$@"; code=$?; ls {mounts}/s/chunks | wc -l; '
        f'mount -o remount,size=20m {mounts}; "$@" > {tmp_path}/again.txt || exit 9; cp -r {mounts}/s {tmp_path}/copy; '
        "exit $code; :"
    )
    done = sweep([*SMALL, f"hydra.run.dir={mounts / 's'}"], environment, steps)
    assert done.returncode == 2, done.stderr
    (line,) = [line for line in done.stderr.splitlines() if not line.startswith("note: ")]
    assert line.startswith("error: ") and "No space left on device" in line
    assert 1 < int(done.stdout.splitlines()[0]) < len(list((tmp_path / "whole" / "chunks").iterdir()))
    for name in TABLES:
        assert (tmp_path / "copy" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


@pytest.mark.slow
def test_a_read_only_folder(environment: dict[str, str], mounts: Path) -> None:
    steps = f"mount -t tmpfs -o size=1m none {mounts}; mkdir {mounts}/s; mount -o remount,ro {mounts};"
    for folder in (mounts / "s", mounts / "new"):
        done = sweep([*SMALL, f"hydra.run.dir={folder}"], environment, steps)
        assert (done.returncode, done.stdout) == (2, ""), done.stderr
        (line,) = done.stderr.splitlines()
        assert line.startswith("error: ") and str(folder) in line and "Read-only file system" in line


@pytest.mark.slow
def test_ctrl_c_stops_at_once_and_says_how_to_go_on(environment: dict[str, str], tmp_path: Path) -> None:
    folder, options = tmp_path / "s", [*SMALL, "sweep.seeds=3200"]
    command = [sys.executable, "-m", "qocjax.sweep", *options, f"hydra.run.dir={folder}"]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as process:
        while len(list(folder.glob("chunks/selection-*.npz"))) < 5:
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)
    assert (process.returncode, err) == (130, f"stopped: resume={folder} goes on\n")
    kept = {path: path.stat().st_mtime_ns for path in folder.glob("chunks/selection-*.npz")}
    done = sweep([f"resume={folder}"], environment)
    assert done.returncode == 0, done.stderr
    assert kept == {path: path.stat().st_mtime_ns for path in kept}  # not computed again
    refused = sweep([f"resume={folder}", "sweep=kappa", "key=4"], environment)
    assert refused.returncode == 2 and "key: 0 there, 4 here" in refused.stderr
