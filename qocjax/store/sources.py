"""Where code that is not of this package comes from: results hang on it as they do on measured data."""

from __future__ import annotations

import functools
import hashlib
import inspect
from pathlib import Path
from typing import Any

__all__ = ["source_of"]


def source_of(value: Any) -> dict[str, str] | None:
    """Class of a value, its file and the digest of that file as it was when first asked for; None for our own.

    What the file imports in turn is not looked at.
    """
    return _source(type(value))  # type: ignore[arg-type]


@functools.cache  # a file may change while its module is in use
def _source(kind: type) -> dict[str, str] | None:
    if kind.__module__.partition(".")[0] in (__name__.partition(".")[0], "builtins"):
        return None
    found = {"class": f"{kind.__module__}.{kind.__qualname__}"}
    try:
        path = Path(inspect.getfile(kind)).resolve()
        return found | {"file": str(path), "digest": hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest()}
    except (TypeError, OSError):  # typed in, or inside an archive
        return found
