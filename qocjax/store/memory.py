"""Results of chunks kept in memory, for studies that are not written."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

__all__ = ["InMemory", "Shelf"]


class Shelf(Protocol):
    """Where the results of chunks are kept, by the chunk's name."""

    def holds(self, name: str, description: Mapping[str, Any]) -> bool:
        """Whether the results of a chunk are there and whole."""
        ...

    def put(
        self, name: str, description: Mapping[str, Any], arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]
    ) -> None:
        """Keeps the results of a chunk."""
        ...

    def array(self, name: str, variable: str) -> np.ndarray:
        """One array of a chunk that is there."""
        ...

    def header(self, name: str) -> dict[str, Any]:
        """What is kept with a chunk that is there."""
        ...


class InMemory:
    """Keeps results as long as it lives."""

    def __init__(self) -> None:
        self._kept: dict[str, tuple[Mapping[str, np.ndarray], dict[str, Any]]] = {}

    def holds(self, name: str, description: Mapping[str, Any]) -> bool:
        """Whether a chunk is there."""
        return name in self._kept

    def put(
        self, name: str, description: Mapping[str, Any], arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]
    ) -> None:
        """Keeps the results of a chunk."""
        self._kept[name] = (arrays, dict(header))

    def array(self, name: str, variable: str) -> np.ndarray:
        """One array of a chunk that is there."""
        return self._kept[name][0][variable]

    def header(self, name: str) -> dict[str, Any]:
        """What is kept with a chunk that is there."""
        return self._kept[name][1]
