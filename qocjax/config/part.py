"""What every part of a configuration is: a typed model that knows its keys, read from what Hydra composed."""

from __future__ import annotations

from typing import Any, TypeVar

from omegaconf import DictConfig, OmegaConf
from pydantic import BaseModel, ConfigDict, ValidationError

from qocjax._conf import conf_dir

__all__ = ["Part", "conf_dir", "line_of", "load"]


class Part(BaseModel):
    """A part of a configuration: unknown keys and wrong types are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


M = TypeVar("M", bound=BaseModel)


def load(model: type[M], cfg: DictConfig) -> M:
    """Checks a composed configuration against its schema.

    Raises:
        ValueError: An unknown key, a missing one or a wrong type; one line for each, with its full name.
    """
    if missing := sorted(OmegaConf.missing_keys(cfg)):
        raise ValueError("; ".join(f"{name}: got nothing, expected a value" for name in missing))
    raw: Any = OmegaConf.to_container(cfg, resolve=True)
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        lines = [line_of(item, raw) for item in error.errors()]
        raise ValueError("; ".join(lines)) from None


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
