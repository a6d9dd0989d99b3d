"""What every part of a configuration is: a typed model that knows its keys, read from what Hydra composed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from omegaconf import DictConfig, OmegaConf
from pydantic import BaseModel, ConfigDict, ValidationError

from qocjax._conf import conf_dir
from qocjax._room import check_room

_WHOLE, _LEAST, _MOST = 10**18, 1e-37, 1e38  # of numbers in a configuration
_TOLD = 5  # errors of one kind

__all__ = ["Part", "conf_dir", "line_of", "load"]


class Part(BaseModel):
    """A part of a configuration: unknown keys and wrong types are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    def sizes(self) -> Mapping[str, float]:
        """Bytes of memory, at least, of what some options ask for at once, by their full name."""
        return {}

    def remarks(self) -> list[str]:
        """What looks like a slip, though it may be meant."""
        return []


M = TypeVar("M", bound=BaseModel)


def load(model: type[M], cfg: DictConfig) -> M:
    """Checks a composed configuration against its schema.

    Raises:
        ValueError: An unknown key, a missing one or a wrong type, one line for each, with its full name; or a number
            that asks for more than there is memory.
    """
    if missing := sorted(OmegaConf.missing_keys(cfg)):
        raise ValueError("; ".join(f"{name}: got nothing, expected a value" for name in missing))
    raw: Any = OmegaConf.to_container(cfg, resolve=True)
    if odd := list(_beyond(raw, "")):
        raise ValueError("; ".join(odd[:_TOLD]))
    try:
        found = model.model_validate(raw)
    except ValidationError as error:
        lines = [line_of(item, raw) for item in error.errors()]
        raise ValueError("; ".join(lines)) from None
    for name, size in found.sizes().items() if isinstance(found, Part) else ():
        check_room(name, str(OmegaConf.select(cfg, name)), size, "less")
    return found


def _beyond(value: Any, name: str) -> Iterator[str]:
    """Numbers that 32 bits do not hold, which would be others, or none, in what is computed; a line each."""
    if isinstance(value, dict | list):
        for key, each in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _beyond(each, f"{name}.{key}" if name else str(key))
    elif isinstance(value, int) and abs(value) >= _WHOLE:
        yield f"{name}: got a whole number of {int(value.bit_length() * 0.30103) + 1} digits, expected at most 18"
    elif isinstance(value, float) and (value != value or not (value == 0 or _LEAST <= abs(value) <= _MOST)):
        if not math.isinf(value):  # which says that there is no limit
            yield f"{name}: got {value:g}, expected " + ("a finite number" if value != value else
                f"0, or a number of {_LEAST:g} to {_MOST:g}, which 32 bits hold")  # fmt: skip


def line_of(item: Any, raw: Any) -> str:
    """One schema error as a line; the tags that pydantic adds for the branch of a union are left out."""
    path, here = [], raw
    for part in item["loc"]:
        if isinstance(here, dict) and part in here or isinstance(here, list) and isinstance(part, int):
            here = here[part]
        elif part != item["loc"][-1]:
            continue
        path.append(str(part))
    name = ".".join(path)
    if item["type"] == "extra_forbidden":
        return f"{name}: got an unknown option, expected one of the configuration's"
    if item["type"] == "missing":
        return f"{name}: got nothing, expected a value"
    return f"{name}: got {item['input']!r}, expected {item['msg'].removeprefix('Input should be ')}"
