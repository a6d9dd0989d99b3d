"""A study survives: chunks that stay, resume bit for bit, damage that is found, folders that are not spoilt."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hydra import compose, initialize_config_dir

import qocjax.study.table as table_module
from qocjax import (
    Design,
    QocScale,
    Rules,
    Scenario,
    Study,
    evaluate,
    one_at_a_time,
    open_study,
    paper_network,
)
from qocjax.commands import sweep as command
from qocjax.commands import sweep_page
from qocjax.config import StudyConfig, build_problem, conf_dir, load
from qocjax.statistics.order import scale_of
from qocjax.statistics.scales import scale_of_runs
from qocjax.store.checked import read_array, read_checked, write_checked
from qocjax.store.files import written
from qocjax.store.identity import content_digest, differences
from qocjax.store.lock import locked
from qocjax.store.memory import InMemory
from qocjax.store.owner import owner_of
from qocjax.store.provenance import change_of
from qocjax.store.study_folder import ChunkFolder, study_folder
from qocjax.study.chunks import Chunk, Failure, Part, Result, compute, plan
from qocjax.study.engine import LocalEngine
from qocjax.study.problem import Problem
from qocjax.study.sweep import study_of

SCENARIO = Scenario(start=[[-0.6, -0.5, 0.3], [-0.6, 0.5, 0.0]], goal=[1.0, 0.0], horizon=2.0)
GRID = one_at_a_time(Design(tau=0.1), {"kappa": [0.5, 2.0, 4.0], "tau": [0.1, 0.2]}, [0.1, 0.2, 0.3])
PROBLEM = Problem(SCENARIO, GRID.designs, paper_network(), Rules(), 3)
SEEDS, FRESH = range(70), range(100, 104)
STEPS = 4000  # robot-steps of a chunk: about ten chunks

SMALL = [
    "sweep=kappa", "sweep.grids.kappa=[1,2]", "sweep.deadline_ms=[150,400,800]", "sweep.seeds=3",
    "sweep.evaluation_seeds=2", "scenario.horizon=2", "loop.tau=0.05", "chunk_steps=400", "figures=false",
    "report=false",
]  # fmt: skip


class Counting:
    """The local engine; says what it computed, and is stopped after some chunks."""

    def __init__(self, stop_after: int | None = None, order: Callable[[list], list] = list) -> None:
        self.computed: list[str] = []
        self.stop_after, self.order = stop_after, order

    def run(self, problem: Problem, chunks: Sequence[Chunk]) -> Generator[tuple[Chunk, Result | Failure], None, None]:
        for chunk, result in LocalEngine().run(problem, self.order(list(chunks))):
            if len(self.computed) == self.stop_after:
                raise KeyboardInterrupt
            self.computed.append(chunk.name)
            yield chunk, result


def study(shelf: Any = None, engine: Any = None, **changed: Any) -> Study:
    arguments = {"chunk_steps": STEPS} | changed
    return study_of(PROBLEM, GRID, SEEDS, FRESH, shelf=shelf, engine=engine, **arguments)


@pytest.fixture(scope="module")
def undisturbed() -> Study:
    return study()


def same(a: Study, b: Study) -> None:
    """Bit for bit."""
    pd.testing.assert_frame_equal(a.results, b.results, check_exact=True)
    pd.testing.assert_frame_equal(a.policies, b.policies, check_exact=True)
    assert [getattr(a.scale, name) == getattr(b.scale, name) for name in ("median", "largest", "median_se")] == [
        True
    ] * 3
    for one, other in ((a.runs, b.runs), (a.evaluation, b.evaluation)):
        xr.testing.assert_identical(one.drop_attrs(deep=False).load(), other.drop_attrs(deep=False).load())


def config(*options: str) -> StudyConfig:
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return load(StudyConfig, compose("sweep", [*SMALL, *options]))


# Chunks


@pytest.mark.parametrize("steps", [1, 300, 4000, 1e5, 1e9])
@pytest.mark.parametrize("seeds", [range(2), range(31), range(33), range(64), (5, 1, 9), range(100, 290)])
def test_a_plan_holds_every_run_once_and_has_stable_names(steps: float, seeds: Sequence[int]) -> None:
    part = Part("selection", seeds)
    chunks = plan(PROBLEM, part, steps)
    count = np.zeros((len(GRID.designs.tau), len(seeds)), int)
    for chunk in chunks:
        count[np.ix_(chunk.designs, range(*chunk.seeds))] += 1
        assert chunk.seeds[0] % 32 == 0 and (chunk.seeds[1] == len(seeds) or chunk.seeds[1] % 32 == 0)
        assert list(chunk.designs) == sorted(chunk.designs)
    assert (count == 1).all()
    assert len({chunk.name for chunk in chunks}) == len(chunks)
    assert chunks == plan(PROBLEM, part, steps)
    others = plan(PROBLEM, Part("selection", [*seeds[1:], 4000]), steps)
    assert not {chunk.name for chunk in chunks} & {chunk.name for chunk in others}
    most = max(steps, 32 * 20 * 2 * 2 * 2)
    assert sum(chunk.steps for chunk in chunks) == sum(np.ceil(2 / GRID.designs.tau)) * 2 * len(seeds)
    if len(seeds) > 64:
        assert max(chunk.steps for chunk in chunks) <= 2 * most


def test_chunks_are_the_evaluation_in_one_piece_bit_for_bit() -> None:
    whole = evaluate(SCENARIO, GRID.designs, paper_network(), SEEDS, key=3)
    chunks = plan(PROBLEM, Part("selection", SEEDS), STEPS)
    assert len(chunks) > 5
    for chunk in reversed(chunks):
        result = compute(PROBLEM, chunk)
        assert result.attributes == whole.attrs
        for name, values in result.values.items():
            np.testing.assert_array_equal(values, whole[name].values[list(chunk.designs)][:, slice(*chunk.seeds)])


def test_parts_of_an_evaluation_that_are_none_are_refused() -> None:
    for only in (([], [0]), ([0], [70]), ([1, 0], [0]), ([0, 0], [0]), ([[0]], [0]), ([-1], [0])):
        with pytest.raises(ValueError, match="only: got .* expected ascending places below"):
            evaluate(SCENARIO, GRID.designs, paper_network(), SEEDS, only=only)


def test_what_is_kept_in_memory_is_what_was_computed(undisturbed: Study) -> None:
    whole = evaluate(SCENARIO, GRID.designs, paper_network(), SEEDS, key=3)
    xr.testing.assert_identical(undisturbed.runs, whole)
    assert undisturbed.scale == scale_of_runs(whole["auc"].values, SCENARIO)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("number", [1, 2, 3, 10, 1001, 20000])
def test_the_median_in_passes_is_the_median(dtype: type, number: int) -> None:
    rng = np.random.default_rng(number)
    for values in (
        rng.lognormal(size=number), np.round(rng.lognormal(size=number), 1) + 0.1, np.ones(number),
        np.abs(rng.normal(size=number)) * 10.0 ** rng.integers(-9, 9, number), np.append(rng.random(number) + 2, -1e-3),
    ):  # fmt: skip
        array = values.astype(dtype)
        array[rng.random(array.size) < 0.1] = np.nan
        array[0] = 1.0
        parts = np.array_split(np.append(array, [np.inf]).astype(dtype), 5)
        assert scale_of(lambda parts=parts: parts) == QocScale.of(array)  # type: ignore[misc]
    with pytest.raises(ValueError, match="auc: got no finite value"):
        scale_of(lambda: [np.full(3, np.nan, dtype)])


def test_the_table_does_not_depend_on_its_blocks(undisturbed: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    for block in (1, 300, 1000):
        monkeypatch.setattr(table_module, "_BLOCK", block)
        again = table_module.results_table(
            undisturbed.runs, GRID, paper_network().reliability(GRID.designs.deadline), undisturbed.scale
        )
        pd.testing.assert_frame_equal(again, undisturbed.results, check_exact=True)


# Stopped and gone on with


@pytest.mark.parametrize("stop_after", [0, 1, 4])
def test_a_stopped_study_goes_on_bit_for_bit(stop_after: int, undisturbed: Study, tmp_path: Path) -> None:
    first, second, third = Counting(stop_after), Counting(order=lambda chunks: chunks[::-1]), Counting()
    with pytest.raises(KeyboardInterrupt), study_folder(tmp_path, {}, "") as shelf:
        study(shelf, first)
    with study_folder(tmp_path, {}, "") as shelf:
        same(study(shelf, second), undisturbed)
    assert len(first.computed) == stop_after and not set(first.computed) & set(second.computed)
    with study_folder(tmp_path, {}, "") as shelf:
        same(study(shelf, third), undisturbed)
    assert third.computed == []


def test_files_of_a_resumed_study_are_those_of_an_undisturbed_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, parts, settings = tmp_path / "whole", tmp_path / "parts", config()
    command.run(settings, whole, quiet=True)
    put, left = ChunkFolder.put, [4]

    def dies(self: ChunkFolder, *arguments: Any) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt
        put(self, *arguments)

    for _ in range(20):
        monkeypatch.setattr(ChunkFolder, "put", dies)
        left[0] = 4
        try:
            command.run(settings, parts, quiet=True)
            break
        except KeyboardInterrupt:
            assert not (parts / "record.json").exists()
    else:
        pytest.fail("never finished")
    names = sorted(path.relative_to(whole) for path in whole.rglob("*") if path.is_file())
    assert names == sorted(path.relative_to(parts) for path in parts.rglob("*") if path.is_file())
    for name in names:
        if name.name not in ("record.json", ".lock"):
            assert (whole / name).read_bytes() == (parts / name).read_bytes(), name


def test_another_configuration_is_refused_and_named(tmp_path: Path) -> None:
    command.run(config(), tmp_path, quiet=True)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file() and path.name != ".lock"}
    with pytest.raises(ValueError) as caught:
        command.run(config("sweep.seeds=4", "controller.eta=0.5"), tmp_path, quiet=True)
    text = str(caught.value)
    assert "controller.eta: 0.6 there, 0.5 here; sweep.seeds: 3 there, 4 here" in text and "\n" not in text
    assert before == {path: path.read_bytes() for path in before}
    command.run(config(f"resume={tmp_path}"), tmp_path, quiet=True)  # what changes no result may change


def test_a_folder_without_results_takes_another_configuration(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), study_folder(tmp_path, {"key": 1}, ""):
        raise KeyboardInterrupt
    with study_folder(tmp_path, {"key": 2}, ""):
        pass
    assert json.loads((tmp_path / "study.json").read_text())["configuration"] == {"key": 2}


def test_other_measured_data_is_refused(tmp_path: Path) -> None:
    network = replace(paper_network(), name="x")
    assert content_digest(paper_network()) == content_digest(paper_network()) != content_digest(network)
    assert content_digest(np.arange(3)) != content_digest(np.arange(3.0)) != content_digest([0.0, 1.0, 2.0])
    with study_folder(tmp_path, {}, "a") as shelf:
        shelf.put("selection-0", {}, {}, {})
    with pytest.raises(ValueError, match="a study of other data"), study_folder(tmp_path, {}, "b"):
        pass


def test_differences_name_what_is_on_one_side_only() -> None:
    assert differences({"a": {"b": 1, "c": 2}}, {"a": {"b": 1, "d": [1]}}) == (
        "a.c: 2 there, nothing here; a.d: nothing there, [1] here"
    )
    assert differences({"a": [1, 2.0], "b": {}}, {"a": [1, 2.0], "b": {}}) == ""
    assert differences({str(k): 0 for k in range(9)}, {}).endswith("and 3 more")


def test_a_worker_builds_the_problem_from_the_plain_configuration() -> None:
    problem = config().build_problem()
    again = build_problem(json.loads(json.dumps(problem.configuration)))
    part = Part("selection", range(3))
    assert plan(problem, part, 400) == plan(again, part, 400)
    (first, *_) = plan(problem, part, 400)
    one, other = compute(problem, first), compute(again, first)
    for name in one.values:
        np.testing.assert_array_equal(one.values[name], other.values[name])


def test_a_change_of_what_it_was_made_with_is_reported() -> None:
    here = {"jax": "0.10.2", "machine": "a"}
    assert change_of([here, here]) == []
    (line,) = change_of([here, here | {"jax": "0.12.0"}])
    assert "different jax (0.10.2 and 0.12.0)" in line


# Damage


@pytest.fixture
def chunk(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    arrays = {"auc": rng.random((3, 4, 2), np.float32), "collided": rng.random((3, 4)) < 0.5}
    return write_checked(tmp_path / "selection-1.npz", arrays, {"chunk": {"name": "selection-1"}, "of": [3, 4]})


def test_any_damage_of_a_chunk_is_found(chunk: Path) -> None:
    whole, (arrays, header) = chunk.read_bytes(), read_checked(chunk)
    rng = np.random.default_rng(1)
    harmless = 0
    for trial in range(400):
        damaged = bytearray(whole)
        if trial % 4 == 0:
            damaged = damaged[: rng.integers(len(whole))]
        else:
            damaged[rng.integers(len(whole))] ^= 1 << int(rng.integers(8))
        chunk.write_bytes(damaged)
        notes: list[str] = []
        shelf = ChunkFolder(chunk.parent, notes.append)
        if shelf.holds("selection-1", {"name": "selection-1"}):  # a bit of the archive that nothing is read from
            found, again = read_checked(chunk)
            assert again == header and all((found[name] == arrays[name]).all() for name in arrays)
            harmless += 1
        else:
            assert len(notes) == 1 and "selection-1.npz: " in notes[0] and "computed again" in notes[0]
            assert not chunk.exists()
    assert harmless < 100


def test_the_same_content_makes_the_same_file(chunk: Path, tmp_path: Path) -> None:
    arrays, header = read_checked(chunk)
    before = chunk.read_bytes()
    time.sleep(0.01)
    assert write_checked(tmp_path / "b.npz", arrays, header).read_bytes() == before
    np.testing.assert_array_equal(np.load(chunk, allow_pickle=False)["auc"], arrays["auc"])  # a plain .npz


def test_a_damaged_chunk_is_computed_again(undisturbed: Study, tmp_path: Path) -> None:
    with study_folder(tmp_path, {}, "") as shelf:
        study(shelf)
    hurt = sorted((tmp_path / "chunks").glob("selection-*.npz"))[2]
    hurt.write_bytes(hurt.read_bytes()[:-200])
    notes: list[str] = []
    engine = Counting()
    with study_folder(tmp_path, {}, "", notes.append) as shelf:
        same(study(shelf, engine), undisturbed)
    assert engine.computed == [hurt.stem] and len(notes) == 1 and str(hurt) in notes[0]


def test_half_written_files_of_a_killed_process_are_removed(tmp_path: Path) -> None:
    (tmp_path / "chunks").mkdir()
    left = tmp_path / "chunks" / ".selection-00001-x7f.npz"
    left.write_bytes(b"half")
    with study_folder(tmp_path, {}, ""):
        assert not left.exists()


def test_chunks_of_others_are_computed_again(undisturbed: Study, tmp_path: Path) -> None:
    """Another configuration, other data, code, width or generator: seen chunk by chunk, whatever study.json says."""
    with study_folder(tmp_path, {"eta": 1}, "a") as shelf:
        study(shelf)
        names, own = sorted(path.stem for path in shelf.folder.glob("*-*.npz")), dict(shelf.owner)
    for strange in own:
        notes: list[str] = []
        engine = Counting()
        shelf = ChunkFolder(tmp_path / "chunks", notes.append, own | {strange: "another"})
        same(study(shelf, engine), undisturbed)
        assert sorted(engine.computed) == names and all(f"computed with other {strange};" in note for note in notes)
        engine = Counting()
        same(study(ChunkFolder(tmp_path / "chunks", notes.append, own | {strange: "another"}), engine), undisturbed)
        assert engine.computed == []
        own = own | {strange: "another"}


def test_the_owner_of_a_chunk_is_what_draws_and_code_follow_from(monkeypatch: pytest.MonkeyPatch) -> None:
    own = owner_of({"eta": 1}, "a")
    assert owner_of({"eta": 1}, "a") == own
    changed = {"configuration": owner_of({"eta": 2}, "a"), "data": owner_of({"eta": 1}, "b")}
    with jax.enable_x64(False):
        changed["float width"] = owner_of({"eta": 1}, "a")
    with jax.threefry_partitionable(not jax.config.jax_threefry_partitionable):
        changed["random numbers"] = owner_of({"eta": 1}, "a")
    monkeypatch.setattr("qocjax.store.owner.source_digest", lambda: "another")
    changed["code"] = owner_of({"eta": 1}, "a")
    assert sorted(changed) == sorted(own)
    for name, other in changed.items():
        assert [each for each in own if own[each] != other[each]] == [name]


# Folders and disks


def test_two_processes_in_one_folder(tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from qocjax.store.lock import locked\n"
        "with locked(Path(sys.argv[1])): print('held', flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None and other.stdout.readline() == "held\n"
        with pytest.raises(ValueError, match=f"in use by process {other.pid} on "), locked(tmp_path):
            pass
        other.kill()  # -9
        other.wait()
        with locked(tmp_path), locked(tmp_path), ThreadPoolExecutor(1) as beside:  # a part of it, and another one
            with pytest.raises(ValueError, match=f"in use by process {os.getpid()} on "):
                beside.submit(lambda: locked(tmp_path).__enter__()).result()


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EDQUOT])
def test_a_disk_that_refuses_ends_in_one_line_and_spoils_nothing(
    number: int, undisturbed: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patch, pytest.raises(OSError) as caught:
        with study_folder(tmp_path, {}, "") as shelf:
            put = shelf.put

            def later(*arguments: Any) -> None:
                if len(list((tmp_path / "chunks").glob("*.npz"))) == 4:
                    patch.setattr(os, "fsync", full)
                put(*arguments)

            patch.setattr(shelf, "put", later)
            study(shelf)
    text = str(caught.value)
    assert text.startswith(f"{tmp_path}: cannot be written ({os.strerror(number)})") and "\n" not in text
    assert len(list((tmp_path / "chunks").glob("*.npz"))) == 4 and not list((tmp_path / "chunks").glob(".*"))
    engine = Counting()
    with study_folder(tmp_path, {}, "") as shelf:
        same(study(shelf, engine), undisturbed)
    assert len(engine.computed) == len(undisturbed.chunks) - 3  # one of the four files holds the coordinates


def test_what_stood_there_stays_when_writing_fails(tmp_path: Path) -> None:
    path = written(tmp_path / "a.txt", lambda file: file.write_text("old"))

    def fails(file: Path) -> None:
        file.write_text("ne")
        raise OSError(errno.ENOSPC, "full")

    with pytest.raises(OSError):
        written(path, fails)
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_a_clock_that_jumps_changes_nothing(
    undisturbed: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(KeyboardInterrupt), study_folder(tmp_path, {}, "") as shelf:
        study(shelf, Counting(3))
    for k, path in enumerate(sorted(tmp_path.rglob("*"))):
        os.utime(path, (k % 2 * 4e9, k % 2 * 4e9))  # 1970 and 2096
    now = iter(range(10**9, 0, -3600))
    monkeypatch.setattr(time, "time", lambda: float(next(now)))
    engine = Counting()
    with study_folder(tmp_path, {}, "") as shelf:
        same(study(shelf, engine), undisturbed)
    assert len(engine.computed) == len(undisturbed.chunks) - 3


# Designs and chunks that go wrong


def test_a_diverging_design_is_flagged_and_not_chosen() -> None:
    away = replace(SCENARIO, start=[[-0.6, -0.5, 3.0], [-0.6, 0.5, 3.0]])
    grid = one_at_a_time(Design(tau=0.1), {"kappa": [2.0, 3e38]}, [0.2, 0.3])
    problem = replace(PROBLEM, scenario=away, designs=grid.designs)
    found = study_of(problem, grid, range(3), range(3, 6))
    bad = found.results["value"] == 3e38
    assert (found.results.loc[bad, "diverged_share"] > 0).all() and found.results.loc[bad, "auc"].isna().all()
    assert (found.results.loc[~bad, "diverged_share"] == 0).all() and set(found.policies["value"]) == {2.0}
    assert np.isfinite(found.scale.median) and not found.policies.isna().any(axis=None)
    text = sweep_page.diverged_text(found.results)
    assert "not chosen" in text and "kappa = 3e+38: 2 deadlines, in up to 100.0% of the runs" in text
    assert sweep_page.diverged_text(found.results[~bad]) == ""
    alone = one_at_a_time(Design(tau=0.1), {"kappa": [2.0], "eta": [0.1]}, [0.2])
    hopeless = replace(alone.designs, kappa=np.where(np.asarray(alone.designs.eta) == 0.1, 3e38, 2.0))
    found = study_of(replace(problem, designs=hopeless), replace(alone, designs=hopeless), range(3), range(3, 6))
    rows = found.policies.set_index("sweep")
    assert set(rows.loc["eta", "error"]) == {"every design diverged or failed"} and rows.loc["eta", "qoc"].isna().all()
    assert set(rows.loc["kappa", "error"]) == {""} and rows.loc["kappa", "qoc"].notna().all()
    assert "every design diverged or failed" in sweep_page.policy_text(found.policies)


class Failing(Counting):
    """Two chunks of the selection fail."""

    def run(self, problem: Problem, chunks: Sequence[Chunk]) -> Generator[tuple[Chunk, Result | Failure], None, None]:
        for chunk, result in super().run(problem, chunks):
            fails = chunk.part.name == "selection" and chunk.designs[0] == 0
            yield chunk, Failure("workers died of it") if fails else result


def test_a_chunk_that_fails_is_an_error_row_and_the_rest_goes_on(undisturbed: Study, tmp_path: Path) -> None:
    with study_folder(tmp_path, {}, "") as shelf:
        found = study(shelf, Failing())
    assert set(found.failures.values()) == {"workers died of it"} and len(found.failures) >= 2
    lost = found.results["error"] != ""
    assert lost.any() and not lost.all()
    assert found.results.loc[lost, ["qoc", "auc", "diverged_share", "collision_share"]].isna().all(axis=None)
    pd.testing.assert_series_equal(
        found.results.loc[~lost, "auc"], undisturbed.results.loc[~lost, "auc"], check_exact=True
    )
    policies = found.policies.set_index(["sweep", "policy"])
    sure = policies[policies["error"] == ""]
    assert set(policies["error"]) <= {"", "every design diverged or failed"} and len(sure) >= 4
    rows = found.results[~lost].set_index(["sweep", "value", "deadline"])
    for choice in sure.reset_index().itertuples():
        assert rows.loc[(choice.sweep, choice.value, choice.deadline), "qoc"] == choice.qoc_selection
    with study_folder(tmp_path, {}, "") as shelf:
        same(study(shelf), undisturbed)  # tried again

    class Nothing:
        def run(self, problem: Problem, chunks: Sequence[Chunk]) -> Iterator[Any]:
            yield from ((chunk, Failure("no worker")) for chunk in chunks)

    with pytest.raises(ValueError, match="all .* chunks failed, the first with no worker"):
        study(InMemory(), Nothing())


# Opened


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Study]:
    folder = tmp_path_factory.mktemp("finished")
    arrays = pytest.importorskip("zarr") and "arrays=true"
    return folder, command.run(config(arrays), folder, quiet=True)


def test_a_study_is_opened_in_one_line(finished: tuple[Path, Study]) -> None:
    folder, found = finished
    opened = open_study(folder)
    same(opened, found)
    assert opened.configuration == found.configuration == config("arrays=true").model_dump()
    assert json.loads(opened.runs.attrs["configuration"]) == opened.configuration
    assert opened.runs["auc"].attrs["units"] == opened.results.attrs["units"]["auc"] == "s"
    assert opened.results.attrs["configuration"] == opened.configuration
    some = opened.runs["path_length"].isel(design=[3, 1], seed=slice(2, 0, -1))
    np.testing.assert_array_equal(some.values, found.runs["path_length"].values[[3, 1]][:, 2:0:-1])
    one = opened.runs["auc"].isel(design=4, robot=1)
    np.testing.assert_array_equal(one.values, found.runs["auc"].values[4, :, 1])
    swept = opened.sweep("kappa")
    assert swept["auc"].dims == ("kappa", "deadline", "seed", "robot")
    mean = opened.results.set_index(["value", "deadline"]).sort_index()["auc"]
    np.testing.assert_allclose(swept["auc"].mean(["robot", "seed"]).values.ravel(), mean, rtol=1e-6)
    with pytest.raises(ValueError, match="name: got 'eta', expected one of kappa"):
        opened.sweep("eta")
    with xr.open_zarr(folder / "arrays.zarr", group="kappa", consolidated=False) as arrays:
        xr.testing.assert_equal(arrays.load(), swept.load())
        assert arrays["auc"].attrs["units"] == "s" and json.loads(arrays.attrs["configuration"])


def flipped(content: bytes, entry: bytes) -> bytes:
    """A file with one bit of an entry's data turned over."""
    at = content.index(entry) + 160
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


def broken(source: Path, folder: Path, name: str, change: Callable[[bytes], bytes | None]) -> str:
    """What opening a copy says in which one file was changed, or removed."""
    subprocess.run(["cp", "-r", str(source), str(folder)], check=True)
    (path,) = folder.glob(name)
    content = change(path.read_bytes())
    path.unlink() if content is None else path.write_bytes(content)
    with pytest.raises(ValueError) as caught:
        _ = open_study(folder).runs["auc"].values
    text = str(caught.value)
    assert str(folder) in text and "\n" not in text
    return text


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("results.parquet", lambda content: content[: len(content) // 2], "results.parquet: damaged"),
        ("policies.parquet", lambda content: content[:-1], "policies.parquet: damaged"),
        ("results.parquet", lambda content: None, "results.parquet: missing"),
        ("chunks/selection-00000-*.npz", lambda content: content[: len(content) // 2], "damaged"),
        ("chunks/selection-00000-*.npz", lambda content: flipped(content, b"auc.npy"), "damaged"),
        ("chunks/selection-00000-*.npz", lambda content: None, "missing, expected a chunk"),
        ("chunks/selection.npz", lambda content: content[:100], "selection.npz: damaged"),
        ("record.json", lambda content: content[:100], "record.json: damaged"),
        ("record.json", lambda content: b"[]", "record.json: got no configuration"),
        ("record.json", lambda content: None, "expected the folder of a finished study"),
    ],
)  # fmt: skip
def test_damaged_files_are_named(
    name: str, change: Callable[[bytes], bytes | None], words: str, finished: tuple[Path, Study], tmp_path: Path
) -> None:
    if "parquet" in name:
        pytest.importorskip("pyarrow")
    assert words in broken(finished[0], tmp_path / "copy", name, change)


def test_a_folder_that_is_none(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "missing"):
        with pytest.raises(ValueError, match="got no record.json there"):
            open_study(folder)


def test_without_parquet_csv_is_read(finished: tuple[Path, Study], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    opened = open_study(finished[0])
    pd.testing.assert_frame_equal(opened.results, finished[1].results, rtol=1e-8, check_dtype=False)
    assert opened.sweep("kappa")["auc"].shape == (2, 3, 3, 2)


def test_arrays_need_zarr(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ValueError, match="arrays: got true without zarr"):
        command.run(config("arrays=true"), tmp_path / "new", quiet=True)
    assert not (tmp_path / "new").exists()


def test_arrays_are_checked_when_read(chunk: Path) -> None:
    whole = chunk.read_bytes()
    chunk.write_bytes(flipped(whole, b"auc.npy"))
    with pytest.raises(ValueError, match="damaged"):
        read_array(chunk, "auc")
    with pytest.raises(ValueError, match="damaged"):
        read_array(chunk, "speed")
    with pytest.raises(FileNotFoundError):
        read_array(chunk.parent / "none.npz", "auc")
