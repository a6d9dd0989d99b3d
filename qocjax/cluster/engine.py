"""The engine that has chunks computed by Dask workers, here or on other machines."""

from __future__ import annotations

import gc
import json
import logging
import math
import time
import uuid
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import TYPE_CHECKING, Any

from distributed import Client, Future, LocalCluster
from distributed.scheduler import KilledWorker

from qocjax.cluster.local import start_local
from qocjax.cluster.secure import security_of
from qocjax.cluster.worker import Recipe, Settings, run_chunk, settings_here
from qocjax.study.chunks import Chunk, Failure, Result
from qocjax.study.engine import failure_of
from qocjax.study.problem import Problem

if TYPE_CHECKING:
    from distributed.security import Security

__all__ = ["DaskEngine"]

# Chunks handed to the scheduler for each core: so many that no worker waits for the driver, so few that neither the
# scheduler nor a worker holds results in number.
_AHEAD = 3

_LOGGERS = ("distributed", "distributed.client")  # those with levels of their own

_TOGETHER = 16  # results fetched at once

_LOOK = 2.0  # s between looks at the cluster while nothing comes back

_CONNECT = 10  # s

_LOST = "engine: the connection to the scheduler is lost; finished chunks stay, and resume goes on with them"


class DaskEngine:
    """Computes chunks on a cluster; to be closed, or used in a `with` statement.

    Only options and descriptions of chunks are sent to workers, and results come back; the driver alone writes files. A
    chunk whose worker dies is run again elsewhere. One that several workers died of is tried once more at the end, on
    its own, since which of the chunks in a worker brought it down nobody can tell; then it is a failure.

    A program that starts workers must be guarded by `if __name__ == "__main__"`, as with any spawned process.
    """

    def __init__(
        self,
        address: str | None = None,
        workers: int | None = None,
        cores: int | None = None,
        retries: int | None = None,
        note: Callable[[str], object] = lambda text: None,
        *,
        oversubscribe: bool = False,
        tls: str | None = None,
        tls_ca: str | None = None,
        tls_cert: str | None = None,
        tls_key: str | None = None,
    ) -> None:
        """Nothing is started before the first chunk.

        Args:
            address: Of a Dask scheduler, such as tcp://10.0.0.1:8786; None starts workers on this machine.
            workers: Worker processes on this machine; by default one per core, at most 8, and one on an accelerator.
            cores: Of each of them; by default an equal share.
            retries: How often a chunk whose worker died is run again; by default 3 times.
            note: Told of what a user should know, a line each.
            oversubscribe: Whether there may be more workers than cores.
            tls: `temporary` has all messages encrypted, between those alone who know keys that are made for this run.
            tls_ca: File of the authority whose certificates count, in PEM, with `tls_cert` and `tls_key`.
            tls_cert: File with the certificate of whoever takes part.
            tls_key: File with its private key.

        Raises:
            ValueError: Both an address and options of workers on this machine, or what `security_of` raises.
        """
        for name, value in (("workers", workers), ("cores", cores), ("retries", retries)):
            if address is not None and value is not None:
                raise ValueError(
                    f"engine.{name}: got {value} beside engine.address, expected null: that cluster has its own"
                )
        if address is not None and tls is not None:
            raise ValueError(f"engine.tls: got {tls} beside engine.address, expected that cluster's own certificates "
                             "(engine.tls_ca, tls_cert, tls_key), or null")  # fmt: skip
        self._security = security_of(tls, tls_ca, tls_cert, tls_key)
        self._address, self._local, self._note = address, (workers, cores, retries, oversubscribe), note
        self._cluster: LocalCluster | None = None
        self._client: Client | None = None
        self._pinned: tuple[tuple[int, ...], ...] = ()
        self._levels: dict[str, int] = {}

    def __enter__(self) -> DaskEngine:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def run(self, problem: Problem, chunks: Sequence[Chunk]) -> Generator[tuple[Chunk, Result | Failure], None, None]:
        """Yields each chunk when it is finished.

        Raises:
            ValueError: The problem has no configuration to build it from elsewhere, or what `evaluate` raises.
            OSError: The scheduler cannot be reached, or is gone.
        """
        if not chunks:
            return
        if problem.configuration is None or problem.rebuilt is None:
            raise ValueError("problem: got one without its configuration, expected one that workers can build again")
        client = self._connected()
        recipe = Recipe(problem.rebuilt, json.dumps(problem.configuration), problem.data())
        flight = _Flight(client, partial(_submit, client, recipe, settings_here(self._pinned)), self._note)
        suspects: list[Chunk] = []
        try:
            for chunk, result in flight.run(chunks):
                if isinstance(result, KilledWorker):
                    suspects.append(chunk)
                else:
                    yield chunk, result
            for suspect in suspects:
                for chunk, result in flight.run([suspect]):
                    yield chunk, _killed(result) if isinstance(result, KilledWorker) else result
        finally:
            flight.cancel()

    def close(self) -> None:
        """Ends workers on this machine, or the connection to those elsewhere."""
        client, cluster, self._client, self._cluster = self._client, self._cluster, None, None
        if client is not None:
            if client.status == "running":
                client.unsubscribe_topic("all")
            client.close()
        if cluster is not None:
            cluster.close()
        for name, level in self._levels.items():
            logging.getLogger(name).setLevel(level)
        self._levels = {}

    def _connected(self) -> Client:
        if self._client is None:
            self._silence()
            if self._address is None:
                self._cluster, cores = start_local(*self._local, security=self._security)
                self._pinned = tuple(map(tuple, cores))
            self._client = _client(self._cluster or self._address, self._security)
            self._client.subscribe_topic("all", self._tell)
        return self._client

    def _silence(self) -> None:
        """Keeps Dask's log from the terminal until this is closed: `note` tells what matters."""
        for name in _LOGGERS:
            logger = logging.getLogger(name)
            self._levels[name] = logger.level
            logger.setLevel(logging.CRITICAL)

    def _tell(self, event: tuple[float, Any]) -> None:
        """Says which workers are lost."""
        what = event[1]
        if isinstance(what, dict) and what.get("action") == "remove-worker" and not what.get("expected"):
            if self._client is not None and what.get("processing-tasks"):
                self._note(f"worker {what['worker']} is gone; what it had under way is run again elsewhere")


class _Flight:
    """Chunks under way."""

    def __init__(self, client: Client, submit: Callable[[Chunk], Future], note: Callable[[str], object]) -> None:
        self._client, self._submit, self._note = client, submit, note
        self._pending: dict[Any, tuple[Future, Chunk]] = {}
        self._done: SimpleQueue[Future] = SimpleQueue()
        self._room, self._looked, self._told = 0, -math.inf, False

    def run(self, chunks: Sequence[Chunk]) -> Iterator[tuple[Chunk, Result | Failure | KilledWorker]]:
        """Yields each chunk when it is finished, with its result or what its workers died of."""
        source = iter(chunks)
        self._top_up(source)
        while self._pending:
            for future, outcome in _outcomes(self._client, self._finished()):
                _, chunk = self._pending.pop(future.key)
                future.release()
                self._top_up(source)
                yield chunk, outcome

    def cancel(self) -> None:
        """Calls back what is under way."""
        futures = [future for future, _ in self._pending.values()]
        self._pending.clear()
        if futures and self._client.status == "running":
            self._client.cancel(futures, force=True)

    def _top_up(self, source: Iterator[Chunk]) -> None:
        """Hands over chunks while there is room; the cluster may have grown or shrunk."""
        if time.monotonic() > self._looked + _LOOK:
            self._room, self._looked = _AHEAD * max(1, sum(self._client.nthreads().values())), time.monotonic()
        while len(self._pending) < self._room:
            chunk = next(source, None)
            if chunk is None:
                return
            future = self._submit(chunk)
            self._pending[future.key] = (future, chunk)
            future.add_done_callback(self._done.put)

    def _finished(self) -> list[Future]:
        """Waits for a chunk, and takes what else is finished, up to a few."""
        found: list[Future] = []
        while not found:
            try:
                found.append(self._done.get(timeout=_LOOK))
                while len(found) < _TOGETHER:
                    found.append(self._done.get_nowait())
            except Empty:
                self._check()
        return found

    def _check(self) -> None:
        """Whether anything can still come.

        Raises:
            OSError: The connection to the scheduler is lost.
        """
        if self._client.status != "running" or any(future.cancelled() for future, _ in self._pending.values()):
            raise OSError(_LOST)
        if not self._client.nthreads() and not self._told:
            self._told = True
            self._note("no worker is there: waiting for one")


def _client(cluster: LocalCluster | str | None, security: Security | None) -> Client:
    try:
        return Client(cluster, set_as_default=False, timeout=_CONNECT, security=security)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        text = " ".join(str(error).split())
    # A client that came to nothing closes itself where it is collected; later that may be inside a lock of the next
    # client, which would then wait for itself.
    gc.collect()
    raise ValueError(
        f"engine.address: got {cluster}, expected a Dask scheduler that answers, such as tcp://host:8786 ({text})"
    )


def _submit(client: Client, recipe: Recipe, settings: Settings, chunk: Chunk) -> Future:
    # A key of its own for each attempt: the scheduler remembers which keys it lost workers by.
    key = f"{chunk.name}-{uuid.uuid4().hex}"
    return client.submit(run_chunk, recipe, chunk, settings, key=key, pure=False)


def _outcomes(client: Client, futures: Sequence[Future]) -> Iterator[tuple[Future, Result | Failure | KilledWorker]]:
    """The results of finished chunks, fetched together where nothing went wrong."""
    found: dict[Any, Result | Failure] = {}
    if all(future.status == "finished" for future in futures):
        with suppress(Exception):  # a worker died since; what it was then shows below
            found = dict(zip([future.key for future in futures], client.gather(list(futures)), strict=True))
    for future in futures:
        yield future, found.pop(future.key) if future.key in found else _outcome(future)


def _outcome(future: Future) -> Result | Failure | KilledWorker:
    """The result of a finished chunk.

    Raises:
        ValueError: The problem is wrong, or the worker lacks a package.
        OSError: The connection to the scheduler is lost.
    """
    try:
        return future.result()
    except KilledWorker as error:
        return error
    except (ValueError, TypeError):
        raise
    except ImportError as error:
        raise ValueError(
            f"engine.address: got a worker without {error.name}, expected qocjax in its environment"
        ) from None
    except Exception as error:
        if future.cancelled():
            raise OSError(_LOST) from None
        return failure_of(error)


def _killed(error: KilledWorker) -> Failure:
    last = error.last_worker
    return Failure(f"KilledWorker: {error.allowed_failures + 1} workers died of it, the last {last.address}")
