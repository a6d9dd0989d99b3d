"""Configuration of a command that goes on where it was stopped."""

from __future__ import annotations

from typing import Any, ClassVar

from qocjax.config.part import Part

__all__ = ["KeptConfig"]


class KeptConfig(Part):
    """Options of a command whose work is kept in its folder, piece by piece."""

    resume: str | None

    # Options that change nothing in the results, so that work may go on with others.
    free: ClassVar[tuple[str, ...]] = ("engine", "figures", "report", "arrays", "resume", "nav2")

    def identity(self) -> dict[str, Any]:
        """The options that results depend on."""
        return self.model_dump(exclude=set(self.free))
