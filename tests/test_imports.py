"""Imports go one way, those in functions and for type checkers too, by the layers that `pyproject.toml` states."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("importlinter", reason="import-linter is not installed")

ROOT = Path(__file__).parents[1]


def linted(folder: Path) -> subprocess.CompletedProcess[str]:
    """What `lint-imports` says of the package in a folder."""
    code = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), *sys.path])}
    return subprocess.run(
        [sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, encoding="utf-8"
    )


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    shutil.copytree(
        ROOT / "qocjax", tmp_path / "qocjax", ignore=lambda _, names: [n for n in names if n == "__pycache__"]
    )
    return tmp_path


def test_imports_go_one_way_and_in_no_circle() -> None:
    done = linted(ROOT)
    assert done.returncode == 0, done.stdout
    assert "2 kept, 0 broken" in done.stdout


CIRCLES = {
    "between packages": ("study/chunks.py", "from qocjax.config import StudyConfig\n", "2 broken"),
    "in a function": ("network/edge.py", "def late():\n    from qocjax.single import Run\n", "2 broken"),
    "for type checkers": (
        "controllers/apf.py",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from qocjax.closed_loop import Plan\n",
        "2 broken",
    ),
    "within a package": (
        "navigation/gather.py",
        "def late():\n    from qocjax.navigation.stack import open_floor\n",
        "1 broken",
    ),
}


@pytest.mark.parametrize("case", CIRCLES)
def test_a_circle_is_found(case: str, copy: Path) -> None:
    file, added, told = CIRCLES[case]
    path = copy / "qocjax" / file
    path.write_text(path.read_text(encoding="utf-8") + added, encoding="utf-8")
    done = linted(copy)
    assert done.returncode == 1 and told in done.stdout, done.stdout


def test_a_new_module_has_to_find_its_place(copy: Path) -> None:
    (copy / "qocjax" / "elsewhere.py").write_text("", encoding="utf-8")
    done = linted(copy)
    assert done.returncode == 1 and "elsewhere" in done.stdout, done.stdout
