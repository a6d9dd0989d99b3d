"""The recordings of a folder, read one by one: what is wrong with one takes no other down."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from tqdm import tqdm

from qocjax.commands.command_line import unforeseen
from qocjax.recorded import RecordedRun, Rules, RunFiles, read_run

__all__ = ["read_runs"]


def read_runs(files: Sequence[RunFiles], rules: Rules, quiet: bool) -> tuple[list[RecordedRun], dict[str, str]]:
    """The runs that can be read, and by name why the others cannot."""
    found, failed = list[RecordedRun](), dict[str, str]()
    for each in tqdm(files, desc="reading", unit=" runs", file=sys.stderr, disable=True if quiet else None):
        try:
            found.append(read_run(each, rules, quiet=True))
        except Exception as error:
            failed[each.name] = str(error) if isinstance(error, (ValueError, OSError)) else unforeseen(error)
    return found, failed
