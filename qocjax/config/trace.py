"""Configuration of a measured trace: what is in a file, and the computing time where it holds the network alone."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from omegaconf import OmegaConf
from pydantic import Field, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from qocjax.config.delay import Computing, Delay, EdgeConfig
from qocjax.config.part import Part, conf_dir
from qocjax.config.robots import presets
from qocjax.network import ComputedTrace, Constant, DelayLaw, Network, Trace, read_trace, with_edge

if TYPE_CHECKING:
    from qocjax.recorded.run import RecordedRun

__all__ = ["TraceConfig"]


class TraceConfig(Part):
    """A measured trace, replayed in order."""

    kind: Literal["trace"]
    path: str
    column: str | None = None
    unit: str | None = None
    sequence: str | None = None
    gaps_are_lost: bool = False
    separator: str | None = None
    period: float | None = None
    stamp: str | None = None
    stamp_unit: str | None = None
    faster_than_measured: bool = False  # whether `SimulationConfig.check_rate` lets it pass
    compute: Computing = None
    edge: EdgeConfig = Field(default_factory=EdgeConfig.usual)

    @field_validator("edge")
    @classmethod
    def _has_work(cls, edge: EdgeConfig, info: ValidationInfo) -> EdgeConfig:
        if _law_of(info.data.get("compute")) is None and edge != EdgeConfig.usual():
            raise PydanticCustomError(
                "edge", "network.compute with it: a trace does not tell what of its loop times is computing"
            )
        return edge

    def build(self) -> Network:
        """The network; without a column, what is in the file.

        Raises:
            ValueError: A value is not as expected, or the file holds the network alone and nothing says what computing
                takes.
        """
        if self.column is not None:
            return self._with_computing(self._columns())
        given = [name for name in ("sequence", "separator", "stamp") if getattr(self, name) is not None]
        if given:
            raise ValueError(f"network.column: got nothing with {given[0]}, expected the name of the loop times'")
        from qocjax.recorded.as_trace import network_of

        run = self.read()
        if run.loops and not run.computed and self.compute is None:
            raise ValueError(
                f"network.compute: got nothing, but {self.path} ({run.format}) holds the network alone, not what the "
                "edge computes; expected its computing time in s: network.compute=0.02 where it always takes 20 ms, a "
                "law such as delay@network.compute=truncated_normal network.compute.mean=0.02 "
                "network.compute.std=0.005, or network.compute=0 where the times hold it already"
            )
        return self._with_computing(network_of(run, self.path, self.period), told=run.computed)

    def _with_computing(self, network: Network, told: bool = False) -> Network:
        """The network with the computing time that is given; `told` where its loops hold one already."""
        law = _law_of(self.compute)
        if law is None:
            return network
        if not isinstance(network, Trace):
            raise ValueError(f"network.compute: got a law for {self.path}, whose delay from commands to motion holds "
                             "computing already, expected null")  # fmt: skip
        if told:
            warnings.warn(f"{self.path}: its loop times hold a computation; network.compute comes on top", stacklevel=3)
        return with_edge(ComputedTrace(network, law), self.edge.build())

    def _columns(self) -> Trace:
        try:
            return self._table()
        except ValueError as error:
            from qocjax.recorded.formats import FORMATS, found_format

            kind = found_format(Path(self.path)) if "has no column" in str(error) else None
            if kind is None:
                raise
            raise ValueError(f"{error}; without network.column it is read as {FORMATS[kind].TITLE}") from None

    def _table(self) -> Trace:
        assert self.column is not None
        return read_trace(
            self.path,
            self.column,
            self.unit,
            sequence=self.sequence,
            gaps_are_lost=self.gaps_are_lost,
            separator=self.separator,
            period=self.period,
            stamp=self.stamp,
            stamp_unit=self.stamp_unit,
        )

    def read(self) -> RecordedRun:
        """What is in the file; of a bag the topics that `ingest` looks for by default."""
        from qocjax.recorded.as_trace import read_file  # what reads files is not needed where there is none
        from qocjax.recorded.topics import TopicPatterns

        found = OmegaConf.load(conf_dir() / "reading" / "default.yaml").topics
        names = ("poses", "commands", "goals", "odometry", "footprints")
        topics = TopicPatterns(**{name: tuple(found[name]) for name in names})
        try:
            return read_file(self.path, self.unit, self.gaps_are_lost, topics, presets())
        except ValueError as error:
            if "has no column" not in str(error):
                raise
            raise ValueError(f"{error}; expected a log or a table that is known, or the column of its loop times: "
                             "network.column=NAME network.unit=s") from None  # fmt: skip


def _law_of(compute: Delay | None) -> DelayLaw | None:
    """The law of a computing time; None where there is none, or it always takes no time."""
    law = None if compute is None else compute.build()
    return None if law == Constant(0.0) else law
