"""What is promised of equal bits: any number of cores, subsets of seeds. (Width: test_draws; engines: test_cluster.)"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
import xarray as xr

from qocjax import Design, Rules, Scenario, evaluate, paper_network
from qocjax.batch.layout import batches_of, groups_of

ROOT = Path(__file__).parents[1]
SWEEP = [
    "sweep=kappa", "sweep.grids.kappa=[1.0,2.0]", "loop.tau=0.02", "sweep.deadline_ms=[0,110,200,455]",
    "sweep.seeds=40", "sweep.evaluation_seeds=20", "scenario.horizon=6", "figures=false", "report=false",
]  # fmt: skip


def tables_on(cores: int, folder: Path) -> dict[str, bytes]:
    """Tables of a small study that runs on some cores alone."""
    command = (
        "import os, sys\n"
        f"os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:{cores}])\n"
        f"sys.argv = ['sweep', *{SWEEP!r}, 'hydra.run.dir={folder}']\n"
        "from qocjax.sweep import main\nmain()\n"
    )
    environment = dict(os.environ, JAX_COMPILATION_CACHE_DIR=str(folder / "cache"), PYTHONPATH=str(ROOT))
    done = subprocess.run([sys.executable, "-c", command], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return {name: (folder / name).read_bytes() for name in ("results.csv", "policies.csv")}


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity") or len(os.sched_getaffinity(0)) < 2, reason="one core")
def test_one_core_and_two_give_the_same_bits(tmp_path: Path) -> None:
    one, two = (tables_on(cores, tmp_path / f"on_{cores}") for cores in (1, 2))
    assert one == two and len(one["results.csv"].splitlines()) == 9


def test_a_seed_is_the_same_whichever_others_are_evaluated() -> None:
    """Its start and loop times to the bit, its metrics up to rounding: a batch of another shape is another program."""
    with jax.enable_x64(False):
        designs = Design(tau=0.02, deadline=[0.1, 0.2, 0.213])
        few, many, alone = (
            evaluate(Scenario(horizon=4.0), designs, paper_network(), seeds) for seeds in (range(5), range(64), [3])
        )
    for name in ("completed_share", "age_peak"):  # follow from the loop times alone
        np.testing.assert_array_equal(few[name], many[name].sel(seed=range(5)))
    for name in ("auc", "path_length", "effort", "age_mean"):
        np.testing.assert_allclose(few[name], many[name].sel(seed=range(5)), rtol=2e-4)
        np.testing.assert_allclose(alone[name], many[name].sel(seed=[3]), rtol=2e-4)


def test_parts_of_a_study_have_its_bits_however_many_seeds_a_batch_holds() -> None:
    """Few designs run on 128 seeds at once, and so do their parts of any number of seeds; many on 32."""
    designs = Design(tau=0.1, deadline=[0.1, 0.2, 0.2, 0.213], kappa=[1.0, 1.0, 2.0, 1.0])
    tau, deadline = (np.broadcast_to(each, 4) for each in (0.1, designs.deadline))
    groups = groups_of(tau, deadline, 4.0, Rules(), 2 * 1600)
    widths = {
        len(group.designs): len(batch.seeds) for group in groups for batch in batches_of([group], 32, 160, 2, 256)
    }
    assert widths == {1: 128, 2: 128} and groups[0].length == 256
    assert groups_of(tau, deadline, 4.0, Rules(), 2 * 160)[0].length == 2048  # which others share
    assert [len(batch.seeds) for batch in batches_of(groups[:1], 32, 160, 2, 127)] == [64]
    assert [len(batch.seeds) for batch in batches_of(groups[:1], 32, 160, 2, 63)] == [32]
    assert [len(batch.seeds) for batch in batches_of(groups[:1], 32, 160, 64, 512)] == [32]  # also of many robots
    with jax.enable_x64(False):
        whole = evaluate(Scenario(horizon=4.0), designs, paper_network(), range(160))
        for seeds in (range(32), range(32, 160), [7]):
            part = evaluate(Scenario(horizon=4.0), designs, paper_network(), range(160), only=([1, 2, 3], seeds))
            xr.testing.assert_equal(part, whole.isel(design=[1, 2, 3], seed=list(seeds)))
