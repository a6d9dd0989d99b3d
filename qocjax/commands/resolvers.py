"""What `${...}` in a configuration may ask for: other options, the time, and few variables of the environment.

A configuration is written beside the results, so an experiment file of somebody else could copy a password there.
"""

from __future__ import annotations

import os

from qocjax._conf import add_resolver
from qocjax.commands.own_folder import own_folder

__all__ = ["ALLOWED", "register_resolvers"]

ALLOWED = "QOCJAX_ALLOW_ENV"  # names that a user allows, separated by commas
_OWN = "QOCJAX_"


def register_resolvers() -> None:
    """Makes `own_folder` known, and puts a guard in the place of OmegaConf's `oc.env`."""
    add_resolver("own_folder", own_folder)
    add_resolver("oc.env", _variable)


def _variable(name: str, *default: str | None) -> str | None:
    """A variable of the environment, or a default where it is not set.

    Raises:
        ValueError: It is none that a configuration may ask for, or it is not set and there is no default.
    """
    allowed = [each.strip() for each in os.environ.get(ALLOWED, "").split(",")]
    if not name.startswith(_OWN) and name not in allowed:
        raise ValueError(f"oc.env: got {name}, expected a variable that begins with {_OWN}, or one that you allow by "
                         f"{ALLOWED}={name}: what it holds would be written with the results")  # fmt: skip
    if name in os.environ:
        return os.environ[name]
    if not default:
        raise ValueError(f"oc.env: got {name}, which is not set, expected it in the environment, or a default")
    return default[0]
