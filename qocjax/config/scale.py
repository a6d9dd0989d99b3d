"""The QoC scale that a configuration names: numbers, an earlier study, or a committed file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from qocjax._reading import read_text
from qocjax._yaml import plain
from qocjax.quality import QocScale
from qocjax.scenario import Scenario
from qocjax.store.study_folder import RECORD

__all__ = ["given_scale", "yardstick"]

_COMMITTED = Path(__file__).parent / "scales"


def given_scale(
    part: str, j_med: float | None, j_max: float | None, source: str | None, scenario: Scenario
) -> QocScale | None:
    """The scale of two numbers or of a source; None without either.

    Args:
        part: Of the configuration, for messages.
        j_med: s.
        j_max: s.
        source: Folder of a finished study, a JSON or YAML file, or the name of a committed one: `paper`.
        scenario: Whose AUC it is to be for.

    Raises:
        ValueError: Only one number is given, numbers and a source, or the source is missing, damaged or of another
            yardstick.
    """
    if (j_med is None) != (j_max is None):
        raise ValueError(f"{part}.j_med, {part}.j_max: got {j_med} and {j_max}, expected both or neither")
    if j_med is not None and j_max is not None:
        if source is not None:
            raise ValueError(f"{part}.scale: got {source} beside {part}.j_med, expected one of them")
        if j_med > j_max:
            raise ValueError(f"{part}.j_med: got {j_med:g}, the median AUC, expected at most the largest, "
                             f"{part}.j_max={j_max:g}")  # fmt: skip
        return QocScale(j_med, j_max)
    return None if source is None else _read(f"{part}.scale", source, scenario)


def yardstick(scenario: Scenario) -> dict[str, Any]:
    """What an AUC means nothing without, as plain values."""
    plain = {name: np.round(np.asarray(getattr(scenario, name), float), 9).tolist()
             for name in ("start", "goal", "weights", "nominal_kappa", "nominal_v_max")}  # fmt: skip
    fixed = ("horizon", "reference", "reference_per_robot", "normaliser")
    return plain | {name: getattr(scenario, name) for name in fixed}


def _read(option: str, source: str, scenario: Scenario) -> QocScale:
    named, path = _COMMITTED / f"{source}.yaml", Path(source)
    path = named if named.is_file() else path / RECORD if path.is_dir() else path
    if not path.is_file():
        known = ", ".join(sorted(each.stem for each in _COMMITTED.glob("*.yaml")))
        raise ValueError(f"{option}: got {source}, expected the folder of a finished study, a file, or one of {known}")
    try:
        text = read_text(path)
        found: Any = json.loads(text) if path.suffix == ".json" else plain(text)
        scale = QocScale(float(found["j_med"]), float(found["j_max"]))
    except Exception as error:  # whatever a damaged file makes its reader, or a value that is no number, raise
        raise ValueError(f"{option}: {path}: holds no j_med and j_max ({type(error).__name__})") from None
    own, other = yardstick(scenario), found.get("yardstick")
    if isinstance(other, dict):
        for name, value in own.items():
            if other.get(name) != value:
                raise ValueError(f"{option}: {path} is for {name} {other.get(name)}, got {value}, expected the same: "
                                 "another yardstick makes another AUC")  # fmt: skip
    return scale
