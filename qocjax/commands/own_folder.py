"""A folder of its own for each run of a command, unless one is named."""

from __future__ import annotations

from itertools import count
from pathlib import Path

__all__ = ["own_folder"]

_made: dict[str, str] = {}


def own_folder(named: str | None, usual: str) -> str:
    """The folder that is named, or a new one: the usual one, or with a number where another run has taken that.

    Args:
        named: What the user asks for.
        usual: Name with the time of the start in it, which two runs may share.
    """
    if named is not None:
        return named
    if usual not in _made:
        _made[usual] = next(name for k in count(1) if _is_new(name := usual if k == 1 else f"{usual}_{k}"))
    return _made[usual]


def _is_new(name: str) -> bool:
    """Makes a folder, and says whether it was not there; where none can be made, whoever writes there says so."""
    try:
        Path(name).mkdir(parents=True)
    except FileExistsError:
        return False
    except OSError:
        pass
    return True
