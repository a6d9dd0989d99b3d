"""Workers on this machine, that nothing beyond it can reach."""

from __future__ import annotations

import logging
import os
from typing import TYPE_CHECKING

from distributed import LocalCluster

from qocjax import _checks
from qocjax._beside import without_interrupts
from qocjax._xla import num_workers

if TYPE_CHECKING:
    from distributed.security import Security

__all__ = ["shares", "start_local"]

# Half a gigabyte each; a worker may have several cores.
_MAX_WORKERS = 8


def start_local(
    workers: int | None,
    cores: int | None,
    retries: int | None,
    oversubscribe: bool = False,
    *,
    security: Security | None = None,
) -> tuple[LocalCluster, list[list[int]]]:
    """Starts worker processes here; scheduler and workers listen on the loopback interface alone.

    Args:
        workers: Processes; by default one per core, at most 8, and one where there is an accelerator.
        cores: Of each worker; by default an equal share.
        retries: How often a chunk whose worker died is run again; by default 3 times.
        oversubscribe: Whether there may be more workers than cores.
        security: Keys of those who may take part; None for messages in the clear, from whoever is on this machine.

    Returns:
        The cluster, and the cores of each worker by its name, 0, 1 and so on.

    Raises:
        ValueError: A number is below 1 (retries: below 0), or there are fewer cores.
    """
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")  # the driver holds no accelerator's memory
    if workers is None:
        workers = min(num_workers(), _MAX_WORKERS)
    there = _cores()
    if _checks.count("engine.workers", workers) > len(there) and not oversubscribe:
        raise ValueError(f"engine.workers: got {workers} processes of half a gigabyte, expected at most the "
                         f"{len(there)} cores here, or engine.oversubscribe=true")  # fmt: skip
    split = shares(there, workers, cores)
    failures = 3 if retries is None else _checks.count("engine.retries", retries, least=0)
    with without_interrupts():
        cluster = LocalCluster(
            n_workers=workers,
            threads_per_worker=len(split[0]),
            host="127.0.0.1",
            dashboard_address=None,
            memory_limit=0,  # Dask's limits pause and spill; a process that takes too much is left to the system
            protocol="tcp://" if security is None else "tls://",
            security=security,
            silence_logs=logging.CRITICAL,  # of the workers
            scheduler_kwargs={"allowed_failures": failures, "dashboard_address": "127.0.0.1:0"},
        )
    return cluster, split


def shares(available: list[int], workers: int, cores: int | None) -> list[list[int]]:
    """Cores for each worker: none for two, except where there are fewer cores than workers.

    Args:
        available: Numbers of the cores.
        workers: Among how many.
        cores: For each; None for an equal share.

    Raises:
        ValueError: More cores are asked for than there are.
    """
    each = max(1, len(available) // workers) if cores is None else _checks.count("engine.cores", cores)
    if cores is not None and each * workers > len(available):
        raise ValueError(
            f"engine.cores: got {each} for each of {workers} workers, expected at most {len(available)} together"
        )
    return [[available[k % len(available)] for k in range(i * each, (i + 1) * each)] for i in range(workers)]


def _cores() -> list[int]:
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))
