"""What a worker does: a chunk, with the bits that its driver would have computed."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from distributed import get_worker

from qocjax._once import Once
from qocjax._xla import num_workers, request_whole_loop, whole_loop_requested
from qocjax.study.chunks import Chunk, Failure, Result, compute
from qocjax.study.engine import failure_of
from qocjax.study.problem import Problem

__all__ = ["Recipe", "Settings", "run_chunk", "settings_here"]

# Settings of JAX that random bits hang on, and where compiled programs are kept; not every JAX has all of them.
_CACHE = "jax_compilation_cache_dir"
_OPTIONS = (
    "jax_default_prng_impl", "jax_threefry_partitionable", _CACHE, "jax_persistent_cache_min_compile_time_secs",
)  # fmt: skip


@dataclass(frozen=True)
class Recipe:
    """How a worker comes to the problem."""

    rebuilt: Callable[[Mapping[str, Any]], Problem]  # sent as its module and name
    configuration: str  # of the study, as JSON
    data: str  # digest of what the driver's problem holds beside it


@dataclass(frozen=True)
class Settings:
    """What a worker takes over from its driver."""

    x64: bool
    whole_loop: bool  # whether the driver asks XLA to compile loops whole
    options: tuple[tuple[str, Any], ...]  # of JAX
    cores: tuple[tuple[int, ...], ...] = ()  # by the number of the worker; without them it stays where it is


def settings_here(cores: tuple[tuple[int, ...], ...] = ()) -> Settings:
    """The settings of this process."""
    options = tuple((name, getattr(jax.config, name)) for name in _OPTIONS if hasattr(jax.config, name))
    return Settings(jnp.result_type(float) == jnp.float64, whole_loop_requested(), options, cores)


class _Process:
    """What the chunks in this process share."""

    def __init__(self, settings: Settings) -> None:
        """Pins the process, then starts JAX, which makes as many threads as it finds cores."""
        name, threads = _worker()
        if isinstance(name, int) and name < len(settings.cores):
            _pin(settings.cores[name])
        if settings.whole_loop:
            request_whole_loop()
        self.devices = _Devices(jax.local_devices())
        cpu = jax.default_backend() == "cpu"
        self.pool = ThreadPoolExecutor(min(threads, num_workers()) if cpu else len(jax.local_devices()))


class _Devices:
    """Hands out the devices of this process, the least busy one first."""

    def __init__(self, devices: Sequence[jax.Device]) -> None:
        self._busy = dict.fromkeys(devices, 0)
        self._lock = threading.Lock()

    @contextmanager
    def one(self) -> Iterator[jax.Device]:
        with self._lock:
            device = min(self._busy, key=self._busy.__getitem__)
            self._busy[device] += 1
        try:
            yield device
        finally:
            with self._lock:
                self._busy[device] -= 1


_process: Once[_Process] = Once()
_problems: Once[Problem] = Once(capacity=2)


def run_chunk(recipe: Recipe, chunk: Chunk, settings: Settings) -> Result | Failure:
    """Computes a chunk in a worker, on the device that has least to do.

    Args:
        recipe: Of the problem, which is built once in each process.
        chunk: Which part of it.
        settings: Of the driver.

    Raises:
        ValueError: The worker finds other data, or what `compute` raises; the message names the worker.
    """
    process = _process.get("only", lambda: _Process(settings))
    _adopt(settings)
    try:
        with jax.enable_x64(settings.x64), process.devices.one() as device, jax.default_device(device):
            problem = _problems.get((recipe, settings.x64), lambda: _built(recipe))
            return compute(problem, chunk, process.pool)
    except (MemoryError, jax.errors.JaxRuntimeError) as error:
        return failure_of(error)
    except (ValueError, TypeError, OSError) as error:
        raise ValueError(f"{error} (at the worker {_address()})") from None


def _built(recipe: Recipe) -> Problem:
    problem = recipe.rebuilt(json.loads(recipe.configuration))
    if problem.data() != recipe.data:
        raise ValueError("network, map or law: got other files than the driver's, expected the same on all machines (a "
                         "worker keeps a law as it first read it, until it is started again)")  # fmt: skip
    return problem


def _adopt(settings: Settings) -> None:
    """Takes over the driver's settings of JAX; the folder of compiled programs only where this machine names none."""
    for name, value in settings.options:
        own_cache = name == _CACHE and "JAX_COMPILATION_CACHE_DIR" in os.environ
        if not own_cache and getattr(jax.config, name, value) != value:
            jax.config.update(name, value)


def _pin(cores: Sequence[int]) -> None:
    """Keeps all threads of this process, and those that they start, on some cores."""
    for thread in Path("/proc/self/task").iterdir():
        try:
            os.sched_setaffinity(int(thread.name), cores)
        except ProcessLookupError:  # it has ended
            continue


def _worker() -> tuple[Any, int]:
    """Name and threads of the worker that this runs in: the threads of a Dask worker are the cores it may use."""
    try:
        worker = get_worker()
    except ValueError:
        return None, num_workers()
    return worker.name, worker.state.nthreads


def _address() -> str:
    try:
        return get_worker().address
    except ValueError:
        return "of this process"
