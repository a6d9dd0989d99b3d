"""All runs of a study as Zarr: for each sweep and metric an array over (value, deadline, seed, robot)."""

from __future__ import annotations

import importlib.util
import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qocjax.study.study import Study

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["ARRAYS", "check_arrays", "write_arrays"]

ARRAYS = "arrays.zarr"

_CHUNK_SEEDS = 4096


def check_arrays() -> None:
    """Checks that arrays can be written.

    Raises:
        ValueError: zarr is not installed.
    """
    if importlib.util.find_spec("zarr") is None:
        raise ValueError("arrays: got true without zarr, expected `pip install qocjax[arrays]`, or false")


def write_arrays(study: Study, folder: Path) -> Path:
    """Writes `arrays.zarr` with a group for each sweep, one value of the sweep at a time; whole or not at all.

    `xarray.open_zarr(folder / "arrays.zarr", group="kappa", consolidated=False)` opens a sweep.

    Args:
        study: What is written.
        folder: Where to.

    Raises:
        OSError: The folder cannot be written, or the disk is full.
    """
    import zarr

    path, temporary = folder / ARRAYS, folder / f".{ARRAYS}"
    shutil.rmtree(temporary, ignore_errors=True)
    try:
        root = zarr.create_group(temporary, zarr_format=3)
        root.attrs["configuration"] = json.dumps(study.configuration)
        for name in dict.fromkeys(study.results["sweep"]):
            _write_sweep(root.create_group(name), study.sweep(name))
        shutil.rmtree(path, ignore_errors=True)
        temporary.rename(path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return path


def _write_sweep(group: Any, runs: xr.Dataset) -> None:
    group.attrs.update({str(name): value for name, value in runs.attrs.items()})
    for name, axis in runs.coords.items():
        values = np.asarray(axis.values)
        target = group.create_array(name, shape=values.shape, dtype=values.dtype, dimension_names=axis.dims)
        target.attrs.update(axis.attrs)
        target[...] = values
    for name, metric in runs.data_vars.items():
        sizes = dict(zip(metric.dims, metric.shape, strict=True))
        shape = (1, *(min(size, _CHUNK_SEEDS) if dim == "seed" else size for dim, size in list(sizes.items())[1:]))
        target = group.create_array(
            name, shape=metric.shape, chunks=shape, dtype=metric.dtype, dimension_names=metric.dims
        )
        target.attrs.update(metric.attrs)
        for place in range(metric.shape[0]):
            target[place] = metric[place].values
