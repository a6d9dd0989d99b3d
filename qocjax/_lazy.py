"""What is imported when somebody asks for it: public names of a package, and what takes long of what it stands on."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Any

__all__ = ["names_of", "special", "stats"]


def names_of(
    package: str, homes: Mapping[str, tuple[str, ...]]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package (PEP 562), which finds its modules too.

    No public name may be that of a module of the package: whichever is imported last would hide the other.

    Args:
        package: Its `__name__`.
        homes: Public names by the module that has them.
    """
    found = {name: home for home, names in homes.items() for name in names}

    def get(name: str) -> Any:
        if name in found:
            value = getattr(import_module(found[name]), name)
            setattr(sys.modules[package], name, value)
            return value
        if name.isidentifier() and not name.startswith("__") and find_spec(f"{package}.{name}") is not None:
            return import_module(f"{package}.{name}")
        raise AttributeError(f"module '{package}' has no attribute '{name}'")

    return get, lambda: sorted({*vars(sys.modules[package]), *found})


def special() -> Any:
    """`scipy.special`; a quarter of what JAX takes."""
    from scipy import special

    return special


def stats() -> Any:
    """`scipy.stats`, which takes as long as JAX; a configuration needs none."""
    from scipy import stats

    return stats
