"""What the benchmark runs: a process for each entry, which answers each question with one timed call.

    python -m experiments.bench.entries '{"entry": "cpp_kernel", "size": "smallest", ...}'

A process of its own has its own threads, its own XLA_FLAGS and an honest first call. It reads `<method> <grid>` a line,
runs that, and answers with a line of JSON.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast
from unittest import mock

import numpy as np

__all__ = ["ENTRIES", "ROOT", "Entry", "Process", "clean_environment"]

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Entry:
    """One way to run the study."""

    label: str
    entry: str  # module of a baseline, or qocjax
    part: str  # key of Size.parts, or all
    methods: tuple[str, ...] = ("evaluate",)
    one_core: bool = False
    whole_loop: bool = False


_BOTH = ("evaluate", "program")

ENTRIES = (
    Entry("C++ kernel", "cpp_kernel", "all"),
    Entry("C++ kernel", "cpp_kernel", "medium", one_core=True),
    Entry("C++ kernel, all metrics", "cpp_metrics", "all"),
    Entry("C++ kernel, all metrics", "cpp_metrics", "medium", one_core=True),
    Entry("qocjax.evaluate", "qocjax", "all", _BOTH, whole_loop=True),
    Entry("qocjax.evaluate", "qocjax", "medium", _BOTH, one_core=True, whole_loop=True),
    Entry("qocjax.evaluate without XLA_FLAGS", "qocjax", "medium", _BOTH),
    Entry("Numba prange", "numba_loop", "slow"),
    Entry("plain vmap", "vmap_scan", "slowest"),
    Entry("plain vmap with XLA_FLAGS", "vmap_scan", "slowest", whole_loop=True),
    Entry("NumPy", "numpy_loop", "slow"),
)


class Process:
    """A process that answers each line with one timed call."""

    def __init__(self, label: str, module: str, options: dict[str, Any]) -> None:
        """Starts a module of this folder; `label` names it in errors."""
        self._label = label
        self._process = subprocess.Popen(
            [sys.executable, "-m", f"experiments.bench.{module}", json.dumps(options)],
            cwd=ROOT, env=clean_environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def ask(self, question: str = "") -> None:
        """Starts a call."""
        stdin = cast(IO[str], self._process.stdin)
        stdin.write(question + "\n")
        stdin.flush()

    def answer(self) -> dict[str, Any]:
        """Waits for what it says about the call: its `seconds` and more."""
        line = cast(IO[str], self._process.stdout).readline()
        if not line:
            raise RuntimeError(f"{self._label}: its process ended with code {self._process.wait()}")
        return json.loads(line)

    def close(self) -> None:
        """Ends the process."""
        self._process.communicate()


def clean_environment() -> dict[str, str]:
    """The caller's environment with JAX and XLA at their own settings, on the CPU."""
    return {name: value for name, value in os.environ.items() if not name.startswith(("JAX_", "XLA_"))} | {
        "JAX_PLATFORMS": "cpu"
    }


def _serve(options: dict[str, Any]) -> None:
    """Answers questions until standard input ends: seconds, lanes, robot-steps and the mean AUC of each design."""
    if options["one_core"]:
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # before any library counts its threads
    if options["whole_loop"]:
        from qocjax._xla import request_whole_loop

        request_whole_loop()
    from experiments.bench.baselines import Unavailable
    from experiments.bench.study import SIZES, Part, make_study

    size = SIZES[options["size"]]
    part = Part() if options["part"] == "all" else size.parts[options["part"]]
    calls: dict[str, Callable[[], np.ndarray]] = {}
    studies = {grid: make_study(size, grid, part) for grid in ("on", "off")}
    for question in map(str.strip, sys.stdin):
        method, grid = question.split()
        study = studies[grid]
        try:
            if question not in calls:
                calls[question] = _prepare(options["entry"], method, study)
            begin = time.perf_counter()
            auc = calls[question]()
            seconds = time.perf_counter() - begin
        except Unavailable as reason:
            print(json.dumps({"unavailable": str(reason)}), flush=True)
            continue
        by_design = auc.reshape(np.size(study.designs.deadline), -1).mean(axis=1, dtype=float)
        answer = {"seconds": seconds, "lanes": auc.shape[0], "robot_steps": study.robot_steps}
        print(json.dumps(answer | {"auc": by_design.tolist()}), flush=True)


def _prepare(entry: str, method: str, study: Any) -> Callable[[], np.ndarray]:
    """A call that runs a study and returns its AUC [L, N]."""
    from experiments.bench.study import NETWORK, work_of

    if entry != "qocjax":
        work = work_of(study)
        return lambda: importlib.import_module(f"experiments.bench.baselines.{entry}").evaluate(work)
    import qocjax

    arguments = (study.scenario, study.designs, NETWORK, study.seeds)

    def evaluate() -> np.ndarray:
        return qocjax.evaluate(*arguments)["auc"].values.reshape(-1, study.scenario.num_robots)

    return evaluate if method == "evaluate" else _program(evaluate)


def _program(evaluate: Callable[[], np.ndarray]) -> Callable[[], np.ndarray]:
    """The compiled loops that `evaluate` calls, with the arguments that it gives them, and nothing else."""
    import jax

    from qocjax._xla import num_workers

    calls: list[tuple[jax.stages.Compiled, tuple]] = []
    call = jax.stages.Compiled.__call__

    def noted(self: jax.stages.Compiled, *args: Any) -> Any:
        result = call(self, *args)
        if isinstance(result, dict):  # the metrics of a batch; drawing gives a pair
            calls.append((self, args))
        return result

    with mock.patch.object(jax.stages.Compiled, "__call__", noted):
        auc = evaluate()
    if not calls:
        raise RuntimeError("qocjax.evaluate called no compiled loop that returns metrics by name")

    def again() -> np.ndarray:
        with ThreadPoolExecutor(num_workers()) as pool:
            for result in pool.map(lambda each: jax.block_until_ready(call(each[0], *each[1])), calls):
                assert "auc" in result
        return auc

    return again


if __name__ == "__main__":
    _serve(json.loads(sys.argv[1]))
