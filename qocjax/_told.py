"""A value told by its content, so that equal bytes mean the same program."""

from __future__ import annotations

import enum
import functools
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from types import FunctionType
from typing import Any

import jax
import numpy as np

__all__ = ["UntoldError", "told"]

_OWN = __name__.partition(".")[0]


class UntoldError(Exception):
    """Of a value that its content does not tell: code from outside, or what was made while the program ran."""


def told(value: Any) -> Iterator[bytes]:
    """All that lies in a value, with the kinds of what it lies in.

    Raises:
        UntoldError: Something in it is told by no content.
    """
    yield f"<{type(value).__module__}.{type(value).__qualname__}".encode()
    if value is None or isinstance(value, (bool, int, float, complex, str, bytes)) and not isinstance(value, enum.Enum):
        yield repr(value).encode()
    elif isinstance(value, (np.ndarray, np.generic, jax.Array)):
        if isinstance(value, jax.Array) and jax.dtypes.issubdtype(value.dtype, jax.dtypes.prng_key):
            raise UntoldError("random keys")
        array = np.ascontiguousarray(value)
        yield f"{array.dtype.str}{np.shape(value)}".encode()
        yield array.tobytes()
    elif isinstance(value, jax.tree_util.PyTreeDef):
        yield from _structure(value)
    elif isinstance(value, (type, FunctionType)):
        yield _name(value)
    elif isinstance(value, Mapping):
        for key, each in value.items():
            yield from told(key)
            yield from told(each)
    else:
        yield from _own(value)
    yield b">"


def _own(value: Any) -> Iterator[bytes]:
    """What is of the package, or of the language."""
    if hasattr(value, "told_by"):
        yield from told(value.told_by())
    elif isinstance(value, enum.Enum):
        yield _name(type(value)) + value.name.encode()
    elif isinstance(value, functools.partial):
        yield from told((value.func, value.args, value.keywords))
    elif isinstance(value, (list, tuple, range)):
        if type(value) not in (list, tuple, range):
            yield _name(type(value))
        for each in value:
            yield from told(each)
    elif is_dataclass(value):
        yield _name(type(value))
        for item in fields(value):
            yield item.name.encode()
            yield from told(getattr(value, item.name))
    else:
        raise UntoldError(f"{type(value)}")


def _name(value: Any) -> bytes:
    """Of a class or function that the source of the package tells."""
    name = f"{value.__module__}.{value.__qualname__}"
    own = value.__module__.partition(".")[0] in (_OWN, "builtins")
    if not own or "<" in name or getattr(value, "__closure__", None):
        raise UntoldError(name)
    return name.encode()


def _structure(definition: jax.tree_util.PyTreeDef) -> Iterator[bytes]:
    node = definition.node_data()
    if node is None:
        yield b"*"
        return
    kind, static = node
    yield from told((kind, static))
    for child in definition.children():
        yield from _structure(child)
    yield b"|"
