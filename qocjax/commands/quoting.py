"""Values of options as the user typed them: what Hydra's grammar would take apart is put in quotes for it."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # Hydra is imported once a program can be stopped in one line
    from hydra.core.override_parser.overrides_parser import OverridesParser

__all__ = ["PATHS", "as_options", "quoted_options"]

PATHS = ("path", "map", "file", "resume", "dir")
"""Last words of options that name files and folders; a `~` at their beginning is the user's home."""

_OPTION = re.compile(r"(\+{0,2}[\w./@][\w./@-]*)=(.*)", re.DOTALL)  # not Hydra's own flags: --config-dir=...


def quoted_options(arguments: Sequence[str]) -> list[str]:
    """Puts the values in quotes that would not come through otherwise.

    Those are names of files and folders that Hydra would take for something else (`~`, `#`, `=`, brackets, commas,
    letters beyond ASCII, numbers), and any other value that it cannot parse. Interpolations, null, what is in quotes,
    and lists of a sweep (`--multirun`) stay as they are.

    Args:
        arguments: Of a command line, without the program.
    """
    from hydra.core.override_parser.overrides_parser import OverridesParser

    parser = OverridesParser.create()
    many = any(each in ("-m", "--multirun") for each in arguments)
    return [_quoted(each, parser, many) for each in arguments]


def _quoted(argument: str, parser: OverridesParser, many: bool) -> str:
    found = _OPTION.fullmatch(argument)
    if found is None:
        return argument
    name, value = found.groups()
    if name.split(".")[-1].lstrip("+") in PATHS:
        value = _at_home(value)
        if _is_name(value) and not (many and "," in value) and _parsed(f"{name}={value}", parser) != value:
            return f"{name}={_in_quotes(value)}"
        return f"{name}={value}"
    if value.startswith("["):
        value = re.sub(r"(?<=[\[,'\"])~(?=/)", lambda _: os.path.expanduser("~"), value)
        argument = f"{name}={value}"
    if _parsed(argument, parser) is None and not value.startswith(("'", '"')):
        return f"{name}={_in_quotes(value)}"
    return argument


def _at_home(value: str) -> str:
    """Without a `~` at the beginning, in quotes or not, where there is such a home."""
    mark = value[:1] if value[:1] in ("'", '"') else ""
    return mark + os.path.expanduser(value[len(mark) :])


def _is_name(value: str) -> bool:
    return bool(value) and "${" not in value and value not in ("null", "???") and value[0] not in ("'", '"')


def _parsed(argument: str, parser: OverridesParser) -> object:
    """What Hydra makes of a value; None where it cannot parse it."""
    from hydra.core.override_parser.types import QuotedString
    from hydra.errors import HydraException

    try:
        found = parser.parse_override(argument)
        value = found.value()
    except (HydraException, ValueError, RecursionError):
        return None
    return value.text if isinstance(value, QuotedString) else value if value is not None else "null"


def _in_quotes(value: str) -> str:
    return "'" + re.sub(r"(\\*)('|$)", lambda m: 2 * m[1] + ("\\'" if m[2] else ""), value) + "'"


def as_options(arguments: Sequence[str]) -> list[str]:
    """Arguments as options: folders that are named without `studies=` become that list."""
    folders = [each for each in arguments if not each.startswith("-") and ("=" not in each or os.path.isdir(each))]
    others = [each for each in arguments if each not in folders]
    return [*others, f"studies=[{','.join(map(_as_it_is, folders))}]"] if folders else others


def _as_it_is(text: str) -> str:
    """A text that Hydra takes as it is."""
    body = re.sub(r'\\*("|$)', lambda found: found[0].replace("\\", "\\\\").replace('"', '\\"'), text)
    body = body.replace("${", "\\${")
    return f'"{body}"'
