"""What tests put in the place of `run_chunk`: workers import it from here."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import jax

import qocjax.batch.runner as runner
from qocjax.cluster import worker
from qocjax.study.chunks import Chunk, Failure, Result

_devices: set[str] = set()


def telling(recipe: worker.Recipe, chunk: Chunk, settings: worker.Settings) -> Result | Failure:
    """Tells where it ran."""
    result = worker.run_chunk(recipe, chunk, settings)
    assert isinstance(result, Result)
    process = worker._process.get("only", lambda: None)
    told = {
        "pid": os.getpid(),
        "address": worker._address(),
        "cores": sorted(os.sched_getaffinity(0)),
        "threads": process.pool._max_workers,
        "own_threads": sum(os.sched_getaffinity(int(path.name)) != os.sched_getaffinity(0) for path in _tasks()),
    }
    return replace(result, attributes=told)


def on_devices(recipe: worker.Recipe, chunk: Chunk, settings: worker.Settings) -> Result | Failure:
    """Tells on which devices programs of this worker have run; waits a little, so that chunks overlap."""
    if runner.compiled is not _noting:
        runner.compiled = _noting
    time.sleep(0.5)
    result = worker.run_chunk(recipe, chunk, settings)
    return replace(result, attributes={"devices": sorted(_devices)})


def slow(recipe: worker.Recipe, chunk: Chunk, settings: worker.Settings) -> Result | Failure:
    """Takes a second more."""
    time.sleep(1.0)
    return telling(recipe, chunk, settings)


def deadly(recipe: worker.Recipe, chunk: Chunk, settings: worker.Settings) -> Result | Failure:
    """Ends the worker if it is the second chunk."""
    if chunk.name.startswith("selection-00001-"):
        os.kill(os.getpid(), signal.SIGKILL)
    return worker.run_chunk(recipe, chunk, settings)


def too_large(recipe: worker.Recipe, chunk: Chunk, settings: worker.Settings) -> Result | Failure:
    """Runs out of memory in the second chunk."""
    if chunk.name.startswith("selection-00001-"):
        raise MemoryError("no room for 9 GB")
    return worker.run_chunk(recipe, chunk, settings)


_compiled = runner.compiled


def _noting(lowered: jax.stages.Lowered) -> object:
    program = _compiled(lowered)

    def call(*args: object) -> object:
        found = program(*args)
        _devices.update(str(device) for leaf in jax.tree.leaves(found) for device in leaf.devices())
        return found

    return call


def _tasks() -> list[Path]:
    return list(Path("/proc/self/task").iterdir())
