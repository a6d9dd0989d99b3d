"""Options that a command does not have: what was probably meant."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from qocjax._conf import conf_dir

__all__ = ["check_options", "unknown_option"]

_OF_FILES = ("advise", "ingest")  # commands that take `path`


def check_options(arguments: Sequence[str], command: str) -> None:
    """Checks that what is no flag is an option with a value.

    Args:
        arguments: Of the command line.
        command: What they are for.

    Raises:
        ValueError: One is not, such as a file without the option that takes it.
    """
    for argument in arguments:
        if "=" in argument or argument.startswith(("-", "~")) or not argument.strip():
            continue
        meant = f", such as path={argument}" if command in _OF_FILES and Path(argument).exists() else ""
        raise ValueError(f"command line: got {argument}, expected option=value{meant}")


def unknown_option(text: str, command: str) -> str:
    """What Hydra says of a command's options, in our words where it is of one that is not there."""
    if (found := re.match(r"Could not override '([^']+)'", text)) is None:
        return text
    name = found[1].partition("@")[0].replace("/", ".")
    last = name.rpartition(".")[2]
    known = set(_names(command))
    # Of equal ends the whole name is meant, as in `tau` for `loop.tau`; else what is spelt alike.
    near = sorted(each for each in known if each.rpartition(".")[2] == last and each != name)[:3]
    near = near or difflib.get_close_matches(name, known, 1)
    meant = f"; did you mean {' or '.join(near)}?" if near else ""
    return f"{found[1]}: got an unknown option, expected one that --help lists{meant}"


def _names(command: str) -> Iterator[str]:
    """Groups and options that a command has, of all choices."""
    import yaml

    root = Path(conf_dir())
    own = yaml.safe_load((root / f"{command}.yaml").read_text(encoding="utf-8"))
    heads = {*own, *(group for each in own["defaults"] if isinstance(each, Mapping) for group in each)}
    for name in _names_of_files(root):
        if name.partition(".")[0] in heads:
            yield name


def _names_of_files(root: Path) -> Iterator[str]:
    import yaml

    for path in root.rglob("*.yaml"):
        content = path.read_text(encoding="utf-8")
        group = path.parent.relative_to(root).as_posix()
        package = re.search(r"# @package (\S+)", content)
        prefix = package[1] if package else group.replace("/", ".")
        yield group.replace("/", ".")
        yield from _keys(yaml.safe_load(content), "" if prefix in ("_global_", ".") else f"{prefix}.")


def _keys(values: Any, prefix: str) -> Iterator[str]:
    if not isinstance(values, Mapping):
        return
    for key, value in values.items():
        if key not in ("defaults", "hydra", "help"):
            yield f"{prefix}{key}"
            yield from _keys(value, f"{prefix}{key}.")
