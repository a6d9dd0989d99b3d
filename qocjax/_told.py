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


def told(value: Any, of_run: bool = False) -> Iterator[bytes]:
    """All that lies in a value, with the kinds of what it lies in.

    Args:
        value: Arrays, plain values, and what is made of them.
        of_run: Whether to tell also what no program is kept for: random keys, and classes and functions from outside
            the package, by their names; what their code is somebody else has to tell.

    Raises:
        UntoldError: Something in it is told by no content.
    """
    yield f"<{type(value).__module__}.{type(value).__qualname__}".encode()
    if value is None or isinstance(value, (bool, int, float, complex, str, bytes)) and not isinstance(value, enum.Enum):
        yield repr(value).encode()
    elif isinstance(value, (np.ndarray, np.generic, jax.Array)):
        if isinstance(value, jax.Array) and jax.dtypes.issubdtype(value.dtype, jax.dtypes.prng_key):
            if not of_run:
                raise UntoldError("random keys")
            value = jax.random.key_data(value)
        array = np.ascontiguousarray(value)
        yield f"{array.dtype.str}{np.shape(value)}".encode()
        yield array.tobytes()
    elif isinstance(value, jax.tree_util.PyTreeDef):
        yield from _structure(value, of_run)
    elif isinstance(value, (type, FunctionType)):
        yield _name(value, of_run)
    elif isinstance(value, Mapping):
        for key, each in value.items():
            yield from told(key, of_run)
            yield from told(each, of_run)
    else:
        yield from _own(value, of_run)
    yield b">"


def _own(value: Any, of_run: bool) -> Iterator[bytes]:
    """What is of the package, or of the language."""
    if hasattr(value, "told_by"):
        yield from told(value.told_by(), of_run)
    elif isinstance(value, enum.Enum):
        yield _name(type(value), of_run) + value.name.encode()
    elif isinstance(value, functools.partial):
        yield from told((value.func, value.args, value.keywords), of_run)
    elif isinstance(value, (list, tuple, range)):
        if type(value) not in (list, tuple, range):
            yield _name(type(value), of_run)
        for each in value:
            yield from told(each, of_run)
    elif is_dataclass(value):
        yield _name(type(value), of_run)
        for item in fields(value):
            yield item.name.encode()
            yield from told(getattr(value, item.name), of_run)
    else:
        raise UntoldError(f"{type(value)}")


def _name(value: Any, of_run: bool) -> bytes:
    """Of a class or function that the source of the package tells, or somebody else."""
    name = f"{value.__module__}.{value.__qualname__}"
    own = value.__module__.partition(".")[0] in (_OWN, "builtins")
    if not (own or of_run) or "<" in name or getattr(value, "__closure__", None):
        raise UntoldError(name)
    return name.encode()


def _structure(definition: jax.tree_util.PyTreeDef, of_run: bool) -> Iterator[bytes]:
    node = definition.node_data()
    if node is None:
        yield b"*"
        return
    kind, static = node
    yield from told((kind, static), of_run)
    for child in definition.children():
        yield from _structure(child, of_run)
    yield b"|"
