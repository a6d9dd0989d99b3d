"""What Python 3.14 asks of the command line, shown on older versions as well."""

from __future__ import annotations

import argparse
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from hydra._internal.hydra import Hydra
from hydra._internal.utils import get_args_parser
from packaging.requirements import Requirement

from qocjax._conf import hydra_base
from qocjax.commands.command_line import _compose_once

ROOT = Path(__file__).parents[1]
INSTALLED = version("hydra-core")


def required_by(python: str) -> Requirement:
    """What the project asks of Hydra on a version of Python."""
    texts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    found = [Requirement(text) for text in texts if text.startswith("hydra-core")]
    (one,) = [each for each in found if each.marker is None or each.marker.evaluate({"python_version": python})]
    return one


@pytest.fixture
def argparse_of_314(monkeypatch: pytest.MonkeyPatch) -> None:
    """`argparse` looks for a `%` in the help of each option that is added, which so has to be a text."""
    usual = argparse.ArgumentParser.add_argument

    def add(self: argparse.ArgumentParser, *names: str, **options: Any) -> argparse.Action:
        action = usual(self, *names, **options)
        self._check_help(action)  # type: ignore[attr-defined]
        return action

    def check(self: argparse.ArgumentParser, action: argparse.Action) -> None:
        assert not action.help or "%" not in action.help or action.help % vars(action)

    monkeypatch.setattr(argparse.ArgumentParser, "_check_help", check, raising=False)
    monkeypatch.setattr(argparse.ArgumentParser, "add_argument", add)
    monkeypatch.setattr(sys, "version_info", (3, 14, 0, "final", 0))


def test_hydra_for_314_gets_by_its_argparse(argparse_of_314: None) -> None:
    if required_by("3.14").specifier.contains(INSTALLED, prereleases=True):
        get_args_parser()
    else:  # the reason why another is asked for there
        with pytest.raises(TypeError, match="LazyCompletionHelp"):
            get_args_parser()


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13", "3.14"])
def test_one_hydra_for_each_python(python: str) -> None:
    first, beyond = ("1.4.0", "1.5.0") if python == "3.14" else ("1.3.8", "1.4.0")
    assert required_by(python).specifier.contains(first) and not required_by(python).specifier.contains(beyond)


def test_a_hydra_that_finds_its_mode_otherwise_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def get_mode(self: Hydra, config_name: str | None, overrides: list[str], parsed_overrides: Any = None) -> None:
        """As Hydra 1.4 has it."""

    monkeypatch.setattr(Hydra, "get_mode", get_mode)
    _compose_once()
    assert Hydra.get_mode is get_mode


def test_hydra_is_told_of_a_base_version_only_where_it_wants_one() -> None:
    assert bool(hydra_base()) == INSTALLED.startswith("1.3.")
