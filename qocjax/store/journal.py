"""Pieces of a command's work in the chunk files of its folder, many small ones in a file."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from itertools import count
from typing import Any

import numpy as np

from qocjax._once import Once
from qocjax._pieces import Arrays, kept_by
from qocjax.store.provenance import change_of, made_with
from qocjax.store.study_folder import ChunkFolder

__all__ = ["Journal", "journal"]

_OFTEN = 0.5  # s of work that a file holds at least; what a kill loses beside the piece under way
_KIND = {"kind": "pieces"}  # how a file tells itself from a chunk of a study
_OPEN = 4  # files whose content is held: pieces are asked for in the order in which they were finished, nearly


class Journal:
    """Keeps pieces by name."""

    def __init__(self, chunks: ChunkFolder, note: Callable[[str], object] = lambda text: None) -> None:
        """Finds what lies in a folder; `note` is told of what a reader should know, a line each."""
        self._chunks, self._note = chunks, note
        self._files: dict[str, str] = {}  # by piece
        self._pending: dict[str, Arrays] = {}
        self._contents: Once[dict[str, Arrays]] = Once(capacity=_OPEN)
        self._last = time.monotonic()
        self._taken: set[str] = set()  # names of files
        self._told: set[str] = set()
        self._find()

    def get(self, name: str) -> Arrays | None:
        """A piece, None where it is not there."""
        if name in self._pending:
            return self._pending[name]
        if name not in self._files:
            return None
        file = self._files[name]
        return self._contents.get(file, lambda: _unpacked(self._chunks.arrays(file), self._chunks.header(file)))[name]

    def put(self, name: str, arrays: Arrays) -> None:
        """Keeps a piece: in a file at once, or with what is finished within half a second of the last."""
        self._pending[name] = arrays
        if time.monotonic() - self._last >= _OFTEN:
            self.write()

    def unnamed(self, why: str) -> None:
        """Tells that work with such a value is not kept."""
        if why not in self._told:
            self._told.add(why)
            self._note(f"what is computed with {why} has no name, so a run that is stopped begins it again")

    def write(self) -> None:
        """Writes what is not written yet.

        Raises:
            OSError: The folder cannot be written, or the disk is full.
        """
        if self._pending:
            file = next(name for k in count(len(self._taken)) if (name := f"pieces-{k:06}") not in self._taken)
            content, pieces = _packed(self._pending)
            self._chunks.put(file, _KIND, content, pieces | {"made_with": made_with()})
            self._files |= dict.fromkeys(self._pending, file)
            self._pending.clear()
            self._taken.add(file)
        self._last = time.monotonic()

    def _find(self) -> None:
        """Looks which pieces there are; what is damaged, or another's, goes."""
        wrong, makers = [], []
        for file in self._chunks.names():
            if why := self._chunks.wrong(file, _KIND):
                wrong.append(f"{file}.npz: {why}")
                self._chunks.remove(file)
                continue
            header = self._chunks.header(file)
            makers.append(header["made_with"])
            self._files |= dict.fromkeys([name for name, _ in header["pieces"]], file)
            self._taken.add(file)
        if wrong:
            more = {1: "", 2: ", and so is 1 more file"}.get(len(wrong), f", and so are {len(wrong) - 1} more files")
            self._note(f"{self._chunks.folder}/{wrong[0]}; it is computed again{more}")
        for text in change_of([*makers, made_with()]) if makers else []:
            self._note(text)


def _packed(pieces: Mapping[str, Arrays]) -> tuple[Arrays, dict[str, Any]]:
    """Pieces laid end to end, as many are of a few runs alone, and what tells them apart."""
    forms: dict[tuple, int] = {}  # names, types and shapes of arrays, which pieces have in common
    rows = []
    for name, arrays in pieces.items():
        form = tuple((key, values.dtype.str, values.shape) for key, values in arrays.items())
        rows.append([name, forms.setdefault(form, len(forms))])
    every = [np.ascontiguousarray(values).tobytes() for arrays in pieces.values() for values in arrays.values()]
    return {"content": np.frombuffer(bytearray().join(every), np.uint8)}, {"pieces": rows, "forms": [*forms]}


def _unpacked(content: Arrays, header: Mapping[str, Any]) -> dict[str, Arrays]:
    """The pieces again."""
    data, place = content["content"].tobytes(), 0
    found: dict[str, Arrays] = {}
    for name, form in header["pieces"]:
        found[name] = {}
        for key, kind, shape in header["forms"][form]:
            values = np.frombuffer(data, kind, int(np.prod(shape)), place).reshape(shape).copy()  # aligned
            found[name][key], place = values, place + values.nbytes
    return found


@contextmanager
def journal(chunks: ChunkFolder, note: Callable[[str], object] = lambda text: None) -> Iterator[Journal]:
    """Keeps the pieces that are computed inside, and finds those of an earlier run."""
    found = Journal(chunks, note)
    try:
        with kept_by(found):
            yield found
    finally:
        found.write()
