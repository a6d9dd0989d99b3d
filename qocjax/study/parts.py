"""Runs one part of a study: what is missing is computed and kept at once, what is there is not computed again."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from qocjax.store.gathered import Piece, gathered
from qocjax.store.memory import Shelf
from qocjax.study.chunks import Chunk, Engine, Failure, Part, Result, plan
from qocjax.study.problem import Problem

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["PartRuns", "run_part"]


@dataclass(frozen=True)
class PartRuns:
    """The runs of a part: read from the chunks where they are looked at."""

    runs: xr.Dataset  # metrics over (design, seed, robot); NaN where a chunk failed
    chunks: Sequence[Chunk]  # that are there
    failures: Mapping[str, str]  # cause by the name of the chunk
    failed: Mapping[int, str]  # cause by the place of the design
    made_with: tuple[Mapping[str, str], ...]  # distinct ones of the chunks
    shelf: Shelf

    @property
    def names(self) -> list[str]:
        """Names of the chunks that are there."""
        return [chunk.name for chunk in self.chunks]

    def arrays(self, name: str) -> Iterator[np.ndarray]:
        """One metric, a chunk at a time."""
        for chunk in self.chunks:
            yield self.shelf.array(chunk.name, name)


def run_part(
    problem: Problem,
    part: Part,
    shelf: Shelf,
    engine: Engine,
    chunk_steps: float,
    progress: Callable[[int], object] = lambda steps: None,
) -> PartRuns:
    """Computes what the shelf does not hold yet.

    Args:
        problem: What is simulated.
        part: Which part of it.
        shelf: Where results of chunks are kept.
        engine: What computes them.
        chunk_steps: Robot-steps of a chunk.
        progress: Called with the robot-steps of each chunk.

    Raises:
        ValueError: Every chunk failed, or what `evaluate` raises.
        OSError: Results cannot be written.
    """
    chunks = plan(problem, part, chunk_steps)
    values = {name: np.asarray(array, np.float64) for name, array in part.values(problem).values().items()}
    missing = [chunk for chunk in chunks if not shelf.holds(chunk.name, chunk.describe())]
    absent = {chunk.name for chunk in missing}
    for chunk in chunks:
        if chunk.name not in absent:
            progress(chunk.steps)
    _put_coordinates(part, values, shelf)
    failures: dict[str, str] = {}
    with closing(engine.run(problem, missing)) as results:
        for chunk, result in results:
            if isinstance(result, Failure):
                failures[chunk.name] = result.cause
            else:
                shelf.put(chunk.name, chunk.describe(), _arrays(chunk, result), _header(result))
            progress(chunk.steps)
    there = [chunk for chunk in chunks if chunk.name not in failures]
    if not there:
        raise ValueError(f"{part.name}: all {len(chunks)} chunks failed, the first with {failures[chunks[0].name]}")
    return _together(problem, part, values, chunks, there, failures, shelf)


def _put_coordinates(part: Part, values: Mapping[str, np.ndarray], shelf: Shelf) -> None:
    """Keeps what the places of designs and seeds in the part's chunks stand for."""
    arrays = {**values, "seed": np.array(part.seeds, np.int64)}
    described = {"part": part.name, "designs": len(values["tau"]), "seeds": len(part.seeds)}
    shelf.put(part.name, described, arrays, {})


def _arrays(chunk: Chunk, result: Result) -> dict[str, np.ndarray]:
    """What is kept of a chunk: with its metrics the places of its designs, and its seeds."""
    seeds = np.array(chunk.part.seeds[slice(*chunk.seeds)], np.int64)
    return {**result.values, "design": np.array(chunk.designs, np.int64), "seed": seeds}


def _header(result: Result) -> dict[str, object]:
    kinds = {name: [list(array.shape[2:]), array.dtype.str] for name, array in result.values.items()}
    return {"kinds": kinds, "attributes": result.attributes, "made_with": result.made_with}


def _together(
    problem: Problem,
    part: Part,
    values: Mapping[str, np.ndarray],
    chunks: Iterable[Chunk],
    there: Sequence[Chunk],
    failures: Mapping[str, str],
    shelf: Shelf,
) -> PartRuns:
    places: dict[tuple[int, ...], np.ndarray] = {}  # of the chunks that share them
    pieces = [
        Piece(places.setdefault(chunk.designs, np.array(chunk.designs)), chunk.seeds, partial(shelf.array, chunk.name))
        for chunk in there
    ]
    header = shelf.header(there[0].name)
    kinds = {name: (tuple(rest), np.dtype(kind)) for name, (rest, kind) in header["kinds"].items()}
    attributes = dict(header["attributes"])
    if problem.configuration is not None:
        attributes["configuration"] = json.dumps(problem.configuration)
    runs = gathered(pieces, values, part.seeds, kinds, attributes)
    failed = {k: failures[chunk.name] for chunk in chunks if chunk.name in failures for k in chunk.designs}
    made_with = {json.dumps(shelf.header(chunk.name)["made_with"], sort_keys=True) for chunk in there}
    return PartRuns(runs, there, failures, failed, tuple(json.loads(text) for text in sorted(made_with)), shelf)
