"""The benchmark suite runs, at its smallest size; what it times is not judged."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.bench.ablation import measure_variants
from experiments.bench.entries import ENTRIES, ROOT, Entry, Process, clean_environment
from experiments.bench.growth import Case, circle, measure_case, summary
from experiments.bench.report import draw_growth, draw_times, printed, write
from experiments.bench.run import Record, check, measure_all
from experiments.bench.study import SIZES, Part, make_study, work_of

QOCJAX = next(entry for entry in ENTRIES if entry.entry == "qocjax")

BENCH = ROOT / "experiments" / "bench"


def command(script: str, *arguments: str) -> str:
    """Output of one of the commands."""
    done = subprocess.run(
        [sys.executable, str(BENCH / script), *arguments],
        env=clean_environment(), check=True, text=True, capture_output=True, timeout=120,
    )  # fmt: skip
    return done.stdout


def chosen() -> tuple[Entry, ...]:
    """One entry of each module but Numba, which takes long to compile; tests of the baselines run that."""
    first = {entry.entry: entry for entry in reversed(ENTRIES) if entry.entry != "numba_loop"}
    return tuple((first | {"qocjax": QOCJAX}).values())


@pytest.mark.slow
def test_all_entries_on_the_same_work(tmp_path: Path) -> None:
    table, skipped = measure_all("smallest", chosen())
    modules = set(table["module"])
    assert {"qocjax", "vmap_scan", "numpy_loop"} <= modules
    assert len(modules) + len(skipped) == len(chosen())  # what cannot run here is said
    assert (table["ns_per_robot_step"] > 0).all() and (table["best_s"] <= table["median_s"]).all()
    plain = table[(table["module"] == "vmap_scan") & ~table["whole_loop"]]
    assert (plain["vmap_over"] == 1.0).all()
    assert len(printed(table).splitlines()) == len(table) + 2
    write(tmp_path, "results", table, {"skipped": skipped})
    assert len(pd.read_csv(tmp_path / "results.csv")) == len(table)
    assert len(json.loads((tmp_path / "results.json").read_text())["rows"]) == len(table)
    draw_times(table, tmp_path / "times")
    assert (tmp_path / "times.png").stat().st_size > 0


def test_missing_compiler_is_a_line_not_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    process = Process("C++", "entries", vars(ENTRIES[0]) | {"size": "smallest"})
    process.ask("evaluate on")
    assert "g++" in process.answer()["unavailable"]
    process.close()


@pytest.mark.parametrize("grid", ["on", "off"])
def test_baselines_get_what_evaluate_draws(grid: str) -> None:
    size = SIZES["smallest"]
    study = make_study(size, grid, Part())
    work = work_of(study)
    assert work.robot_steps == study.robot_steps
    assert work.mid_tick == (grid == "off")
    rows = np.reshape(work.kappa, (-1, size.seeds))
    np.testing.assert_allclose(rows[:, 0], np.asarray(study.designs.kappa), rtol=1e-6)
    part = work_of(make_study(size, grid, Part(every=2, designs=1)))
    np.testing.assert_array_equal(part.loop_times, work.loop_times)
    assert part.num_lanes == size.seeds and np.all(part.kappa == work.kappa[0])


def test_a_different_result_is_an_error() -> None:
    size = SIZES["smallest"]
    auc = np.arange(1.0, 1.0 + size.designs * len(size.deadlines_ms))
    whole = Record(QOCJAX, "evaluate", "on", answer={"auc": auc.tolist()})
    same, other = (Record(ENTRIES[0], "evaluate", "on", answer={"auc": (f * auc).tolist()}) for f in (1.005, 1.02))
    check([whole, same], size)
    with pytest.raises(RuntimeError, match="mean AUC"):
        check([whole, other], size)


@pytest.mark.slow
def test_growth(tmp_path: Path) -> None:
    table = pd.DataFrame([measure_case(Case(panel, 1, 2, 20), 1) for panel in ("designs", "memory")])
    assert table["best_s"].max() > 0 and table["peak_mib"].max() > table["results_mib"].max() > 0
    draw_growth(table, tmp_path / "growth")
    assert (tmp_path / "growth.png").stat().st_size > 0


def test_growth_in_words() -> None:
    rows = [{"panel": "designs", "designs": g, "best_s": 0.1 * g**1.5} for g in (4, 16)]
    rows += [{"panel": "robots", "robots": n, "ns_per_pair_tick": 1.0 + n / 8} for n in (8, 64)]
    rows += [{"panel": "memory", "peak_mib": 300.0 + r, "results_mib": r} for r in (1.0, 50.0)]
    said = summary(pd.DataFrame(rows))["what came out"].tolist()
    assert "power 1.50" in said[0] and "N = 64 costs 4.50" in said[1] and "300, 300 MiB" in said[2]


@pytest.mark.parametrize("robots", [2, 8, 64])
def test_robots_start_apart(robots: int) -> None:
    start = circle(robots)[:, :2]
    apart = np.linalg.norm(start[:, None] - start[None], axis=-1) + 9.0 * np.eye(robots)
    assert apart.min() > 0.99


@pytest.mark.slow
def test_accelerator_script_runs_on_the_cpu(tmp_path: Path) -> None:
    output = command("gpu.py", "--size", "smallest", "--out", str(tmp_path))
    assert "backend=cpu" in output
    table = pd.read_csv(tmp_path / "batch_size_cpu.csv")
    # For each robot pose 5, command 2, error 2, three totals and the last tick away, for both the closest approach, and
    # a row of two numbers of the buffer; all of it read and written, 4 bytes each.
    assert (table["bytes_per_robot_step"] == 2 * 4 * (5 + 2 + 2 + 3 + 1 + 0.5 + 2)).all()
    assert (tmp_path / "batch_size_cpu.png").exists()


@pytest.mark.slow
def test_variant_of_a_batch() -> None:
    base = {"designs": 1, "seeds": 2, "ticks": 20}
    table = measure_variants({"no sharing": {"layout": "nothing shared", "whole_loop": False, "level": None}}, base, 1)
    assert table["variant"].tolist() == ["no sharing"]
    assert (table["ns_per_robot_step"] > 0).all() and table["over_first"].tolist() == [1.0]
