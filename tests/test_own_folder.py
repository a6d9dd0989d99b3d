"""Runs of commands and their folders: each its own, held while it runs, without what an earlier one left."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from qocjax.commands import own_folder as module
from qocjax.commands.claimed import claimed
from qocjax.commands.own_folder import own_folder
from qocjax.store import write_config


def test_runs_of_one_second_have_folders_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usual = str(tmp_path / "tune" / "2026-01-01_00-00-00")
    found: list[str] = []

    def run() -> None:  # as in a process of its own
        found.append(next(name for k in range(1, 99) if module._is_new(name := usual if k == 1 else f"{usual}_{k}")))

    threads = [threading.Thread(target=run) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found) == sorted({usual, *(f"{usual}_{k}" for k in range(2, 21))})
    monkeypatch.setattr(module, "_made", {})
    assert own_folder(None, usual) == f"{usual}_21" == own_folder(None, usual)  # once for a process
    assert own_folder("results/mine", usual) == "results/mine"


def test_a_folder_is_held_by_one_process(tmp_path: Path) -> None:
    other = "import sys, pathlib\nfrom qocjax.commands.claimed import claimed\n" \
            "with claimed(pathlib.Path(sys.argv[1]), 'tune'): pass\n"  # fmt: skip
    with claimed(tmp_path, "tune"), claimed(tmp_path, "tune"):  # whose own parts may hold it again
        done = subprocess.run([sys.executable, "-c", other, str(tmp_path)], capture_output=True, text=True)
        assert done.returncode != 0 and "in use by process" in done.stderr
    with claimed(tmp_path, "tune"):
        pass


@pytest.mark.parametrize(("there", "options"), [("sweep", {"sweep": {}}), ("tune", {"tune": {}, "sweep": {}})])
def test_results_of_another_command_are_left_alone(there: str, options: dict, tmp_path: Path) -> None:
    write_config(tmp_path, options)
    with pytest.raises(ValueError, match=f"with results of python -m qocjax.{there}, expected a folder of its own"):
        with claimed(tmp_path, "show"):
            pytest.fail("runs there")
    with claimed(tmp_path, there):
        pass


def test_what_a_killed_run_left_half_written_is_tidied(tmp_path: Path) -> None:
    (tmp_path / "figures").mkdir()
    left = [".policies-a1b2c3d4.csv", f"figures/.qoc_kappa.{'0123456789abcdef' * 2}.png"]
    kept = [".lock", ".hydra-notes.txt", "figures/qoc_kappa.png", ".mine.png"]
    for name in (*left, *kept):
        (tmp_path / name).write_text("")
    with claimed(tmp_path, "sweep"):
        assert not any((tmp_path / name).exists() for name in left)
    assert all((tmp_path / name).exists() for name in kept)


def test_a_folder_used_again_has_no_stale_tables(tmp_path: Path) -> None:
    mine = tmp_path / "mine.csv"
    mine.write_text("of the user")
    with claimed(tmp_path, "codesign"):
        for name in ("finals.csv", "workers.csv", "figures/front.png"):
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).write_text("1")
    with pytest.raises(ZeroDivisionError), claimed(tmp_path, "codesign"):
        1 / 0  # noqa: B018
    assert (tmp_path / "workers.csv").exists()  # nothing computed is lost
    for name in ("finals.csv", "workers.csv", "figures/front.png"):
        (tmp_path / name).touch()

    for path in tmp_path.rglob("*.*"):
        os.utime(path, (1e9, 1e9))  # on any disk, whatever its clock tells apart
    with claimed(tmp_path, "codesign"):
        (tmp_path / "finals.csv").write_text("2")
    assert (tmp_path / "finals.csv").read_text() == "2" and mine.read_text() == "of the user"
    assert not (tmp_path / "workers.csv").exists() and not (tmp_path / "figures/front.png").exists()


@pytest.mark.parametrize("command", ["sweep", "fleet", "tune"])
def test_what_work_goes_on_with_stays_and_what_another_run_no_longer_writes_goes(command: str, tmp_path: Path) -> None:
    kept = ["study.json", "chunks/0.npz", "parts/robots-1/study.json", "parts/robots-1/chunks/0.npz"]
    stale = ["steps.csv", "map_prbs.csv", "figures/maps.png", "figures/steps.png", "report.html"]
    with claimed(tmp_path, command):
        for name in (*kept, *stale, "results.csv"):
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text("1")
    for path in tmp_path.rglob("*.*"):
        os.utime(path, (1e9, 1e9))
    with claimed(tmp_path, command):
        (tmp_path / "results.csv").write_text("2")
    assert all((tmp_path / name).exists() for name in (*kept, "results.csv"))
    assert not any((tmp_path / name).exists() for name in stale)
