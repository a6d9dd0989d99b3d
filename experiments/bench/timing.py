"""How the benchmark suite times a call, and what it says about the machine."""

from __future__ import annotations

import os
import platform
import shutil
import statistics
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

__all__ = ["Timing", "machine", "measure"]


@dataclass(frozen=True)
class Timing:
    """Wall times of a call.

    Attributes:
        first_s: The first call, compilation included (s).
        best_s: The fastest of the calls after it (s).
        median_s: Their median (s).
    """

    first_s: float
    best_s: float
    median_s: float


def measure(call: Callable[[], object], repeats: int) -> Timing:
    """Times a call that returns when its result is ready.

    Args:
        call: What to time; a call that dispatches asynchronously must wait for its result itself.
        repeats: How often to call it after the first time, at least 1.

    Raises:
        ValueError: repeats is below 1.
    """
    if repeats < 1:
        raise ValueError(f"repeats: got {repeats}, expected 1 or more")
    first = _seconds(call)
    later = [_seconds(call) for _ in range(repeats)]
    return Timing(first, min(later), statistics.median(later))


def _seconds(call: Callable[[], object]) -> float:
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def machine() -> dict[str, str | int | float | None]:
    """What a timing depends on; None for what cannot be found out here.

    Keys: cpu, vector (widest float vectors), cores (usable by this process), l2 (per core), memory_gib, system, and the
    versions of python, jax, numpy, numba and gcc.
    """
    flags = _cpuinfo("flags") or _cpuinfo("Features") or ""
    return {
        "cpu": _cpuinfo("model name") or platform.processor() or platform.machine(),
        "vector": next((name for name in ("avx512f", "avx2", "avx", "sse2", "asimd") if name in flags.split()), None),
        "cores": _cores(),
        "l2": _l2(),
        "memory_gib": _memory_gib(),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        **{package: _version(package) for package in ("jax", "numpy", "numba")},
        "gcc": _gcc(),
    }


def _cpuinfo(key: str) -> str | None:
    """First value of a key of /proc/cpuinfo."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return None
    return next((line.split(":", 1)[1].strip() for line in lines if line.split(":", 1)[0].strip() == key), None)


def _cores() -> int | None:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


def _l2() -> str | None:
    for cache in sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*")):
        try:
            if (cache / "level").read_text().strip() == "2":
                return (cache / "size").read_text().strip()
        except OSError:
            continue
    return None


def _memory_gib() -> float | None:
    try:
        return round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30, 1)
    except (AttributeError, ValueError, OSError):
        return None


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _gcc() -> str | None:
    compiler = shutil.which("g++")
    if compiler is None:
        return None
    done = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=False)
    return done.stdout.splitlines()[0] if done.returncode == 0 and done.stdout else None
