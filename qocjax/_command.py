"""What the command lines share: set-up of JAX for a program, and errors as one line without a traceback."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable
from pathlib import Path

import hydra
import jax
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from qocjax.batch.evaluate import unit_of
from qocjax.batch.xla import request_whole_loop
from qocjax.config import conf_dir

__all__ = ["command", "output_dir", "printed_unit"]


def command(name: str) -> Callable[[Callable[[DictConfig], None]], Callable[[], None]]:
    """Makes a function of a configuration a Hydra command line with the primary configuration `conf/<name>.yaml`."""

    def wrap(main: Callable[[DictConfig], None]) -> Callable[[], None]:
        @functools.wraps(main)
        def guarded(cfg: DictConfig) -> None:
            try:
                main(cfg)
            except (ValueError, TypeError, OSError) as error:
                if os.environ.get("QOCJAX_TRACEBACK"):
                    raise
                print(f"error: {error}", file=sys.stderr)
                sys.exit(2)
            except KeyboardInterrupt:
                print("stopped", file=sys.stderr)
                sys.exit(130)

        run = hydra.main(version_base="1.3", config_path=str(conf_dir()), config_name=name)(guarded)

        @functools.wraps(main)
        def entry() -> None:
            _set_up_jax()
            run()

        return entry

    return wrap


def _set_up_jax() -> None:
    """Fast loops on CPUs, and compiled programs kept between runs in the user's cache folder."""
    request_whole_loop()
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "qocjax" / "xla"
        jax.config.update("jax_compilation_cache_dir", str(cache))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)


def output_dir() -> Path:
    """Folder of this run's results."""
    return Path(HydraConfig.get().runtime.output_dir)


def printed_unit(name: str) -> str:
    """Unit of a value of a design, as it follows the number; nothing where it is a plain number."""
    unit = unit_of(name)
    return "" if unit == "1" else unit
