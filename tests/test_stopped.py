"""Ctrl-C, SIGTERM, SIGHUP and kill -9 at random moments: a command ends at once, whole, and can be gone on with."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from bag_files import packed
from bags import ODOM, STAMPED, pose, stamped, write_bag
from stopped import CODES, LISTENS, Stop, not_ignored, resident, session, stop  # noqa: F401 - a fixture

pytestmark = [
    pytest.mark.slow,
    pytest.mark.usefixtures("not_ignored"),
    pytest.mark.skipif(not LISTENS, reason="looks at processes in /proc"),
]

ROOT = Path(__file__).parents[1]
SMALL = [
    "sweep=kappa", "sweep.grids.kappa=[1,2,3]", "sweep.deadline_ms=[150,400,800]", "sweep.seeds=64",
    "sweep.evaluation_seeds=32", "scenario.horizon=10",
]  # fmt: skip
STUDIES = {
    "one batch a chunk": ([*SMALL, "chunk_steps=1e5"], 20),
    "several batches a chunk": ([*SMALL, "sweep.seeds=3200", "chunk_steps=1e7"], 20),
    "the main job": ([], 12),
}
TABLES = ("results.csv", "results.parquet", "policies.csv", "policies.parquet")


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    cache = tmp_path_factory.mktemp("xla")
    return os.environ | {"PYTHONPATH": str(ROOT), "JAX_COMPILATION_CACHE_DIR": str(cache), "JAX_PLATFORMS": "cpu"}


def command(name: str, *options: str) -> list[str]:
    return [sys.executable, "-W", "ignore", "-m", f"qocjax.{name}", *options]


def check(ended: Stop, number: signal.Signals) -> None:
    """Soon, with its code, a line, and no process left."""
    assert ended.code == CODES[number], ended
    assert ended.took < 2, ended
    assert not ended.left, ended
    told = [line for line in ended.err.splitlines() if not line.startswith("note: ") and "%|" not in line and line]
    assert len(told) == 1 and told[0].startswith("stopped: "), ended


@pytest.mark.parametrize("study", STUDIES)
def test_a_study_stopped_at_random_moments_ends_at_once_and_goes_on(
    study: str, environment: dict[str, str], tmp_path: Path
) -> None:
    options, tries = STUDIES[study]
    tries = int(os.environ.get("QOCJAX_STOPS", tries))
    for name in ("warm", "whole"):
        begun = time.monotonic()
        subprocess.run(command("sweep", *options, f"hydra.run.dir={tmp_path / name}"), env=environment, check=True,
                       capture_output=True)  # fmt: skip
        duration = time.monotonic() - begun
    chance, number, log = random.Random(study), 0, []
    while len(log) < tries:
        way = list(CODES)[len(log) % len(CODES)]
        folder = tmp_path / f"cut{number}"
        ended = stop(
            command("sweep", *options, f"hydra.run.dir={folder}"), environment, chance.uniform(0, duration), way,
            times=chance.choice([1, 1, 2]), group=way != signal.SIGTERM and chance.random() < 0.5,
        )  # fmt: skip
        if ended is None:
            number += 1
            continue
        if ended.code in (0, -way) and (folder / "record.json").is_file():  # it was done, or Python at its own end
            number += 1
            continue
        log.append((way.name, round(ended.took, 2)))
        check(ended, way)
        assert f"resume={folder} goes on" in ended.err or "the same command starts it again" in ended.err, ended
    print(duration, log)
    for folder in tmp_path.glob("cut*"):
        subprocess.run(command("sweep", *options, f"hydra.run.dir={folder}"), env=environment, check=True,
                       capture_output=True)  # fmt: skip
        for name in TABLES:
            assert (folder / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), (folder, name)
        here, whole = ({str(path.relative_to(at)) for path in at.rglob("*")} for at in (folder, tmp_path / "whole"))
        assert here == whole


def test_kill_9_leaves_no_process_and_no_memory(environment: dict[str, str], tmp_path: Path) -> None:
    """Ten kills with figures: while the process that draws starts, waits and draws."""
    held = []
    for k in range(10):
        seconds = 1 + 0.7 * k
        process = subprocess.Popen(
            command("sweep", *SMALL, "sweep.seeds=3200", f"hydra.run.dir={tmp_path / str(k)}"), env=environment,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        time.sleep(seconds)
        before = session(process.pid)
        process.kill()
        process.wait()
        held.append((len(before), round(sum(map(resident, before)))))
        end = time.monotonic() + 2
        while time.monotonic() < end and session(process.pid):
            time.sleep(0.02)
        left = session(process.pid)
        assert not left, [(each, resident(each)) for each in left]
    print(held)
    assert max(number for number, _ in held) >= 3  # the one that draws, and Python's own that tidies up, among them


def bag(folder: Path) -> Path:
    """A recording that takes a while to read, packed, so that it is unpacked beside."""
    messages = [each for k in range(6000) for each in (
        (0.05 * k, "/odom", ODOM, pose(ODOM, 0.05 * k, 0.001 * k, 0.0, 0.0, "odom")),
        (0.05 * k + 0.02, "/cmd_vel", STAMPED, stamped(0.05 * k, 0.02, 0.001 * k)),
    )]  # fmt: skip
    return packed(next(write_bag(folder / "bag", messages).glob("*.db3"))).parent


OTHERS = ("tune", "advise", "codesign", "qos", "validate", "show", "compare", "ingest", "fleet", "sweep")


@pytest.fixture(scope="module")
def inputs(environment: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """Options that each command cannot do without."""
    folder = tmp_path_factory.mktemp("inputs")
    for name in ("a", "b"):
        subprocess.run(command("sweep", *SMALL, "figures=false", "report=false", f"hydra.run.dir={folder / name}"),
                       env=environment, check=True, capture_output=True)  # fmt: skip
    return {"compare": [str(folder / "a"), str(folder / "b")], "ingest": [f"path={bag(folder)}"]}


@pytest.mark.parametrize("name", OTHERS)
def test_every_command_ends_at_once_also_while_it_imports_or_compiles(
    name: str, inputs: dict[str, list[str]], environment: dict[str, str], tmp_path: Path
) -> None:
    chance, log = random.Random(name), []
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    for k in range(int(os.environ.get("QOCJAX_STOPS", 4))):
        way = list(CODES)[k % len(CODES)]
        folder, cache = tmp_path / str(k), tmp_path / f"cache{k}"  # so that every program is compiled
        ended = stop(
            command(name, *inputs.get(name, ()), f"hydra.run.dir={folder}"),
            environment | {"JAX_COMPILATION_CACHE_DIR": str(cache), "TMPDIR": str(scratch)},
            chance.uniform(0, 4) if k % 2 else chance.uniform(2, 12), way, times=chance.choice([1, 1, 2]),
        )  # fmt: skip
        if ended is None or (ended.code == -way and not ended.err):
            continue
        log.append((way.name, round(ended.took, 2), ended.err.strip().rpartition("\n")[2]))
        check(ended, way)
    print(name, log)
    assert log and not list(scratch.iterdir())
