"""Many designs x seeds under common random numbers: metrics out, not trajectories."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from itertools import chain, islice
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike, DTypeLike

from qocjax import _checks
from qocjax._pieces import kept_each
from qocjax._room import check_results, check_runs
from qocjax._xla import num_workers
from qocjax.batch.ahead import side_by_side
from qocjax.batch.layout import LANES, Batch, batches_of, groups_of
from qocjax.batch.runner import Measure, Runner, metrics
from qocjax.controllers import Apf, Controller
from qocjax.network.interface import Network
from qocjax.network.schedule import Rules
from qocjax.scenario import Design, Scenario, check_times, num_ticks
from qocjax.single import check_start
from qocjax.tunables import check_others
from qocjax.units import unit_of

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["MAX_RUNS", "evaluate", "run_grid"]

# Runs of one batch with two robots: what is carried stays in the innermost caches on CPUs, and fills a GPU.
MAX_RUNS = {"cpu": 512, "gpu": 1 << 16, "tpu": 1 << 16}

# Likewise where each command takes long: enough to share a schedule, and few enough to be spread over the cores.
_COSTLY_RUNS = {"cpu": 8, "gpu": 1 << 10, "tpu": 1 << 10}

_SCENARIO_NUMBERS = ("start", "goal", "nominal_kappa", "nominal_v_max", "weights", "robot_radius")


def evaluate(
    scenario: Scenario,
    designs: Design,
    network: Network,
    seeds: Sequence[int],
    *,
    rules: Rules | None = None,
    key: int = 0,
    dtype: DTypeLike = jnp.float32,
    max_runs: int | None = None,
    progress: Callable[[int], None] | None = None,
    controller: Controller | None = None,
    only: tuple[Sequence[int], Sequence[int]] | None = None,
    pool: Executor | None = None,
) -> xr.Dataset:
    """Simulates every design with every seed; designs of the same tau share their loop times.

    Args:
        scenario: Robots, goal, horizon, yardstick; each seed jitters the start.
        designs: Values broadcastable to [G].
        network: Where loop times come from.
        seeds: [S] Monte Carlo seeds; each fixes the start jitter and the loop times whatever else is evaluated.
        rules: Actuation and hold, by default those of the model.
        key: Root of all random numbers, common to the seeds of a study.
        dtype: float32 is the speed path, with polynomial functions of angles within their range; float64 (with JAX's
            x64 mode on) is exact.
        max_runs: Runs of one batch with two robots; by default what suits the device. Results do not depend on it,
            up to rounding.
        progress: Called with the number of robot-steps done, after each batch.
        controller: What computes the commands, by default the surrogate law.
        only: Places of the designs and of the seeds that are simulated, each ascending, by default all; the others
            still say which programs are worth compiling. So parts of a study, in any order, are the study bit for bit
            where they hold whole groups of one tau and deadline, and seeds in multiples of 32.
        pool: Threads that run the batches; by default as many as there are cores, for this call.

    Returns:
        Metrics over (design, seed, robot) or (design, seed), with units as attributes: auc, path_length, effort,
        arrival_time, min_distance, collided, completed_share, age_mean, age_peak, and what the controller reports. The
        attribute `math` says which functions of angles ran.

    Raises:
        TypeError: A seed is no whole number.
        ValueError: No design, no seed, a tau above the horizon, a start on the reference, or what the controller
            refuses.
    """
    controller = controller or Apf()
    most = (_COSTLY_RUNS if controller.costly else MAX_RUNS).get(jax.default_backend(), 512)
    limit = most if max_runs is None else _checks.count("max_runs", max_runs)
    return run_grid(
        scenario, designs, network, seeds, metrics,
        rules=rules or Rules(), key=key, dtype=dtype, max_runs=limit, progress=progress, controller=controller,
        only=only, pool=pool,
    )  # fmt: skip


def run_grid(
    scenario: Scenario,
    designs: Design,
    network: Network,
    seeds: Sequence[int],
    measure: Measure,
    *,
    rules: Rules,
    key: int,
    dtype: DTypeLike,
    max_runs: int,
    progress: Callable[[int], None] | None = None,
    in_blocks: bool = False,
    controller: Controller | None = None,
    only: tuple[Sequence[int], Sequence[int]] | None = None,
    pool: Executor | None = None,
) -> xr.Dataset:
    """Takes a measure of every design with every seed; see `evaluate` for the arguments.

    Raises:
        TypeError: A seed is no whole number.
        ValueError: No design, no seed, a tau above the horizon, or a start on the reference.
    """
    _check_kinds(scenario, designs, network, rules)
    grid = _as_grid(designs, scenario)
    _check_sizes(scenario, grid, seeds, only)
    rows, numbers = _chosen(only, len(grid["tau"]), seeds)
    if not -(2**31) <= _checks.count("key", key, least=-(2**63), most=2**63) < 2**31:
        raise ValueError(f"key: got {key}, expected a whole number of 32 bits")
    width = _checked_dtype(dtype)
    _check_held(grid | {name: getattr(scenario, name) for name in _SCENARIO_NUMBERS}, width)
    check_start(scenario, scenario.start)
    controller = controller or Apf()
    every = Design.checked(grid)
    check_others(controller.tunables, every.others)
    controller.check(scenario, every, rules)
    runner = Runner(scenario, grid, network, numbers, rules, key, width, measure, in_blocks, controller)
    total = len(numbers if only is None else seeds)
    runs_each, general = scenario.num_robots * total, not (in_blocks or controller.costly)
    groups = groups_of(grid["tau"], grid["deadline"], scenario.horizon, rules, runs_each, general)
    wanted = np.isin(np.arange(len(grid["tau"])), rows)
    chosen = [replace(group, designs=group.designs[wanted[group.designs]]) for group in groups]
    work = [group for group in chosen if len(group.designs)]
    batches = batches_of(work, len(numbers), total, scenario.num_robots, max_runs, snug=controller.costly)
    # All that the batches and their bits follow from.
    values = (
        scenario, grid, rows, network, numbers, total, measure, rules, key, width.str, max_runs, in_blocks, controller,
    )  # fmt: skip
    results: dict[str, np.ndarray] = {}
    for batch, found in kept_each(values, batches, lambda some: _in_parallel(runner.run, some, pool)):
        _put(results, (len(rows), len(numbers)), batch, np.searchsorted(rows, batch.designs), found)
        if progress is not None:
            progress(batch.num_designs * batch.num_seeds * scenario.num_robots * batch.group.ticks)
    return _labelled(
        results,
        {name: values[rows] for name, values in grid.items()},
        numbers,
        {"math": ", ".join(sorted({runner.math(group.longest_period).name for group in groups})), "dtype": str(width)},
    )


def _check_sizes(
    scenario: Scenario,
    grid: Mapping[str, np.ndarray],
    seeds: Sequence[int],
    only: tuple[Sequence[int], Sequence[int]] | None,
) -> None:
    """Checks that one batch, and all results, fit into memory."""
    designs, numbers = (len(grid["tau"]), seeds) if only is None else (len(only[0]), only[1])
    count = len(numbers) if hasattr(numbers, "__len__") else 1  # what is no sequence is told of later
    check_results(designs, count, scenario.num_robots)
    check_runs(num_ticks(scenario.horizon, float(grid["tau"].min())), scenario.num_robots, min(count, LANES))


def _chosen(
    only: tuple[Sequence[int], Sequence[int]] | None, num_designs: int, seeds: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Places of the designs, and the seeds, that are simulated."""
    if only is None:
        return np.arange(num_designs), _checked_seeds(seeds)
    places = []
    for what, given, length in (("designs", only[0], num_designs), ("seeds", only[1], len(seeds))):
        array = np.asarray(given, np.int64)
        if array.ndim != 1 or array.size == 0 or array[0] < 0 or array[-1] >= length or (np.diff(array) < 1).any():
            raise ValueError(f"only: got {what} {given!r}, expected ascending places below {length}")
        places.append(array)
    return places[0], _checked_seeds([seeds[place] for place in places[1].tolist()])


def _check_kinds(scenario: Scenario, designs: Design, network: Network, rules: Rules) -> None:
    for name, value, kind in (("scenario", scenario, Scenario), ("designs", designs, Design), ("rules", rules, Rules)):
        if not isinstance(value, kind):
            raise TypeError(f"{name}: got {value!r}, expected a {kind.__name__}")
    if not callable(getattr(network, "draw", None)):
        raise TypeError(f"network: got {network!r}, expected a Network, such as paper_network()")


def _checked_seeds(seeds: Sequence[int]) -> np.ndarray:
    try:
        numbers = [_checks.count("seeds", seed, least=0, most=2**32 - 1) for seed in seeds]
    except TypeError as error:
        text = str(error)
        raise TypeError(text if text.startswith("seeds") else f"seeds: got {seeds!r}, expected whole numbers") from None
    if not numbers:
        raise ValueError("seeds: got none, expected at least one")
    return np.array(numbers, np.int64)


def _checked_dtype(dtype: DTypeLike) -> np.dtype:
    try:
        width = jnp.dtype(dtype)
    except TypeError:
        raise TypeError(f"dtype: got {dtype!r}, expected float32 or float64") from None
    if width not in (np.float32, np.float64):
        raise ValueError(f"dtype: got {width}, expected float32 or float64")
    if width == np.float64 and jnp.result_type(float) != np.float64:
        raise ValueError("dtype: got float64 without JAX's x64 mode, expected float32 or jax_enable_x64 set")
    return width


def _check_held(values: Mapping[str, ArrayLike], width: np.dtype) -> None:
    """Checks that no number is too large for the type that is computed with."""
    for name, value in values.items():
        array = np.abs(np.asarray(value, np.float64))
        if (array > np.finfo(width).max).any():
            raise ValueError(f"{name}: got {array.max():g}, expected numbers that {width} can hold")


def _as_grid(designs: Design, scenario: Scenario) -> dict[str, np.ndarray]:
    """The values of all designs, each [G] in float64."""
    values = {name: np.asarray(value, np.float64) for name, value in designs.values().items()}
    try:
        shape = np.broadcast_shapes(*(value.shape for value in values.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {value.shape}" for name, value in values.items() if value.ndim)
        raise ValueError(f"designs: got {shapes}, expected one common length G") from None
    if len(shape) > 1 or 0 in shape:
        raise ValueError(f"designs: got values of shape {shape}, expected numbers or arrays [G] with G >= 1")
    check_times(scenario, values["tau"], values["deadline"])
    return {name: np.broadcast_to(value, shape or (1,)) for name, value in values.items()}


def _in_parallel(
    run: Callable[[Batch], dict], batches: Iterable[Batch], pool: Executor | None
) -> Iterator[tuple[Batch, dict]]:
    """Runs batches on the workers; a single one here, as handing it over takes longer than a small one does."""
    workers, source = num_workers(), iter(batches)
    first = list(islice(source, 2))
    if len(first) == 1:
        yield first[0], _real(first[0], run(first[0]))
        return
    with nullcontext(pool) if pool else ThreadPoolExecutor(workers) as threads:
        for batch, found in side_by_side(run, chain(first, source), threads, 2 * workers):
            yield batch, _real(batch, found)


def _real(batch: Batch, found: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of a batch without what fills it up, [designs, seeds] or [designs, seeds, N]."""
    moved = {name: np.moveaxis(values, 0, -1) if values.ndim == 3 else values for name, values in found.items()}
    return {name: values[: batch.num_designs, : batch.num_seeds] for name, values in moved.items()}


def _put(
    results: dict[str, np.ndarray],
    shape: tuple[int, int],
    batch: Batch,
    designs: np.ndarray,
    found: dict[str, np.ndarray],
) -> None:
    """Writes what a batch found to its places in [G, S] or [G, S, N]."""
    place = np.ix_(designs[: batch.num_designs], batch.seeds[: batch.num_seeds])
    for name, values in found.items():
        whole = results.setdefault(name, np.empty((*shape, *values.shape[2:]), values.dtype))
        whole[place] = values


def _labelled(
    results: dict[str, np.ndarray], grid: dict[str, np.ndarray], seeds: np.ndarray, attributes: dict[str, str]
) -> xr.Dataset:
    import xarray as xr  # with pandas a third of a second, which a refusal need not take

    dims = ("design", "seed", "robot")
    return xr.Dataset(
        {name: (dims[: values.ndim], values, {"units": unit_of(name)}) for name, values in results.items()},
        {name: ("design", values, {"units": unit_of(name)}) for name, values in grid.items()} | {"seed": seeds},
        attributes,
    )
