"""What ends a command: errors that a check foresaw, memory that ran out, and everything else."""

from __future__ import annotations

import dis
import re
from pathlib import Path
from types import TracebackType

from qocjax._room import is_memory, memory

__all__ = ["is_foreseen", "memory_text"]

_PACKAGE = str(Path(__file__).parents[1])
_RAISE = dis.opmap["RAISE_VARARGS"]
_NAMING = ("omegaconf", "hydra")  # whose errors name the option, as the system's name the file
_OURS = re.compile(r": got |\bexpected ")  # how a check says it


def is_foreseen(error: BaseException) -> bool:
    """Whether a check of ours tells it: not what Python or a library says of code that met what it was not made for."""
    if isinstance(error, OSError) or type(error).__module__.partition(".")[0] in _NAMING:
        return True
    if not isinstance(error, (ValueError, TypeError)):
        return False
    return bool(_OURS.search(str(error))) or _is_raised_here(error.__traceback__)


def memory_text(error: BaseException) -> str | None:
    """A line where memory ran out; None where it did not."""
    if not is_memory(error):
        return None
    said = " ".join(str(error).split())[:200]
    return (f"memory: got {said or 'more than there is'}, expected what fits into the {memory() / 1e9:.3g} GB here: "
            "fewer designs, seeds or robots, a longer loop.tau or a shorter horizon take less")  # fmt: skip


def _is_raised_here(traceback: TracebackType | None) -> bool:
    """Whether a `raise` of the package made it."""
    if traceback is None:
        return False
    while traceback.tb_next is not None:
        traceback = traceback.tb_next
    code = traceback.tb_frame.f_code
    return code.co_filename.startswith(_PACKAGE) and code.co_code[traceback.tb_lasti] == _RAISE
