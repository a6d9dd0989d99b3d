"""Where the YAML files of the configuration are, and what Hydra and OmegaConf want to be told in each version."""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import Any

__all__ = ["add_resolver", "conf_dir", "hydra_base"]


def hydra_base() -> dict[str, str]:
    """What Hydra is told of the version whose ways are meant: 1.3 must be, and 1.4, which no longer asks, warns."""
    return {"version_base": "1.3"} if version("hydra-core").startswith("1.3.") else {}


def add_resolver(name: str, resolve: Callable[..., Any]) -> None:
    """Makes `${name:...}` known to configurations; OmegaConf 2.4 warns of the name that 2.3 has for it."""
    from omegaconf import OmegaConf  # not where `import qocjax` alone is asked for

    old = version("omegaconf").startswith("2.3.")
    register: Any = OmegaConf.register_new_resolver if old else OmegaConf.register_resolver
    register(name, resolve, replace=True)


def conf_dir() -> Path:
    """Folder of the YAML files: inside an installed package, or beside the package in a checkout."""
    packaged = Path(str(resources.files("qocjax"))) / "conf"
    return packaged if packaged.is_dir() else packaged.parent.parent / "conf"
