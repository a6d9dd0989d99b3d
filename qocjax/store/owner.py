"""Whose a chunk is: what its numbers follow from, in a few words."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp

from qocjax._source import source_digest

__all__ = ["owner_of", "strangeness"]


def owner_of(identity: Mapping[str, Any], data: str) -> dict[str, str]:
    """What a chunk is written with, and has to be read with.

    Versions of packages and the processor, on which the last digits depend, are told of and not asked for.

    Args:
        identity: The options that results depend on.
        data: Digest of the measured data behind them.
    """
    text = json.dumps(identity, sort_keys=True)
    return {
        "configuration": hashlib.blake2b(text.encode(), digest_size=16).hexdigest(),
        "data": data,
        "code": source_digest(),
        "float width": str(jnp.result_type(float)),
        "random numbers": f"{jax.config.jax_default_prng_impl}, {jax.config.jax_threefry_partitionable}",
    }


def strangeness(there: Any, here: Mapping[str, str]) -> str:
    """In what a chunk is another's than of who asks; empty where it is one's own."""
    if not here:
        return ""
    held = there if isinstance(there, Mapping) else {}
    return " and ".join(f"other {name}" for name in here if held.get(name) != here[name])
