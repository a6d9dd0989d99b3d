"""What a result was made with: versions, device, platform."""

from __future__ import annotations

import platform
from datetime import UTC, datetime
from importlib import metadata
from typing import Any

import jax

__all__ = ["provenance"]

_PACKAGES = ("qocjax", "jax", "jaxlib", "numpy", "scipy", "pandas", "xarray", "optax", "cmaes", "rosbags", "hydra-core")


def provenance() -> dict[str, Any]:
    """Versions of the packages that results depend on, the device, and the time."""
    device = jax.devices()[0]
    return {
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {name: _version(name) for name in _PACKAGES} | {"python": platform.python_version()},
        "device": {"backend": jax.default_backend(), "kind": device.device_kind, "count": jax.device_count()},
        "platform": platform.platform(),
    }


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
