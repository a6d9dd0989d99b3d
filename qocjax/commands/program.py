"""The program `qocjax`: every command by its name, the question that each answers, and completion for shells.

`qocjax sweep loop.hold=zero` is `python -m qocjax.sweep loop.hold=zero`: the rest of a line is the command's own.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

from qocjax import __version__
from qocjax._conf import conf_dir
from qocjax.commands.output import steady_output
from qocjax.commands.stopping import as_program

__all__ = ["main", "program", "questions"]

_ORDER = ("sweep", "advise", "ingest", "tune", "codesign", "fleet", "qos", "show", "validate", "compare")


def program() -> None:
    """The program."""
    as_program(main)


def main() -> None:
    """Command line."""
    with steady_output():
        _run()


def _run() -> None:
    given = sys.argv[1:]
    if not given or given[0] in ("-h", "--help"):
        print(overview())
    elif given[0] == "--version":
        print(f"qocjax {__version__}")
    elif given[0] == "--completion":
        from qocjax.commands.completion import SHELLS, completion  # composes every command's options

        if len(given) != 2 or given[1] not in SHELLS:
            _refuse(f"--completion: got {' '.join(given[1:]) or 'nothing'}, expected one of {', '.join(SHELLS)}")
        print(completion(given[1], list(questions())))
    elif given[0] in _ORDER:
        sys.argv = [f"qocjax {given[0]}", *given[1:]]
        importlib.import_module(f"qocjax.{given[0]}").main()
    else:
        import difflib

        near = difflib.get_close_matches(given[0], _ORDER, 1)
        meant = f"; did you mean {near[0]}?" if near else ""
        _refuse(f"command: got {given[0]}, expected one of {', '.join(_ORDER)}{meant}")


def questions() -> dict[str, str]:
    """The question that each command answers: the first sentence of its `--help`."""
    import yaml

    found = {}
    for name in _ORDER:
        content = yaml.safe_load((Path(conf_dir()) / "help" / f"{name}.yaml").read_text(encoding="utf-8"))
        found[name] = " ".join(content["header"].split()).partition("?")[0] + "?"
    return found


def overview() -> str:
    """The commands, a line each."""
    return "\n".join([
        "Quality of control for robots that are steered from the edge over a wireless network.",
        "Usage:  qocjax COMMAND [option=value ...]",
        "",
        *(f"  {name:<10}{question}" for name, question in questions().items()),
        "",
        "qocjax COMMAND --help lists its choices and options. With qocjax sweep, the main job, begin.",
        "Completion of commands, options and choices:  source <(qocjax --completion bash)   (or zsh)",
    ])  # fmt: skip


def _refuse(text: str) -> None:
    print(f"error: {text}", file=sys.stderr)
    sys.exit(2)
