"""Pieces of work that are kept: found again by what they follow from, whole, and of nobody else."""

from __future__ import annotations

import errno
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
import xarray as xr

import qocjax
from qocjax import Design, Rules, Scenario, paper_network
from qocjax._pieces import Arrays, kept, kept_by, kept_each
from qocjax.batch import gradient
from qocjax.batch.runner import Runner
from qocjax.controllers import Apf
from qocjax.statistics.recorded import RecordedLoops, network_keys
from qocjax.store import journal as module
from qocjax.store.journal import journal
from qocjax.store.study_folder import study_folder

SCENARIO = Scenario(horizon=2.0)
DESIGNS = Design(tau=0.1, kappa=[1.0, 2.0], deadline=0.15)


class InMemory:
    """Keeps pieces as long as it lives."""

    def __init__(self) -> None:
        self.there: dict[str, Arrays] = {}
        self.untold: list[str] = []

    def get(self, name: str) -> Arrays | None:
        return self.there.get(name)

    def put(self, name: str, arrays: Arrays) -> None:
        assert name not in self.there
        self.there[name] = arrays

    def unnamed(self, why: str) -> None:
        self.untold.append(why)


@pytest.fixture
def batches(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The batches that are simulated."""
    seen: list[Any] = []
    run = Runner.run

    def counted(self: Runner, batch: Any) -> Any:
        seen.append(batch)
        return run(self, batch)

    monkeypatch.setattr(Runner, "run", counted)
    return seen


def evaluated(**changed: Any) -> xr.Dataset:
    options = {"scenario": SCENARIO, "designs": DESIGNS, "network": paper_network(), "seeds": range(3)} | changed
    return qocjax.evaluate(**options)


@dataclass(frozen=True)
class Outside(Apf):
    """A law from outside the package, told by its name and values."""

    share: float = 1.0


def test_batches_are_found_again_to_the_bit(batches: list[Any]) -> None:
    plain, keeper, steps = evaluated(), InMemory(), []
    count = len(batches)
    with kept_by(keeper):
        first = evaluated(max_runs=2)
        some = len(keeper.there)
        gradients = gradient(SCENARIO, DESIGNS, paper_network(), range(3), ["kappa"])
        assert some > 2 and len(keeper.there) > some
        done = len(batches)
        again = evaluated(max_runs=2, progress=steps.append)
        xr.testing.assert_identical(again, first)
        xr.testing.assert_identical(gradient(SCENARIO, DESIGNS, paper_network(), range(3), ["kappa"]), gradients)
    assert len(batches) == done and sum(steps) == 2 * 2 * 3 * 20
    evaluated()
    assert len(batches) == done + count  # and nothing is kept any more
    np.testing.assert_allclose(first["auc"], plain["auc"], rtol=1e-5)


def test_what_differs_in_anything_is_another_piece() -> None:
    keeper = InMemory()
    robots = replace(SCENARIO, robot_radius=0.2)
    changes: list[dict[str, Any]] = [
        {}, {"seeds": range(1, 4)}, {"key": 1}, {"rules": Rules(hold="zero")}, {"scenario": robots}, {"max_runs": 3},
        {"network": replace(paper_network(), name="other")}, {"controller": Outside()}, {"controller": Outside(0.5)},
        {"designs": replace(DESIGNS, kappa=[1.0, 2.5])}, {"only": ([0], [0, 1, 2])},
        {"only": ([0, 1], [0, 1, 2]), "seeds": range(4)},
    ]  # fmt: skip
    with kept_by(keeper):
        for k, each in enumerate(changes):
            before = len(keeper.there)
            evaluated(**each)
            assert len(keeper.there) > before, changes[k]
    assert keeper.untold == []


def test_recorded_loops_are_told_by_their_keys_and_times() -> None:
    keeper, keys = InMemory(), network_keys(range(2), 0)
    times = np.full((2, 20, 2), 0.1)
    with kept_by(keeper):
        for factor in (1.0, 1.0, 2.0):
            evaluated(network=RecordedLoops(keys, factor * times, "a"), seeds=range(2))
    assert len(keeper.there) == 2 and keeper.untold == []  # two recordings


def test_recorded_loops_are_given_to_batches_as_they_are_drawn() -> None:
    times = np.arange(3 * 4 * 2, dtype=float).reshape(3, 4, 2)
    recorded = RecordedLoops(network_keys([7, 5, 6], 1), times, "a")
    drawn = [recorded.draw(key, 4, 2, 0.1) for key in network_keys([5, 6, 7], 1)]
    np.testing.assert_array_equal(recorded.given([5, 6, 7], 1, 4, 2), drawn)
    np.testing.assert_array_equal(drawn, times[[1, 2, 0]])
    with pytest.raises(ValueError, match=r"recorded loops: got \(4, 2\), expected \(5, 2\)"):
        recorded.given([5], 1, 5, 2)


def test_what_no_content_names_is_computed_and_told() -> None:
    keeper, made = InMemory(), []

    def make() -> Arrays:
        made.append(1)
        evaluated()  # what a piece is made of is not kept beside it
        return {"a": np.arange(3)}

    with kept_by(keeper):
        for values in ((object(),), (object(),), ("named", jax.random.key(1)), ("named", jax.random.key(1))):
            assert kept(values, make)["a"].tolist() == [0, 1, 2]
    assert len(made) == 3 and len(keeper.there) == 1 and keeper.untold == ["<class 'object'>"] * 2


def shelf(folder: Path, notes: list[str] | None = None, **identity: Any) -> Any:
    return study_folder(folder, {"key": 1} | identity, "", (notes if notes is not None else []).append)


def put(folder: Path, *names: str, **identity: Any) -> list[str]:
    """Keeps some pieces in a folder, if they are not there; what is told."""
    notes: list[str] = []
    with shelf(folder, notes, **identity) as chunks, journal(chunks, notes.append) as found:
        for name in names:
            if found.get(name) is None:
                found.put(name, {"a": np.full(3, len(name)), "b.c": np.array(np.inf)})
            assert found.get(name)["a"].tolist() == [len(name)] * 3 and np.isinf(found.get(name)["b.c"])
    return notes


def test_pieces_lie_in_files_several_in_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert put(tmp_path, "a", "bb", "ccc") == put(tmp_path, "bb", "dddd") == put(tmp_path, "a", "dddd") == []
    names = [path.name for path in sorted((tmp_path / "chunks").iterdir())]
    assert names == ["pieces-000000.npz", "pieces-000001.npz"]
    (tmp_path / "chunks" / names[0]).unlink()
    put(tmp_path, "e")
    monkeypatch.setattr(module, "_OFTEN", 0.0)
    put(tmp_path, "f", "g")
    assert len(list((tmp_path / "chunks").iterdir())) == 4


def test_what_is_stopped_between_two_writes_is_written(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt, match=f"resume={tmp_path} goes on"):
        with shelf(tmp_path) as chunks, journal(chunks) as found:
            found.put("a", {"a": np.ones(1)})
            raise KeyboardInterrupt
    with shelf(tmp_path) as chunks, journal(chunks) as found:
        assert found.get("a")["a"].tolist() == [1.0]


def test_damaged_files_and_those_of_others_are_told_once_and_computed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_OFTEN", 0.0)
    put(tmp_path, "a", "bb", "ccc")
    file = tmp_path / "chunks" / "pieces-000001.npz"
    file.write_bytes(file.read_bytes()[:-30])
    (note,) = put(tmp_path, "a")
    assert note.startswith(f"{file}: damaged") and note.endswith("it is computed again") and not file.exists()
    monkeypatch.setattr("qocjax.store.owner.source_digest", lambda: "other code")
    (note,) = put(tmp_path, "a", "bb")
    assert "pieces-000000.npz: computed with other code; it is computed again, and so is 1 more file" in note
    with pytest.raises(ValueError, match="holds another study .key: 1 there, 2 here."), shelf(tmp_path, key=2):
        pass


def test_a_full_disk_ends_in_one_line_and_spoils_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(tmp_path, "a")

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch, pytest.raises(OSError, match=f"resume={tmp_path} goes on"):
        patch.setattr("qocjax.store.study_folder.write_checked", full)
        put(tmp_path, "a", "bb")
    assert put(tmp_path, "a", "bb") == []


def test_other_versions_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(tmp_path, "a")
    monkeypatch.setattr(module, "made_with", lambda: {"jax": "0.0.1"})
    assert any("computed with different jax (0.0.1 and " in note for note in put(tmp_path, "a"))


def test_pieces_come_in_any_order_and_are_computed_once() -> None:
    keeper, computed = InMemory(), []

    def compute(some: Iterable[int]) -> Iterator[tuple[int, Arrays]]:
        for each in sorted(some, reverse=True):
            computed.append(each)
            yield each, {"a": np.array(each)}

    with kept_by(keeper):
        for piece, _ in kept_each(("x",), [10, 20, 30], compute):
            if piece == 20:
                break
        found = {piece: int(arrays["a"]) for piece, arrays in kept_each(("x",), [10, 20, 30], compute)}
    assert computed == [30, 20, 10] and found == {10: 10, 20: 20, 30: 30}
