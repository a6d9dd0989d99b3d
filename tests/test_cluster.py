"""Chunks on Dask workers: the same bits, workers that die, a driver that dies, two machines."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir

pytest.importorskip("distributed", reason="the extra cluster (Dask) is not installed")

import cluster_cases
import psutil

import qocjax.cluster.engine as dask_engine
from qocjax.cluster import DaskEngine
from qocjax.cluster.local import shares
from qocjax.cluster.worker import Recipe, run_chunk, settings_here
from qocjax.config import StudyConfig, build_problem, conf_dir, load
from qocjax.config.engine import DaskConfig
from qocjax.study.chunks import Chunk, Failure, Part, Result, plan
from qocjax.study.engine import LocalEngine
from qocjax.study.problem import Problem

ROOT = Path(__file__).parents[1]
OPTIONS = [
    "sweep=kappa", "sweep.grids.kappa=[1,2]", "sweep.deadline_ms=[150,800]", "sweep.seeds=160",
    "sweep.evaluation_seeds=64", "scenario.horizon=2", "figures=false", "report=false", "chunk_steps=1e5",
]  # fmt: skip
linux = pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system does not pin processes to cores")


@pytest.fixture(scope="module")
def problem() -> Problem:
    return configured().build_problem()


@pytest.fixture(scope="module")
def chunks(problem: Problem) -> list[Chunk]:
    found = plan(problem, Part("selection", range(160)), 1e5)
    assert len(found) == 6
    return found


@pytest.fixture(scope="module")
def expected(problem: Problem, chunks: list[Chunk]) -> dict[str, Result]:
    return {chunk.name: result for chunk, result in LocalEngine().run(problem, chunks) if isinstance(result, Result)}


@pytest.fixture(scope="module")
def engine() -> Iterator[DaskEngine]:
    with DaskEngine(workers=2, oversubscribe=True) as engine:
        yield engine


def configured(*options: str) -> StudyConfig:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return load(StudyConfig, compose("sweep", [*OPTIONS, *options]))


def workers() -> list[psutil.Process]:
    """Worker processes that this one has started."""
    children = psutil.Process().children(recursive=True)
    return [each for each in children if "spawn_main" in " ".join(each.cmdline())]


def same(found: Result | Failure, expected: Result) -> None:
    assert isinstance(found, Result)
    assert list(found.values) == list(expected.values)
    for name, values in expected.values.items():
        np.testing.assert_array_equal(found.values[name], values, strict=True)


def test_results_are_those_of_one_process_bit_for_bit(
    engine: DaskEngine, problem: Problem, chunks: list[Chunk], expected: dict[str, Result]
) -> None:
    found = dict(engine.run(problem, chunks))
    assert set(found) == set(chunks)
    for chunk, result in found.items():
        same(result, expected[chunk.name])
        assert result.made_with == expected[chunk.name].made_with
        assert result.attributes == expected[chunk.name].attributes


@linux
def test_workers_share_the_cores(
    engine: DaskEngine, problem: Problem, chunks: list[Chunk], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_engine, "run_chunk", cluster_cases.telling)
    told = {result.attributes["pid"]: result.attributes for _, result in engine.run(problem, chunks * 2)}
    assert len(told) == 2
    available = sorted(os.sched_getaffinity(0))
    expected = shares(available, 2, None)
    assert sorted(each["cores"] for each in told.values()) == expected
    assert {each["threads"] for each in told.values()} == {len(expected[0])}
    assert {each["own_threads"] for each in told.values()} == {0}  # no thread of JAX or Dask is left elsewhere


def test_nothing_listens_beyond_loopback(engine: DaskEngine, problem: Problem, chunks: list[Chunk]) -> None:
    list(engine.run(problem, chunks[:1]))
    assert len(workers()) == 2
    for process in (psutil.Process(), *workers()):
        open_ports = [each.laddr.ip for each in process.net_connections() if each.status == psutil.CONN_LISTEN]
        assert open_ports
        assert set(open_ports) == {"127.0.0.1"}


def test_a_chunk_without_room_is_a_failure_and_the_rest_goes_on(
    engine: DaskEngine, problem: Problem, chunks: list[Chunk], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_engine, "run_chunk", cluster_cases.too_large)
    found = {chunk.name[:15]: result for chunk, result in engine.run(problem, chunks)}
    assert found.pop("selection-00001") == Failure("MemoryError: no room for 9 GB")
    assert all(isinstance(result, Result) for result in found.values())


def test_leaving_early_calls_back_what_is_under_way(engine: DaskEngine, problem: Problem, chunks: list[Chunk]) -> None:
    results = engine.run(problem, chunks)
    next(results)
    results.close()
    assert len(list(engine.run(problem, chunks[:1]))) == 1


def test_a_wrong_problem_ends_the_study(engine: DaskEngine, chunks: list[Chunk]) -> None:
    values = configured().model_dump()
    wrong = configured().build_problem()
    values["scenario"]["start"] = [[0.0, 0.0]]
    with pytest.raises(ValueError, match=r"^start: got .* \(at the worker tcp://127.0.0.1:\d+\)$"):
        list(engine.run(Problem(**{**vars(wrong), "configuration": values}), chunks))
    bare = Problem(**{**vars(wrong), "configuration": None})
    with pytest.raises(ValueError, match="problem: got one without its configuration"):
        list(engine.run(bare, chunks))


def test_other_measured_data_is_refused(problem: Problem, chunks: list[Chunk], expected: dict[str, Result]) -> None:
    recipe = Recipe(build_problem, json.dumps(problem.configuration), problem.data())
    same(run_chunk(recipe, chunks[0], settings_here()), expected[chunks[0].name])
    with pytest.raises(ValueError, match="network, map or law: got other files than the driver's"):
        run_chunk(replace(recipe, data="other"), chunks[0], settings_here())


def test_cores_are_shared_out() -> None:
    assert shares([0, 1, 2, 3, 8], 2, None) == [[0, 1], [2, 3]]
    assert shares([4, 5, 6], 3, 1) == [[4], [5], [6]]
    assert shares([7], 2, None) == [[7], [7]]
    with pytest.raises(ValueError, match="engine.cores: got 2 for each of 2 workers, expected at most 3 together"):
        shares([0, 1, 2], 2, 2)
    with pytest.raises(ValueError, match="engine.cores: got 0"):
        shares([0, 1, 2], 2, 0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"address": "tcp://127.0.0.1:8786", "workers": 2}, "engine.workers: got 2 beside engine.address"),
        ({"workers": 0}, "engine.workers: got 0"),
        ({"workers": 1, "retries": -1}, "engine.retries: got -1"),
        ({"address": "nowhere"}, "engine.address: got nowhere, expected a Dask scheduler that answers"),
        ({"address": "tcp://127.0.0.1:1"}, "engine.address: got tcp://127.0.0.1:1, expected a Dask scheduler that"),
    ],
)
def test_bad_options_have_one_line(
    options: dict, message: str, problem: Problem, chunks: list[Chunk], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_engine, "_CONNECT", 0.5)
    with pytest.raises(ValueError, match=message) as caught, DaskEngine(**options) as engine:
        list(engine.run(problem, chunks))
    assert "\n" not in str(caught.value)


def test_dask_is_imported_only_where_it_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    code = "import sys, qocjax.sweep; sys.exit('distributed' in sys.modules or 'dask' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, env=os.environ | {"PYTHONPATH": str(ROOT)})
    for name in [name for name in sys.modules if name.startswith("qocjax.cluster")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "distributed", None)
    config = configured("engine=dask").engine
    assert isinstance(config, DaskConfig)
    with pytest.raises(ValueError, match=r"engine: got dask without Dask, expected `pip install qocjax\[cluster\]`"):
        config.open()


@pytest.mark.slow
def test_a_killed_worker_has_its_chunks_run_again(
    problem: Problem, chunks: list[Chunk], expected: dict[str, Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_engine, "run_chunk", cluster_cases.slow)
    notes: list[str] = []
    with DaskEngine(workers=2, oversubscribe=True, note=notes.append) as engine:
        found: dict[str, Result | Failure] = {}
        for number, (chunk, result) in enumerate(engine.run(problem, chunks)):
            found[chunk.name] = result
            if number in (0, 2):
                os.kill(workers()[0].pid, signal.SIGKILL)
    assert set(found) == set(expected)
    for name, result in found.items():
        same(result, expected[name])
    assert notes
    assert all("is gone; what it had under way is run again elsewhere" in note for note in notes)


@pytest.mark.slow
def test_a_deadly_chunk_is_a_failure_and_its_neighbours_are_not(
    problem: Problem, chunks: list[Chunk], expected: dict[str, Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_engine, "run_chunk", cluster_cases.deadly)
    with DaskEngine(workers=1, retries=1) as engine:  # one worker: all others die with it
        found = {chunk.name: result for chunk, result in engine.run(problem, chunks)}
    (dead,) = [name for name, result in found.items() if isinstance(result, Failure)]
    assert dead.startswith("selection-00001-")
    assert found.pop(dead).cause.startswith("KilledWorker: 2 workers died of it, the last tcp://127.0.0.1:")
    for name, result in found.items():
        same(result, expected[name])


def sweep(*options: str) -> list[str]:
    return [sys.executable, "-m", "qocjax.sweep", *OPTIONS, *options]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the study in this process, without Dask."""
    folder = tmp_path_factory.mktemp("undisturbed")
    subprocess.run(sweep(f"hydra.run.dir={folder}"), check=True, env=environment(), capture_output=True)
    return folder


def environment(**others: str) -> dict[str, str]:
    return os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}", "JAX_PLATFORMS": "cpu"} | others


def same_study(folder: Path, other: Path) -> None:
    """Tables and chunks of two studies are the same byte for byte."""
    names = [path.relative_to(other) for path in (*other.glob("*.csv"), *other.glob("chunks/*.npz"))]
    assert len(names) > 5
    for name in names:
        assert (folder / name).read_bytes() == (other / name).read_bytes(), name


@pytest.mark.slow
def test_the_command_gives_the_same_files(undisturbed: Path, tmp_path: Path) -> None:
    command = sweep(f"hydra.run.dir={tmp_path}", "engine=dask", "engine.workers=2")
    done = subprocess.run(command, check=True, env=environment(), capture_output=True, text=True)
    assert "distributed" not in done.stdout + done.stderr
    same_study(tmp_path, undisturbed)


@pytest.mark.slow
@pytest.mark.parametrize("way", [signal.SIGKILL, signal.SIGINT], ids=["kill", "interrupt"])
def test_a_driver_that_ends_is_resumed(way: signal.Signals, undisturbed: Path, tmp_path: Path) -> None:
    command = sweep(f"hydra.run.dir={tmp_path}", "engine=dask", "engine.workers=2")
    with subprocess.Popen(
        command, env=environment(), stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as driver:
        until(lambda: len(list(tmp_path.glob("chunks/selection-0*.npz"))) > 1)
        others = psutil.Process(driver.pid).children(recursive=True)
        os.killpg(driver.pid, way) if way == signal.SIGINT else driver.kill()
        _, errors = driver.communicate(timeout=60)
    if way == signal.SIGINT:
        assert (driver.returncode, errors) == (130, f"stopped: resume={tmp_path} goes on\n")
    gone, alive = psutil.wait_procs(others, timeout=30)
    assert others and not alive  # no worker outlives its driver
    subprocess.run([*command[:3], f"resume={tmp_path}"], check=True, env=environment(), capture_output=True)
    same_study(tmp_path, undisturbed)


@pytest.mark.slow
def test_every_device_of_a_worker_is_used_and_a_lost_scheduler_is_an_error(
    problem: Problem, chunks: list[Chunk], expected: dict[str, Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    flags = {"XLA_FLAGS": "--xla_force_host_platform_device_count=2"}
    address = "tcp://127.0.0.1:18786"
    with running(dask("scheduler", "--host", "127.0.0.1", "--port", "18786", "--no-dashboard")) as scheduler, running(
        dask("worker", address, "--host", "127.0.0.1", "--nthreads", "2", "--no-dashboard"), **flags
    ), DaskEngine(address) as engine:  # fmt: skip
        monkeypatch.setattr(dask_engine, "run_chunk", cluster_cases.on_devices)
        found = {chunk.name: result for chunk, result in engine.run(problem, chunks)}
        for name, result in found.items():
            same(result, expected[name])
        assert len(set().union(*(result.attributes["devices"] for result in found.values()))) == 2
        with pytest.raises(OSError, match="the connection to the scheduler is lost"):
            for _ in engine.run(problem, chunks):
                scheduler.kill()


@pytest.mark.slow
def test_two_network_namespaces_are_two_machines(tmp_path: Path, undisturbed: Path) -> None:
    with two_machines() as (one, other):
        address = "tcp://10.213.7.1:8786"
        with running([*one, *dask("scheduler", "--host", "10.213.7.1", "--port", "8786", "--no-dashboard")]), running(
            [*one, *dask("worker", address, "--host", "10.213.7.1", "--nthreads", "1", "--no-dashboard")]
        ), running(
            [*other, *dask("worker", address, "--host", "10.213.7.2", "--nthreads", "1", "--no-dashboard")]
        ):  # fmt: skip
            options = ["engine=dask", f"engine.address={address}", f"hydra.run.dir={tmp_path}"]
            subprocess.run([*one, *sweep(*options)], check=True, env=environment(), capture_output=True, timeout=120)
            who = "import sys; from distributed import Client; c = Client(sys.argv[1]); " \
                  "print(c.run(lambda: 'qocjax.cluster.worker' in __import__('sys').modules))"  # fmt: skip
            done = subprocess.run(
                [*one, sys.executable, "-c", who, address],
                check=True,
                env=environment(),
                capture_output=True,
                text=True,
            )
    same_study(tmp_path, undisturbed)
    assert "tcp://10.213.7.1" in done.stdout and "tcp://10.213.7.2" in done.stdout
    assert done.stdout.count("True") == 2  # both have computed chunks


def dask(kind: str, *options: str) -> list[str]:
    return [sys.executable, "-m", f"distributed.cli.dask_{kind}", *options]


@contextmanager
def running(command: Sequence[str], **others: str) -> Iterator[subprocess.Popen]:
    """A process that ends with the block, and those that it started."""
    process = subprocess.Popen(command, env=environment(**others), stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        if process.poll() is None:
            for each in [*psutil.Process(process.pid).children(recursive=True), process]:
                each.kill()
        process.wait()


def until(condition: Callable[[], bool]) -> None:
    begin = time.monotonic()
    while not condition():
        assert time.monotonic() < begin + 60
        time.sleep(0.05)


@contextmanager
def two_machines() -> Iterator[tuple[list[str], list[str]]]:
    """What puts a command into one or the other of two network namespaces, joined by a cable."""
    if shutil.which("ip") is None or os.geteuid() != 0:
        pytest.skip("needs root and the command ip (iproute2) for network namespaces")
    names = [f"qocjax-{os.getpid()}-{k}" for k in (1, 2)]
    try:
        for name in names:
            if ip("netns", "add", name).returncode != 0:
                pytest.skip("this system allows no network namespace")
        if ip("link", "add", "v1", "netns", names[0], "type", "veth", "peer", "v2", "netns", names[1]).returncode != 0:
            pytest.skip("this system has no virtual cable (veth)")
        for k, name in enumerate(names, 1):
            assert ip("-n", name, "address", "add", f"10.213.7.{k}/24", "dev", f"v{k}").returncode == 0
            for device in (f"v{k}", "lo"):
                assert ip("-n", name, "link", "set", device, "up").returncode == 0
        yield ["ip", "netns", "exec", names[0]], ["ip", "netns", "exec", names[1]]
    finally:
        for name in names:
            ip("netns", "delete", name)


def ip(*arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run(["ip", *arguments], capture_output=True)
