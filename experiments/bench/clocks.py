"""Clocks around the parts of a command, from outside: the time of each thread in a part, and in none within it."""

from __future__ import annotations

import builtins
import functools
import importlib
import importlib.abc
import sys
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

__all__ = ["Clocks"]

# Functions by part; what a build does not have is left out.
PARTS = {
    "composition": ("hydra._internal.hydra:Hydra.compose_config", "hydra._internal.hydra:Hydra.app_help"),
    "checks of options": ("qocjax.config.part:load",),
    "problem and designs": ("qocjax.config.study:StudyConfig.build_problem",
                            "qocjax.config.study:StudyConfig.build_grid", "qocjax.study.chunks:plan"),
    "loop times, execution": ("qocjax.batch.runner:Runner.run", "qocjax.simulate:_simulate", "qocjax.single:_simulate"),
    "advice": ("qocjax.advice.advice:advise",),
    "tables": ("qocjax.study.table:results_table", "qocjax.study.judging:judged_policies",
               "qocjax.study.ties:tie_columns", "qocjax.store.files:write_table"),
    "replays": ("qocjax.study.replays:policy_runs", "qocjax.commands.sweep:representative_run",
                "qocjax.commands.sweep_work:representative_run"),
    "figures": ("qocjax.figures.beside:draw_all", "qocjax.figures.save:save"),
    "report": ("qocjax.report.content:study_page", "qocjax.report.study:write_study_report"),
}  # fmt: skip

# What JAX tells of its own, by the end of the event's name.
EVENTS = {
    "jaxpr_trace_duration": "tracing", "jaxpr_to_mlir_module_duration": "lowering",
    "backend_compile_duration": "compiling or cache",
}  # fmt: skip


class Clocks:
    """Time by part and thread, since `begun` (as of `time.time`)."""

    def __init__(self, begun: float) -> None:
        self.zero = time.perf_counter() - (time.time() - begun)
        self.spent: dict[str, dict[str, float]] = defaultdict(lambda: defaultdict(float))
        self.programs: Counter[str] = Counter()
        self.local = threading.local()
        self.functions = {place: part for part, places in PARTS.items() for place in places}

    def start(self) -> None:
        """Sets the clocks: on imports at once, on functions as their modules are imported."""
        original = builtins.__import__

        def timed(name: str, *rest: Any, **more: Any) -> ModuleType:
            with self.part("import"):
                return original(name, *rest, **more)

        builtins.__import__ = timed
        sys.meta_path.insert(0, _Finder(self._loaded))

    def result(self) -> dict:
        """Seconds by part, those of the main thread apart, and how many programs there were."""
        wall = time.perf_counter() - self.zero
        parts = {part: dict(times) for part, times in sorted(self.spent.items())}
        known = sum(times.get("main", 0.0) for times in parts.values())
        return {"parts": parts | {"else": {"main": wall - known}}, "programs": dict(self.programs), "wall_s": wall}

    def part(self, name: str) -> _Part:
        """A clock that runs within a `with` block, and stops those around it."""
        return _Part(self, name)

    def add(self, part: str, seconds: float) -> None:
        """Books time of this thread."""
        self.spent[part]["main" if threading.current_thread() is threading.main_thread() else "others"] += seconds

    @property
    def inner(self) -> list[float]:
        """For each open part of this thread, what parts within it took."""
        if not hasattr(self.local, "inner"):
            self.local.inner = []
        return self.local.inner

    def _loaded(self, module: ModuleType) -> None:
        for place, part in self.functions.items():
            name, _, path = place.partition(":")
            if name == module.__name__:
                owner: Any = functools.reduce(getattr, path.split(".")[:-1], module)
                last = path.split(".")[-1]
                if hasattr(owner, last):
                    setattr(owner, last, self._timed(part, getattr(owner, last)))
        if module.__name__ == "jax._src.monitoring":
            module.register_event_duration_secs_listener(self._event)

    def _timed(self, part: str, function: Callable) -> Callable:
        @functools.wraps(function)
        def timed(*args: Any, **more: Any) -> Any:
            with self.part(part):
                return function(*args, **more)

        return timed

    def _event(self, event: str, seconds: float, **rest: Any) -> None:
        part = next((part for end, part in EVENTS.items() if event.endswith(end)), None)
        if part is None:
            return
        self.programs[part.split()[0].replace("compiling", "compiled or fetched")] += 1
        # Traces lie within traces: what the inner ones took was booked as they ended.
        end, own = time.perf_counter(), seconds
        before = getattr(self.local, "events", [])
        while before and before[-1][0] >= end - seconds:
            own -= before.pop()[1]
        self.local.events = [*before[-20:], (end - seconds, seconds)]
        self.add(part, own)
        if self.inner:
            self.inner[-1] += own


class _Part:
    def __init__(self, clocks: Clocks, name: str) -> None:
        self.clocks, self.name = clocks, name

    def __enter__(self) -> None:
        self.clocks.inner.append(0.0)
        self.begun = time.perf_counter()

    def __exit__(self, *error: object) -> None:
        passed = time.perf_counter() - self.begun
        inner = self.clocks.inner
        self.clocks.add(self.name, passed - inner.pop())
        if inner:
            inner[-1] += passed


class _Finder(importlib.abc.MetaPathFinder):
    """Tells of modules as they are imported."""

    def __init__(self, loaded: Callable[[ModuleType], None]) -> None:
        self.loaded = loaded

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> Any:
        if not name.startswith(("qocjax.", "hydra._internal.hydra", "jax._src.monitoring")):
            return None
        for finder in sys.meta_path:
            if finder is not self and (spec := getattr(finder, "find_spec", lambda *a: None)(name, path, target)):
                if spec.loader is not None and hasattr(spec.loader, "exec_module"):
                    spec.loader.exec_module = self._telling(spec.loader.exec_module)
                return spec
        return None

    def _telling(self, execute: Callable[[ModuleType], None]) -> Callable[[ModuleType], None]:
        def run(module: ModuleType) -> None:
            execute(module)
            self.loaded(module)

        return run
