"""What there is room for: sizes are refused before anything of that size is made."""

from __future__ import annotations

import ctypes
import functools
import os
from contextlib import suppress
from pathlib import Path

__all__ = ["check_results", "check_room", "check_runs", "give_back", "is_memory", "memory", "results_size"]

_CGROUPS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")
_STEP = 32  # bytes of a robot-step of a batch, at least: loop times, schedule and age, in and out
_RUN = 40  # bytes of the metrics of one robot's run
_MMAP_THRESHOLD, _LARGE = -3, 1 << 18  # of `mallopt`; bytes
_UNITS = {1e18: "EB", 1e15: "PB", 1e12: "TB", 1e9: "GB", 1e6: "MB"}


@functools.cache
def memory() -> int:
    """Bytes that this process may use: the machine's, or what its container or `ulimit -v` leaves it."""
    found = []
    with suppress(AttributeError, ValueError, OSError):  # of Windows
        found.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for path in _CGROUPS:
        with suppress(OSError, ValueError):  # `max` is no limit
            found.append(int(Path(path).read_text(encoding="ascii")))
    with suppress(ImportError, OSError):
        import resource

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        found += [limit] if limit != resource.RLIM_INFINITY else []
    return min((each for each in found if each > 0), default=1 << 36)


def check_room(name: str, what: str, size: float, instead: str) -> None:
    """Refuses what takes more memory than there is.

    Args:
        name: Of the option or argument, for the message.
        what: That takes it, such as `1e+12 seeds`.
        size: Bytes that it takes at least.
        instead: What needs less.

    Raises:
        ValueError: There is less.
    """
    if size > memory():
        raise ValueError(f"{name}: got {what}, which takes {_told(size)} of memory at least, expected at most the "
                         f"{_told(memory())} here: {instead}")  # fmt: skip


def check_runs(ticks: float, robots: float, lanes: float) -> None:
    """Refuses runs of so many ticks and robots, of which a batch does some seeds at once.

    Raises:
        ValueError: The smallest piece of work takes more memory than there is.
    """
    check_room("horizon, tau", f"{ticks:.4g} sampling instants of {robots:.4g} robots, on {lanes} seeds at once",
               _STEP * ticks * robots * lanes, "a longer tau, a shorter horizon, fewer robots or seeds")  # fmt: skip


def check_results(designs: float, seeds: float, robots: float) -> None:
    """Refuses so many runs whose metrics are kept together.

    Raises:
        ValueError: They take more memory than there is.
    """
    check_room("seeds, designs", f"{seeds:.4g} seeds of {designs:.4g} designs with {robots:.4g} robots",
               results_size(designs, seeds, robots), "fewer of them")  # fmt: skip


def results_size(designs: float, seeds: float, robots: float = 1) -> float:
    """Bytes of the metrics of so many runs, at least."""
    return _RUN * designs * seeds * robots


def is_memory(error: BaseException) -> bool:
    """Whether an error says that memory ran out, whoever raised it."""
    text = str(error)
    return isinstance(error, MemoryError) or any(
        word in text for word in ("RESOURCE_EXHAUSTED", "Out of memory", "out of memory", "Unable to allocate")
    )


def _told(size: float) -> str:
    for unit, name in _UNITS.items():
        if size >= unit:
            return f"{size / unit:.3g} {name}"
    return f"{size:.0f} B"


def give_back() -> None:
    """From here on, large arrays that are freed go back to the system at once, where the C library is glibc.

    It learns otherwise to keep blocks of up to 32 MB, between which lies what stays: a tenth of the memory of a program
    that computes and then draws.
    """
    with suppress(OSError, AttributeError, ValueError):
        ctypes.CDLL("libc.so.6").mallopt(_MMAP_THRESHOLD, _LARGE)
