"""Chunks as one labelled dataset that is read where it is looked at."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from xarray.core import indexing

from qocjax.units import unit_of

__all__ = ["Piece", "gathered", "worked_out"]

_DIMS = ("design", "seed", "robot")


@dataclass(frozen=True)
class Piece:
    """The results of a chunk, and their place in the whole."""

    designs: np.ndarray  # ascending places
    seeds: tuple[int, int]  # first and one past the last place
    read: Callable[[str], np.ndarray]  # an array by name, [designs, seeds] or [designs, seeds, N]


class _Pieces(xr.backends.BackendArray):
    """One metric over all chunks; NaN (False for flags) where a chunk is missing."""

    def __init__(self, name: str, pieces: Sequence[Piece], shape: tuple[int, ...], dtype: np.dtype) -> None:
        self.name, self.shape, self.dtype = name, shape, dtype
        self._by_designs: dict[bytes, list[Piece]] = {}
        for piece in pieces:
            self._by_designs.setdefault(piece.designs.tobytes(), []).append(piece)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> np.ndarray:
        support = indexing.IndexingSupport.OUTER
        return indexing.explicit_indexing_adapter(key, self.shape, support, self._read)

    def _read(self, key: tuple[Any, ...]) -> np.ndarray:
        rows, columns, *robots = (np.arange(length)[at] for at, length in zip(key, self.shape, strict=True))
        wanted_rows, wanted_columns = np.atleast_1d(rows), np.atleast_1d(columns)
        fill = np.nan if self.dtype.kind == "f" else 0
        found = np.full((len(wanted_rows), len(wanted_columns), *self.shape[2:]), fill, self.dtype)
        for pieces in self._by_designs.values():
            into, of = _common(wanted_rows, pieces[0].designs)
            for piece in pieces if len(into) else []:
                inside = np.flatnonzero((wanted_columns >= piece.seeds[0]) & (wanted_columns < piece.seeds[1]))
                if len(inside):
                    values = piece.read(self.name)
                    found[np.ix_(into, inside)] = values[np.ix_(of, wanted_columns[inside] - piece.seeds[0])]
        shape = (*np.shape(rows), *np.shape(columns), *self.shape[2:])
        return found.reshape(shape)[(..., *key[2:])] if robots else found.reshape(shape)


class _WorkedOut(xr.backends.BackendArray):
    """What follows value by value from a variable, worked out where it is looked at."""

    def __init__(self, source: xr.Variable, function: Callable[[np.ndarray], np.ndarray], dtype: np.dtype) -> None:
        self.source, self.function, self.shape, self.dtype = source, function, source.shape, dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> np.ndarray:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._read)

    def _read(self, key: tuple[Any, ...]) -> np.ndarray:
        return np.asarray(self.function(self.source[key].values), self.dtype)


def worked_out(source: xr.Variable, function: Callable[[np.ndarray], np.ndarray], unit: str) -> xr.Variable:
    """A variable that follows from another, and like it is read where it is looked at.

    Args:
        source: Of any shape.
        function: Values from values, one by one.
        unit: Of the result.
    """
    lazy = indexing.LazilyIndexedArray(_WorkedOut(source, function, source.dtype))
    return xr.Variable(source.dims, lazy, {"units": unit})


def _common(wanted: np.ndarray, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where in `wanted` the places lie that are held, and where in `held` they are."""
    at = np.minimum(np.searchsorted(held, wanted), len(held) - 1)
    into = np.flatnonzero(held[at] == wanted)
    return into, at[into]


def gathered(
    pieces: Sequence[Piece],
    designs: Mapping[str, np.ndarray],
    seeds: Sequence[int] | np.ndarray,
    kinds: Mapping[str, tuple[tuple[int, ...], np.dtype]],
    attributes: Mapping[str, Any],
) -> xr.Dataset:
    """Labels the results of chunks: metrics over (design, seed, robot) or (design, seed) with their units.

    Nothing is read before it is looked at; a part of a metric reads the chunks that it lies in.

    Args:
        pieces: The chunks that are there.
        designs: Values of the designs, each [G].
        seeds: [S] Monte Carlo seeds.
        kinds: For each metric what follows [design, seed] in its shape, and its type.
        attributes: Of the whole.
    """
    variables = {}
    for name, (rest, dtype) in kinds.items():
        shape = (len(next(iter(designs.values()))), len(seeds), *rest)
        lazy = indexing.LazilyIndexedArray(_Pieces(name, pieces, shape, dtype))
        variables[name] = xr.Variable(_DIMS[: len(shape)], lazy, {"units": unit_of(name)})
    coordinates = {name: ("design", values, {"units": unit_of(name)}) for name, values in designs.items()}
    return xr.Dataset(variables, coordinates | {"seed": np.asarray(seeds, np.int64)}, dict(attributes))
