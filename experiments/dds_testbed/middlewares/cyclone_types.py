"""The messages as Eclipse Cyclone DDS sends them."""

# No `from __future__ import annotations`: the middleware reads the types of the fields.

from dataclasses import dataclass

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int64, sequence

__all__ = ["IdlCommand", "IdlState"]


@dataclass
class IdlState(IdlStruct, typename="qocjax.State"):
    """`State`."""

    sequence: int64
    uplink_send: int64
    poses: sequence[float64]
    ages: sequence[float64]


@dataclass
class IdlCommand(IdlStruct, typename="qocjax.Command"):
    """`Command`."""

    sequence: int64
    nu: float64
    omega: float64
