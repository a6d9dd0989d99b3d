"""Which code this is: a digest of the package with all its files, as a version says little of a checkout."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

__all__ = ["source_digest"]


@functools.cache
def source_digest() -> str:
    """Digest of the names and the content of all files of the package."""
    digest, home = hashlib.blake2b(digest_size=16), Path(__file__).parent
    for path in sorted(home.rglob("*")):
        if path.is_file() and path.suffix != ".pyc":
            digest.update(f"{path.relative_to(home)}:{path.stat().st_size}:".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()
