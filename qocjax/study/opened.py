"""What a command wrote, opened from its folder, without pickle and without simulating anything."""

from __future__ import annotations

import importlib.util
import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from qocjax.quality import QocScale
from qocjax.statistics.units import with_units
from qocjax.store.checked import read_array, read_checked
from qocjax.store.files import digest_of
from qocjax.store.gathered import Piece, gathered
from qocjax.store.owner import strangeness
from qocjax.store.study_folder import CHUNKS, read_record, written_by
from qocjax.study.results import Results, open_results
from qocjax.study.study import Study

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["open_study", "open_sweep"]


def open_study(folder: str | Path) -> Study | Results:
    """Opens what a command wrote: a `Study` from the folder of a sweep, `Results` from that of any other.

    Args:
        folder: That of the results.

    Raises:
        ValueError: It holds nothing finished, or a file is missing or damaged; the message names it.
    """
    other = written_by(Path(folder))
    return open_sweep(folder) if other is None else open_results(Path(folder), other)


def open_sweep(folder: str | Path) -> Study:
    """Opens what `python -m qocjax.sweep` wrote.

    Tables are read now and checked against their digests. Runs are read where they are looked at: `study.runs["auc"]`
    reads all of that metric, `study.runs.isel(design=3)` what it needs. Units and the resolved options are attributes.

    Args:
        folder: That of the study.

    Raises:
        ValueError: It holds no finished study, or a file is missing or damaged; the message names it. Runs that were
            damaged show when they are read.
    """
    folder = Path(folder)
    record = read_record(folder)
    tables = {name: _table(folder, name, record["tables"]) for name in ("results", "policies")}
    for table in tables.values():
        table.attrs["configuration"] = record["configuration"]
    parts = {part: _runs(folder, part, record) for part in ("selection", "evaluation")}
    scale = QocScale(record["j_med"], record["j_max"], record.get("j_med_se", 0.0))
    return Study(
        tables["results"], tables["policies"], scale, parts["selection"], parts["evaluation"], record["failures"],
        record["chunks"], record["made_with"], record["configuration"], record.get("network", {}),
    )  # fmt: skip


def _table(folder: Path, name: str, digests: dict[str, str]) -> pd.DataFrame:
    """A table from Parquet, exact, or from CSV where Parquet cannot be read here or was not written."""
    parquet = f"{name}.parquet"
    file = parquet if parquet in digests and importlib.util.find_spec("pyarrow") is not None else f"{name}.csv"
    path = folder / file
    if not path.is_file():
        raise ValueError(f"{path}: missing, expected a table of the study; resume={folder} writes it again")
    if digest_of(path) != digests.get(file):
        raise ValueError(
            f"{path}: damaged or changed, expected the table as it was written; resume={folder} writes it again"
        )
    if file == parquet:
        return pd.read_parquet(path)
    table = pd.read_csv(path)
    for name in table.columns.intersection(["at_edge", "error"]):  # texts that may be empty
        table[name] = table[name].astype(object).where(table[name].notna(), "")
    return table


def _runs(folder: Path, part: str, record: dict[str, Any]) -> xr.Dataset:
    """The runs of a part from its chunks."""
    names = [name for name in record["chunks"] if name.startswith(part)]
    paths = {name: folder / CHUNKS / f"{name}.npz" for name in names}
    for path in paths.values():
        if not path.is_file():
            raise ValueError(f"{path}: missing, expected a chunk of the study; resume={folder} computes it again")
    coordinates, _ = read_checked(folder / CHUNKS / f"{part}.npz")
    seeds, pieces = coordinates.pop("seed"), []
    for path in paths.values():
        header = json.loads(read_array(path, "header").tobytes())
        if strange := strangeness(header.get("owner"), record.get("owner", {})):
            raise ValueError(f"{path}: a chunk of another study ({strange}), expected the one that was written there; "
                             f"resume={folder} computes it again")  # fmt: skip
        first, last = header["chunk"]["seeds"]
        pieces.append(Piece(read_array(path, "design"), (first, last), partial(read_array, path)))
    kinds = {name: (tuple(rest), np.dtype(kind)) for name, (rest, kind) in header["kinds"].items()}
    attributes = {**header["attributes"], "configuration": json.dumps(record["configuration"])}
    runs = gathered(pieces, coordinates, seeds, kinds, attributes)
    return with_units(runs, np.array(record.get("units", {}).get(part, seeds), np.int64))
