"""Tests run in float64 with strict rank promotion; measured data is read where it lies beside the project."""

from __future__ import annotations

import os
from pathlib import Path

import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the measured data; skips where it is absent."""
    folder = Path(os.environ.get("QOCJAX_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no measured data at {folder}")
    return folder
