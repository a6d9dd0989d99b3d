"""Names that are imported when somebody asks for them."""

from __future__ import annotations

import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import qocjax
import qocjax.study

ROOT = Path(__file__).parents[1]
HEAVY = {"jax", "matplotlib", "numpy", "optax", "pandas", "plotly", "pydantic", "scipy", "xarray"}


def imported(code: str) -> set[str]:
    """The heavy packages that a program has imported at its end, and what it printed."""
    ask = f"{code}\nimport sys; print(*sorted({HEAVY} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", ask], cwd=ROOT, capture_output=True, text=True, check=True, timeout=60)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("package", [qocjax, qocjax.study])
def test_every_public_name_is_there_and_listed(package: object) -> None:
    for name in package.__all__:  # type: ignore[attr-defined]
        assert getattr(package, name) is not None and name in dir(package)
    with pytest.raises(AttributeError, match="has no attribute 'simulte'"):
        _ = package.simulte  # type: ignore[attr-defined]


@pytest.mark.parametrize("package", [qocjax, qocjax.study])
def test_no_module_hides_a_public_name(package: object) -> None:
    """A module binds its own name in the package when it is imported."""
    modules = {module.name for module in pkgutil.iter_modules(package.__path__)}  # type: ignore[attr-defined]
    assert not modules & set(package.__all__)  # type: ignore[attr-defined]


def test_names_come_as_they_are_whatever_was_imported_before() -> None:
    code = "import qocjax.single, qocjax.batch.evaluate, qocjax\nassert callable(qocjax.simulate), qocjax.evaluate"
    assert "jax" in imported(code)


def test_modules_are_attributes_without_an_import_of_their_own() -> None:
    assert "jax" in imported("import qocjax\nassert qocjax.network.Trace and qocjax.study.grid.Grid")


def test_importing_the_package_or_a_command_imports_nothing_that_computes() -> None:
    doors = "\n".join(f"import qocjax.{path.stem}" for path in (ROOT / "conf").glob("*.yaml"))
    assert imported("import qocjax; from qocjax import __version__") == set()
    assert imported(doors) == set()


def test_a_configuration_is_checked_without_what_draws_or_makes_tables() -> None:
    assert imported("import qocjax.config.study") == {"jax", "numpy", "pydantic"}


def test_what_has_a_door_has_its_schema_and_its_work() -> None:
    for path in (ROOT / "conf").glob("*.yaml"):
        command = importlib.import_module(f"qocjax.{path.stem}").main
        assert command.name == path.stem and command.model().model_fields
        assert callable(importlib.import_module(f"qocjax.commands.{path.stem}").main)
