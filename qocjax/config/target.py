"""A class from outside by its full name, and a law made of one: what may be wrong with it, in one line each."""

from __future__ import annotations

import functools
import importlib
import inspect
import json
from types import ModuleType
from typing import Any

from qocjax.controllers import Controller
from qocjax.controllers.trial import failure_text
from qocjax.store.sources import source_of
from qocjax.tunables import CONTINUOUS

__all__ = ["GAINS", "class_of", "law_of"]

GAINS = ("kappa", "eta", "gamma", "c_miss", "d_safe")  # values of a design that a law has in its configuration

_MEMBERS = [name for name in vars(Controller) if not name.startswith("_")]
_METHODS = [name for name in _MEMBERS if inspect.isfunction(vars(Controller)[name])]
_EXPECTED = "expected a subclass of qocjax.controllers.Law, or all that Controller there has"
_OPTION = "controller._target_"


@functools.cache  # programs are kept by the law, which need not compare equal to one made again
def law_of(target: str, arguments: str) -> Controller:
    """Makes a law.

    Args:
        target: Full name of its class; the module is imported.
        arguments: Of the class by name, as JSON; lists become tuples.

    Raises:
        ValueError: There is no such class, it is no controller, or it does not take the arguments.
    """
    kind = _law_class(target)
    given = {name: _plain(name, value) for name, value in json.loads(arguments).items()}
    _check_arguments(target, kind, given)
    try:
        law = kind(**given)
    except (ValueError, TypeError) as error:
        raise ValueError(f"controller: {error}") from error
    except Exception as error:
        raise ValueError(f"{_OPTION}: {target} failed as it was made: {failure_text(error)}") from error
    _check_law(target, law)
    source_of(law)  # takes note of the file as it is now
    return law


def class_of(option: str, target: str) -> type:
    """The class of a full name, its module imported.

    Args:
        option: That names it, for messages.
        target: The name.

    Raises:
        ValueError: There is no such module or class, or the module fails; one line.
    """
    module, _, name = target.rpartition(".")
    if not module or not all(part.isidentifier() for part in target.split(".")):
        raise ValueError(f"{option}: got {target!r}, expected a class by its full name, such as my.module.Class")
    within = _imported(option, target, module)
    found = getattr(within, name, None)
    if isinstance(found, type):
        return found
    own = [key for key, value in vars(within).items() if getattr(value, "__module__", "") == module
           and isinstance(value, type)]  # fmt: skip
    what = f"{module} has no {name}" if found is None else f"that is a {type(found).__name__}"
    raise ValueError(f"{option}: got {target}, but {what}, expected a class"
                     + (f", such as {', '.join(sorted(own))}" if own else ""))  # fmt: skip


def _imported(option: str, target: str, module: str) -> ModuleType:
    try:
        return importlib.import_module(module)
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and f"{module}.".startswith(f"{error.name}."):
            raise ValueError(f"{option}: got {target}, but there is no module {error.name}, expected one that Python "
                             "finds: installed, in PYTHONPATH or in the working folder, at each worker too"
                             ) from None  # fmt: skip
        raise ValueError(f"{option}: {module} failed as it was imported: {failure_text(error)}") from error


def _law_class(target: str) -> type:
    """The class of a law, with all methods of one."""
    found = class_of(_OPTION, target)
    unwritten = getattr(found, "__abstractmethods__", ())
    if missing := [each for each in _METHODS if each in unwritten or not callable(getattr(found, each, None))]:
        raise ValueError(f"{_OPTION}: got {target}, which is no controller without {', '.join(missing)}, {_EXPECTED}")
    return found


def _check_arguments(target: str, kind: type, given: dict[str, Any]) -> None:
    """Checks names: those of the design, unknown and missing ones."""
    every = inspect.signature(kind).parameters
    known = {name: each for name, each in every.items() if each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD)}
    for name in set(known) & set(GAINS):
        raise ValueError(f"controller.{name}: got a value of the design that {target} takes as an argument, expected "
                         "another name for the argument: the law reads task.design")  # fmt: skip
    anything = any(each.kind == each.VAR_KEYWORD for each in every.values())
    for name in given:
        if name not in known and not anything:
            raise ValueError(f"controller.{name}: got an unknown option, expected an argument of {target} "
                             f"({', '.join(known) or 'it has none'}) or one of {', '.join(GAINS)}")  # fmt: skip
    for name, each in known.items():
        if each.default is each.empty and name not in given:
            raise ValueError(f"controller.{name}: got nothing, expected a value, which {target} needs")


def _check_law(target: str, law: Any) -> None:
    """Checks what a law says of itself."""
    if missing := [name for name in _MEMBERS if not hasattr(law, name)]:
        raise ValueError(f"{_OPTION}: got {target}, which is no controller without {', '.join(missing)}, {_EXPECTED}")
    for name in ("costly", "sees_speed", "smooth"):
        if not isinstance(getattr(law, name), bool):
            raise ValueError(f"{_OPTION}: got {target} with {name}={getattr(law, name)!r}, expected True or False")
    if not isinstance(law.unread, tuple) or not set(law.unread) <= set(CONTINUOUS):
        raise ValueError(f"{_OPTION}: got {target} with unread={law.unread!r}, expected a tuple of some of "
                         f"{', '.join(CONTINUOUS)}")  # fmt: skip
    try:
        hash(law)
    except TypeError as error:
        raise ValueError(f"{_OPTION}: got {target}, which has no hash ({error}), expected a frozen dataclass") from None


def _plain(name: str, value: Any) -> Any:
    """A value as an argument."""
    if name.rpartition(".")[2].startswith("_"):
        raise ValueError(f"controller.{name}: got an option of Hydra's instantiate, expected plain arguments by name")
    if isinstance(value, dict):
        return {key: _plain(f"{name}.{key}", each) for key, each in value.items()}
    return tuple(_plain(name, each) for each in value) if isinstance(value, list) else value
