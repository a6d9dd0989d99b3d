"""What a cluster of workers brings and costs, and what 1e9 simulations take by these figures.

    python experiments/bench/cluster.py [speedup] [overhead] [reading] [plan]

All by default, about ten minutes on two cores. Figures go to experiments/results/cluster_*.csv, which `plan` reads.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
from hydra import compose, initialize_config_dir

import qocjax.cluster.engine as dask_engine
from qocjax._xla import request_whole_loop
from qocjax.cluster import DaskEngine
from qocjax.commands.sweep import run
from qocjax.config import StudyConfig, conf_dir, load
from qocjax.store import write_json
from qocjax.store.provenance import provenance
from qocjax.store.study_folder import ChunkFolder
from qocjax.study.chunks import Chunk, Failure, Part, Result, plan
from qocjax.study.problem import Problem

RESULTS = Path(__file__).resolve().parents[1] / "results"
ROUNDS = 3
SEEDS = 4096  # of the sweep of kappa, half a minute of one core

# Chunk results of that many bytes, from next to nothing to ten default chunks.
SIZES = (1_000, 100_000, 1_000_000, 10_000_000)
CHUNKS = {1_000: 1000, 100_000: 1000, 1_000_000: 500, 10_000_000: 60}

STEPS = 3000 * 2  # robot-steps of a simulation: 30 s at 10 ms, two robots
TARGET = 1e9


def config(*options: str) -> StudyConfig:
    """The sweep of kappa, with other options."""
    with initialize_config_dir(str(conf_dir()), version_base="1.3"):
        return load(StudyConfig, compose("sweep", ["sweep=kappa", "figures=false", "report=false", *options]))


def canned(recipe: object, chunk: Chunk, settings: object) -> Result:
    """In place of a simulation: a result of as many bytes as the chunk has steps."""
    return Result({"auc": np.zeros(chunk.steps // 4, np.float32)}, {}, {})


@contextmanager
def canned_results() -> Iterator[None]:
    """Lets workers answer at once."""
    real = dask_engine.run_chunk
    dask_engine.run_chunk = canned
    try:
        yield
    finally:
        dask_engine.run_chunk = real


def timed(engine: DaskEngine, problem: Problem, chunks: list[Chunk], keep: bool) -> float:
    """Seconds until all chunks are back, and written where they are kept."""
    with tempfile.TemporaryDirectory(dir=RESULTS.parent) as folder:
        files = ChunkFolder(Path(folder))
        begin = time.perf_counter()
        for chunk, result in engine.run(problem, chunks):
            if isinstance(result, Failure):
                raise RuntimeError(result.cause)
            if keep:
                files.put(chunk.name, chunk.describe(), result.values, {"attributes": result.attributes})
        return time.perf_counter() - begin


def write(name: str, table: pd.DataFrame) -> None:
    """Keeps a table."""
    table.to_csv(RESULTS / f"{name}.csv", index=False, float_format="%.6g")


def speedup() -> None:
    """The same chunks on one worker of one core and on two, in turn; programs compiled before."""
    problem = config().build_problem()
    chunks = plan(problem, Part("selection", range(SEEDS)))
    simulations, steps = sum(chunk.runs for chunk in chunks), sum(chunk.steps for chunk in chunks)
    rows = []
    with DaskEngine(workers=1, cores=1) as one, DaskEngine(workers=2, cores=1) as two:
        engines = {1: one, 2: two}
        for engine in engines.values():
            timed(engine, problem, chunks[:6], keep=True)
        memory = [each.memory_info().rss / 2**20 for each in psutil.Process().children(recursive=True)]
        for turn in range(ROUNDS):
            for workers, engine in engines.items():
                seconds = timed(engine, problem, chunks, keep=True)
                rows.append(
                    {"workers": workers, "round": turn, "seconds": seconds, "ns_per_robot_step": seconds / steps * 1e9}
                )
                print(rows[-1], flush=True)
        memory += [each.memory_info().rss / 2**20 for each in psutil.Process().children(recursive=True)]
    table = pd.DataFrame(rows).assign(simulations=simulations, chunks=len(chunks), worker_mib=max(memory))
    write("cluster_speedup", table)
    best = table.groupby("workers")["seconds"].min()
    print(f"two workers are {best[1] / best[2]:.2f} times as fast as one; a worker takes {max(memory):.0f} MiB")
    write_json(RESULTS / "cluster.json", provenance())


def overhead() -> None:
    """Time per chunk beside the simulation, by the size of the result, with and without writing it."""
    problem = config().build_problem()
    rows = []
    with canned_results(), DaskEngine(workers=1, cores=1) as engine:
        part = Part("selection", range(2))
        for size in SIZES:
            chunks = [Chunk(f"selection-{k:05d}", part, (0,), (0, 2), size) for k in range(CHUNKS[size])]
            timed(engine, problem, chunks[:20], keep=False)
            for written in (False, True):
                seconds = min(timed(engine, problem, chunks, keep=written) for _ in range(ROUNDS))
                rows.append(
                    {
                        "bytes": size,
                        "written": written,
                        "chunks": len(chunks),
                        "ms_per_chunk": seconds / len(chunks) * 1e3,
                    }
                )
                print(rows[-1], flush=True)
    write("cluster_overhead", pd.DataFrame(rows))


def reading() -> None:
    """Time and memory of the tables, once all chunks are there: a finished study started again."""
    rows = []
    for seeds in (512, 4096):
        study = config(f"sweep.seeds={seeds}", "engine=dask")
        with tempfile.TemporaryDirectory(dir=RESULTS.parent) as folder:
            run(study, Path(folder), quiet=True)
            begin = time.perf_counter()
            run(study, Path(folder), quiet=True)
            seconds = time.perf_counter() - begin
            size = sum(path.stat().st_size for path in Path(folder, "chunks").iterdir())
        simulations = len(np.asarray(study.build_problem().designs.tau)) * seeds
        peak = psutil.Process().memory_info().rss / 2**20
        rows.append(
            {
                "simulations": simulations,
                "seconds": seconds,
                "bytes_per_simulation": size / simulations,
                "driver_mib": peak,
            }
        )
        print(rows[-1], flush=True)
    write("cluster_reading", pd.DataFrame(rows))


def the_plan() -> None:
    """What 1e9 simulations take, by the figures above."""
    speed = pd.read_csv(RESULTS / "cluster_speedup.csv").set_index("workers")["seconds"]
    table = pd.read_csv(RESULTS / "cluster_speedup.csv")
    costs = pd.read_csv(RESULTS / "cluster_overhead.csv").query("written").sort_values("bytes")
    read = pd.read_csv(RESULTS / "cluster_reading.csv").iloc[-1]
    per_simulation = speed[1].min() / table["simulations"].iloc[0]
    rows = []
    for steps in (1e7, 1e8, 1e9, 1e10):
        size = steps / STEPS * read["bytes_per_simulation"]
        # Beyond what was measured, bytes cost what they cost there.
        slope = np.diff(costs["ms_per_chunk"])[-1] / np.diff(costs["bytes"])[-1]
        inside = np.interp(size, costs["bytes"], costs["ms_per_chunk"])
        driver = (inside + max(0.0, size - costs["bytes"].max()) * slope) / 1e3
        chunks = TARGET * STEPS / steps
        for workers in (1, 10, 1000):
            compute = TARGET * per_simulation / workers + steps / STEPS * per_simulation  # and the last chunk
            row = {
                "chunk_steps": steps,
                "workers": workers,
                "chunks": chunks,
                "chunk_s": steps / STEPS * per_simulation,
            }
            row |= {"chunk_mb": size / 1e6, "driver_ms_per_chunk": driver * 1e3, "compute_h": compute / 3600}
            row |= {"driver_h": chunks * driver / 3600, "hours": max(compute, chunks * driver) / 3600}
            row |= {"tables_h": TARGET * read["seconds"] / read["simulations"] / 3600}
            rows.append(row | {"disk_gb": TARGET * read["bytes_per_simulation"] / 1e9})
    found = pd.DataFrame(rows)
    write("cluster_plan", found)
    print(found.to_string(index=False, float_format="{:.3g}".format))


if __name__ == "__main__":
    request_whole_loop()
    parts = {"speedup": speedup, "overhead": overhead, "reading": reading, "plan": the_plan}
    for name in sys.argv[1:] or parts:
        parts[name]()
