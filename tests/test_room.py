"""Sizes that no machine has are refused before anything of that size is made: what would be needed, and the limit."""

from __future__ import annotations

import platform
import subprocess
import sys
import tracemalloc
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

import qocjax.batch.runner as runner
from qocjax import Design, Rules, Scenario, _checks, _room, evaluate, one_at_a_time, paper_network, replay, run_study
from qocjax._conf import add_resolver, conf_dir, hydra_base
from qocjax.config.part import Part, load
from qocjax.fleets.layout import Layout
from qocjax.network.records import read_records
from qocjax.scenario import num_ticks
from qocjax.study.chunks import Part as StudyPart
from qocjax.study.chunks import plan
from qocjax.study.grid import full_grid
from qocjax.study.problem import Problem

NETWORK, GIGABYTE = paper_network(), 10**9


@pytest.fixture(autouse=True)
def _little(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine of a gigabyte, on which nothing is compiled."""
    monkeypatch.setattr(_room, "memory", lambda: GIGABYTE)
    monkeypatch.setattr(runner, "compiled", lambda *_: pytest.fail("got as far as compiling"))


@pytest.fixture
def _spared() -> Iterator[None]:
    """No refusal takes a tenth of the memory."""
    tracemalloc.start()
    yield
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < GIGABYTE / 10, peak


def study(horizon: float, tau: float, seeds: int) -> None:
    grid = one_at_a_time(Design(tau=tau), {"eta": [0.5, 1.0]}, [0.3])
    run_study(Scenario(horizon=horizon), grid, NETWORK, range(seeds), range(seeds, 2 * seeds))


def chunks(seeds: int, chunk_steps: float) -> None:
    designs = one_at_a_time(Design(), {"eta": [0.5, 1.0]}, [0.3]).designs
    plan(Problem(Scenario(), designs, NETWORK, Rules(), 0), StudyPart("selection", range(seeds)), chunk_steps)


SIZES: list[tuple[str, Callable[[], Any]]] = [
    ("horizon, tau", lambda: evaluate(Scenario(horizon=1e30), Design(), NETWORK, [0])),
    ("horizon, tau", lambda: evaluate(Scenario(), Design(tau=1e-9), NETWORK, [0])),
    ("horizon, tau", lambda: evaluate(Scenario(horizon=1e5), Design(), NETWORK, range(32))),
    ("tau", lambda: num_ticks(1e-30, 0.1)),
    ("horizon, tau", lambda: replay(Scenario(), Design(tau=1e-9), NETWORK, 0)),
    ("horizon, tau", lambda: replay(Scenario(horizon=3e6), Design(tau=0.05), NETWORK, 0)),
    ("horizon, tau", lambda: study(1e8, 1.0, 2)),
    ("seeds, designs", lambda: evaluate(Scenario(), Design(), NETWORK, range(10**8))),
    ("seeds, designs", lambda: evaluate(Scenario(), Design(), NETWORK, range(2**62))),
    ("seeds, designs", lambda: evaluate(Scenario(), Design(kappa=np.ones(10**5)), NETWORK, range(1000))),
    ("selection_seeds", lambda: study(1.0, 0.1, 10**8)),
    ("selection_seeds", lambda: study(1.0, 0.1, 2**60)),
    ("seeds, designs", lambda: chunks(10**6, 1.0)),
    ("grids", lambda: one_at_a_time(Design(), {"eta": np.arange(3000.0)}, np.arange(3000.0))),
    ("grids", lambda: full_grid(Design(), {"eta": range(2000), "kappa": range(1, 2000)}, [0.1])),
    ("robots", lambda: Layout().place(10**8)),
    ("num_robots", lambda: Layout().place(10**400)),
    ("n", lambda: _checks.count("n", 10**400)),
    ("horizon, tau", lambda: num_ticks(1e300, 1e-300)),
    ("horizon, tau", lambda: num_ticks(float("inf"), 1.0)),
]


@pytest.mark.usefixtures("_spared")
@pytest.mark.parametrize(("name", "call"), SIZES, ids=range(len(SIZES)))
def test_sizes_beyond_the_machine_are_one_line(name: str, call: Callable[[], Any]) -> None:
    with pytest.raises(ValueError, match=f"^{name}: got .*expected at most") as caught:
        call()
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300


def test_a_packed_table_that_unpacks_to_more_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A million rows that are alike take a few kB."""
    parquet = pytest.importorskip("pyarrow.parquet")
    table = pytest.importorskip("pyarrow").table({"rtt": np.full(10**6, 0.1)})
    parquet.write_table(table, tmp_path / "loops.parquet", compression="zstd")
    assert (tmp_path / "loops.parquet").stat().st_size < 10**5
    monkeypatch.setattr(_room, "memory", lambda: 10**7)
    with pytest.raises(ValueError, match="loops.parquet: got 1000000 rows of 1 columns, which takes 50 MB of memory"):
        read_records(tmp_path / "loops.parquet")


class Numbers(Part):
    one: float
    many: list[list[int | float]]


@pytest.mark.parametrize("value", [10**400, -(10**18), 1e39, 1e-38, float("nan"), -1e300])
def test_numbers_that_32_bits_do_not_hold_are_refused_with_their_option(value: float) -> None:
    for name, values in (("one", {"one": value, "many": []}), ("many.0.1", {"one": 0.0, "many": [[1, value]]})):
        with pytest.raises(ValueError, match=f"^{name}: got .*, expected ") as caught:
            load(Numbers, OmegaConf.create(values))
        assert len(str(caught.value)) < 120


def test_numbers_that_they_hold_are_taken() -> None:
    values = {"one": float("inf"), "many": [[0, -1e-30, 2**31], [1e38, -1e-37, 0.0]]}
    assert load(Numbers, OmegaConf.create(values)).model_dump() == values


ASKED = [
    ("tune", "tune.evaluation_seeds"), ("tune", "tune.landscape"), ("tune", "tune.steps"), ("qos", "qos.seeds"),
    ("codesign", "search.choice_seeds"), ("codesign", "sweep.evaluation_seeds"), ("advise", "advise.fresh_seeds"),
    ("advise", "advise.margins.points"), ("validate", "validation.resamples"), ("validate", "validation.seeds"),
    ("fleet", "fleet.seeds"),
]  # fmt: skip


@pytest.mark.parametrize(("command", "option"), ASKED, ids=[option for _, option in ASKED])
def test_what_a_command_asks_for_later_is_refused_at_once(command: str, option: str) -> None:
    add_resolver("own_folder", lambda *given: None)
    model = import_module(f"qocjax.{command}").main.model()
    with initialize_config_dir(str(conf_dir()), **hydra_base()):
        given = compose(command, [f"{option}=200000000"])
    with pytest.raises(ValueError, match=f"^{option}: got 200000000, which takes .* of memory at least"):
        load(model, given)


def test_the_memory_of_a_machine_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    assert 1e8 < _room.memory() < 1e16


HELD = """
import sys
import numpy as np
from qocjax._room import give_back

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096

if sys.argv[1] == "yes":
    give_back()
np.ones(1 << 20)  # 8 MB that are freed, from which on the C library keeps as large ones
kept = [(np.ones(1 << 18), np.ones(12_000)) for _ in range(40)]  # of 2 MB, with something smaller after each
small = [after for _, after in kept]
before = resident()
del kept
print(before - resident() > 60e6)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc keeps what is freed, and can be told not to")
def test_large_arrays_that_are_freed_go_back_to_the_system() -> None:
    found = [subprocess.run([sys.executable, "-c", HELD, told], capture_output=True, text=True, check=True).stdout
             for told in ("yes", "no")]  # fmt: skip
    assert [each.strip() for each in found] == ["True", "False"]
