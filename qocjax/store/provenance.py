"""What a result was made with: versions, device, platform."""

from __future__ import annotations

import functools
import platform
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from qocjax._xla import whole_loop_requested
from qocjax.store.sources import source_of

__all__ = ["change_of", "made_with", "provenance"]

_PACKAGES = ("qocjax", "jax", "jaxlib", "numpy", "scipy", "pandas", "xarray", "optax", "cmaes", "rosbags", "hydra-core")


def provenance(law: Any = None) -> dict[str, Any]:
    """Versions of the packages that results depend on, the device, and the time; and the file of a law from outside."""
    device = jax.devices()[0]
    return {
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {name: _version(name) for name in _PACKAGES} | {"python": platform.python_version()},
        "device": {"backend": jax.default_backend(), "kind": device.device_kind, "count": jax.device_count()},
        "platform": platform.platform(),
    } | ({} if (source := source_of(law)) is None else {"law": source})


@functools.cache
def _machine() -> str:
    """Kind of processor, as precisely as the system tells: the machine code that XLA makes depends on it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def made_with() -> dict[str, str]:
    """What the last bits of a result may depend on beside the configuration."""
    device = getattr(jax.config, "jax_default_device", None) or jax.devices()[0]
    versions = {name: str(_version(name)) for name in ("qocjax", "jax", "jaxlib", "numpy")}
    return versions | {
        "x64": str(bool(jnp.result_type(float) == jnp.float64)),
        "device": f"{jax.default_backend()}, {getattr(device, 'device_kind', device)}",
        "machine": _machine(),
        "whole loop": str(whole_loop_requested()),
    }


def change_of(made_with: Sequence[Mapping[str, str]]) -> list[str]:
    """What differs between the processes that computed the parts of a result, a line for each item."""
    names = dict.fromkeys(name for each in made_with for name in each)
    found = {name: sorted({each.get(name, "nothing") for each in made_with}) for name in names}
    return [
        f"parts of the results were computed with different {name} ({' and '.join(values)}): "
        "their last digits may be others than in one piece"
        for name, values in found.items()
        if len(values) > 1
    ]


@functools.cache
def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
