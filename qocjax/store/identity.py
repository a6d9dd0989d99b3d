"""What makes two studies the same: their configuration, and the measured data behind it."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

__all__ = ["content_digest", "differences"]

_SHOWN = 6  # differences in a message


def content_digest(value: Any) -> str:
    """Digest of a value with all that lies in it: dataclasses, mappings, sequences, arrays, plain values."""
    digest = hashlib.blake2b(digest_size=16)
    for piece in _pieces(value):
        digest.update(piece)
    return digest.hexdigest()


def _pieces(value: Any) -> Iterator[bytes]:
    yield f"<{type(value).__name__}".encode()
    if is_dataclass(value) and not isinstance(value, type):
        for item in fields(value):
            yield item.name.encode()
            yield from _pieces(getattr(value, item.name))
    elif isinstance(value, Mapping):
        for name in sorted(value):
            yield str(name).encode()
            yield from _pieces(value[name])
    elif isinstance(value, (list, tuple)):
        for each in value:
            yield from _pieces(each)
    elif isinstance(value, np.ndarray) or hasattr(value, "__array__"):
        array = np.ascontiguousarray(value)
        yield f"{array.dtype.str}{array.shape}".encode()
        yield array.tobytes()
    elif isinstance(value, (str, bytes, int, float, type(None))):
        yield repr(value).encode()
    yield b">"


def differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Options in which two configurations differ, `name: value there, value here`; empty where they are the same."""
    old, new = dict(_flat(there)), dict(_flat(here))
    names = [name for name in dict.fromkeys([*old, *new]) if old.get(name, _flat) != new.get(name, _flat)]
    shown = [f"{name}: {_text(old, name)} there, {_text(new, name)} here" for name in names[:_SHOWN]]
    return "; ".join(shown) + (f"; and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _text(values: Mapping[str, Any], name: str) -> str:
    if name not in values:
        return "nothing"
    text = repr(values[name])
    return text if len(text) <= 60 else text[:57] + "..."
