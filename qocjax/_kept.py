"""Programs as an earlier run traced them.

JAX keeps what it compiled, but to find it there, a process traces and lowers again, which takes longer than all else
that a short study does. Here what was lowered is kept too, by all that tracing depends on: the shapes of arguments, the
values that a program is made for, the source of the package, versions, settings. What its content does not tell, such
as a law from outside, is traced each time.
"""

from __future__ import annotations

import functools
import hashlib
import os
import pickle
import platform
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import jax
import jax.export
import jax.numpy as jnp
import numpy as np

from qocjax._once import Once
from qocjax._source import source_digest
from qocjax._told import UntoldError, told

__all__ = ["called", "kept_in", "program"]

_folder: Path | None = None
_programs: Once[Callable[..., Any]] = Once()  # that `called` has called in this process

Compile = Callable[[jax.stages.Lowered], jax.stages.Compiled]


@contextmanager
def kept_in(folder: Path | None) -> Iterator[None]:
    """Keeps programs in a folder, of all threads of this process; for command lines, which nobody has patched."""
    global _folder
    before, _folder = _folder, folder if find_spec("flatbuffers") else None  # in which `jax.export` writes
    try:
        yield
    finally:
        _folder = before


def program(function: Callable, args: tuple, static: tuple, compile: Compile) -> Callable[..., Any]:
    """`function(*args, *static)`, compiled for arguments of these shapes.

    Args:
        function: Pure; found by its name.
        args: Pytrees of arrays; only structure, shapes and types matter.
        static: What the program is made for, hashable.
        compile: Makes the executable.

    Returns:
        What takes `args`, without `static`.
    """
    jitted: Any = _jitted(function, len(args), len(static))
    try:
        path = _path(function, args, static)
        exported, example = _read(path) or _written(path, *_exported(jitted, args, static))
    except (UntoldError, NotImplementedError, OSError, ValueError):  # no name for it, no way to write it, no room
        return compile(jitted.lower(*args, *static))
    run = compile(jax.jit(exported.call).lower(*jax.tree.leaves(args)))
    structure = jax.tree.structure(example)
    return lambda *args: jax.tree.unflatten(structure, run(*jax.tree.leaves(args)))


def called(function: Callable, args: tuple, static: tuple, compile: Compile | None = None) -> Any:
    """What `jax.jit` makes of `function(*args, *static)`; compiled once for arguments of the same shapes.

    Works under `jax.jit`, `jax.vmap` and `jax.grad`, where nothing is kept. `compile` makes the executable otherwise
    than `jax.jit` would.
    """
    leaves, structure = jax.tree.flatten(args)
    if (_folder is None and compile is None) or any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
        return _jitted(function, len(args), len(static))(*args, *static)
    shapes = tuple((np.shape(leaf), np.asarray(leaf).dtype) for leaf in leaves)
    key = (function, structure, shapes, static, compile, jnp.result_type(float), jax.config.jax_default_device)
    return _programs.get(key, lambda: program(function, args, static, compile or jax.stages.Lowered.compile))(*args)


@functools.cache
def _jitted(function: Callable, args: int, static: int) -> Callable[..., Any]:
    return jax.jit(function, static_argnums=tuple(range(args, args + static)))


def _path(function: Callable, args: tuple, static: tuple) -> Path:
    """Where a program is kept.

    Raises:
        UntoldError: Nowhere, or nothing tells it from others.
    """
    if _folder is None:
        raise UntoldError("no folder")
    leaves, structure = jax.tree.flatten(args)
    if not all(isinstance(leaf, (np.ndarray, np.generic, jax.Array, int, float)) for leaf in leaves):
        raise UntoldError("an argument that is no array")
    shapes = tuple((str(a.dtype), a.shape, a.weak_type) for a in map(jax.typeof, leaves))
    settings = {name: repr(value) for name, value in jax.config.values.items() if "cache" not in name}
    digest = hashlib.blake2b(_made_with(), digest_size=20)
    for piece in told((function, structure, shapes, static, settings, str(jnp.result_type(float)))):
        digest.update(piece)
    return _folder / f"{digest.hexdigest()}.traced"


@functools.cache
def _made_with() -> bytes:
    """Digest of the package with all its files, the versions of what traces, and the device."""
    device = jax.devices()[0]
    versions = jax.__version__, np.__version__, platform.python_version(), device.platform, source_digest()
    return hashlib.blake2b(repr(versions).encode()).digest()


def _exported(jitted: Any, args: tuple, static: tuple) -> tuple[jax.export.Exported, Any]:
    """The program between leaves, and its result with numbers for leaves, of the same structure."""
    structure = jax.tree.structure(args)
    results: list[Any] = []

    def flat(*leaves: jax.Array) -> list[jax.Array]:
        result = jitted(*jax.tree.unflatten(structure, leaves), *static)
        results.append(jax.tree.structure(result))
        return jax.tree.leaves(result)

    exported = jax.export.export(jax.jit(flat))(*jax.tree.leaves(args))
    (found,) = set(results)
    return exported, jax.tree.unflatten(found, range(found.num_leaves))


def _read(path: Path) -> tuple[jax.export.Exported, Any] | None:
    """What is kept there; None where nothing is, or nothing whole."""
    with suppress(Exception):  # of whatever is wrong with a file, the next one will not have it
        data, example = pickle.loads(path.read_bytes())
        return jax.export.deserialize(bytearray(data)), example
    return None


def _written(path: Path, exported: jax.export.Exported, example: Any) -> tuple[jax.export.Exported, Any]:
    """Writes a program, whole or not at all, and returns it."""
    try:
        data = pickle.dumps((bytes(exported.serialize()), example))
    except (AttributeError, TypeError, pickle.PicklingError) as error:
        raise ValueError(f"program: {error}") from None
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
        file.write(data)
    os.replace(file.name, path)
    return exported, example
