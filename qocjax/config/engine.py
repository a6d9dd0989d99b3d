"""Configuration of engines: where the chunks of a study are computed."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from qocjax.config.part import Part

if TYPE_CHECKING:
    from qocjax.study.chunks import Engine

__all__ = ["EngineConfig"]


class LocalConfig(Part):
    """This process."""

    kind: Literal["local"]

    def open(self, note: Callable[[str], object] = lambda text: None) -> AbstractContextManager[Engine]:
        """The engine, to be used in a `with` statement."""
        from qocjax.study.engine import LocalEngine  # with what simulates

        return nullcontext(LocalEngine())


class DaskConfig(Part):
    """Dask workers."""

    kind: Literal["dask"]
    address: str | None
    workers: int | None
    cores: int | None
    retries: int | None
    oversubscribe: bool
    tls: Literal["temporary"] | None
    tls_ca: str | None
    tls_cert: str | None
    tls_key: str | None

    def open(self, note: Callable[[str], object] = lambda text: None) -> AbstractContextManager[Engine]:
        """The engine, to be used in a `with` statement.

        Args:
            note: Told of what a user should know, a line each.

        Raises:
            ValueError: Dask is not installed, or the options contradict each other.
        """
        try:
            from qocjax.cluster import DaskEngine
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] not in ("dask", "distributed"):
                raise
            raise ValueError(
                "engine: got dask without Dask, expected `pip install qocjax[cluster]`, or local"
            ) from None
        return DaskEngine(self.address, self.workers, self.cores, self.retries, note,
                          oversubscribe=self.oversubscribe, tls=self.tls, tls_ca=self.tls_ca, tls_cert=self.tls_cert,
                          tls_key=self.tls_key)  # fmt: skip


EngineConfig = Annotated[LocalConfig | DaskConfig, Field(discriminator="kind")]
