"""The notebooks of docs/notebooks, run from top to bottom as a reader would."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def cells(notebook: Path, kind: str) -> list[str]:
    """Text of the cells of a kind."""
    content = json.loads(notebook.read_text(encoding="utf-8"))
    return ["".join(cell["source"]) for cell in content["cells"] if cell["cell_type"] == kind]


def test_there_are_five() -> None:
    assert len(NOTEBOOKS) == 5


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_outputs_are_stripped_and_code_compiles(notebook: Path) -> None:
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            assert (cell["outputs"], cell["execution_count"]) == ([], None)
            compile("".join(cell["source"]), notebook.name, "exec")
    assert cells(notebook, "markdown")[0].startswith("# ")


@pytest.mark.slow
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(notebook: Path, tmp_path: Path) -> None:
    code = "\n\n".join(cells(notebook, "code"))
    shown = "\nfor name in [name for name, value in globals().items() if hasattr(value, '_repr_html_')]:\n"
    script = tmp_path / "notebook.py"
    script.write_text(f"{code}\n{shown}    assert '<' in globals()[name]._repr_html_()\n", encoding="utf-8")
    environment = dict(os.environ, MPLBACKEND="Agg", PYTHONPATH=str(ROOT), PYTHONWARNINGS="error::DeprecationWarning")
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stderr
    assert "error:" not in done.stdout
