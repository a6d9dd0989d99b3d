"""How XLA is asked to compile the batch: the options that its speed on CPUs hangs on."""

from __future__ import annotations

import os
from typing import Any

import jax

__all__ = ["as_written", "compiled", "num_workers", "request_whole_loop", "whole_loop_requested"]

# A scan is otherwise run as one call per fusion and tick, about a microsecond each; with this XLA compiles the whole
# loop into one function. The option is read from the environment when XLA starts, so only a program may set it.
_WHOLE_LOOP = "xla_cpu_small_while_loop_byte_threshold"
_WHOLE_LOOP_BYTES = 10**9

# 512-bit registers where the machine has them (XLA's own choice is 256), and no unrolling by LLVM: a tick is long
# enough as it is; the program is a third faster and compiles sooner.
_CPU_OPTIONS: dict[str, Any] = {"xla_cpu_prefer_vector_width": 512, "xla_backend_optimization_level": 1}


def request_whole_loop() -> None:
    """Asks XLA, through XLA_FLAGS, to compile loops whole; for command lines, before JAX computes anything.

    A value that the user has set stays. Doubles the speed on CPUs with jax 0.10 (0.12 does it unasked); results keep
    their meaning.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if "--xla_backend_extra_options" not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} --xla_backend_extra_options={_WHOLE_LOOP}={_WHOLE_LOOP_BYTES}".strip()


def whole_loop_requested() -> bool:
    """Whether XLA_FLAGS holds that request."""
    return _WHOLE_LOOP in os.environ.get("XLA_FLAGS", "")


def num_workers() -> int:
    """Threads that run chunks side by side: one per core on CPUs, one on an accelerator."""
    if jax.default_backend() != "cpu":
        return 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def as_written(lowered: jax.stages.Lowered) -> jax.stages.Compiled:
    """Compiles a program whose operations round one by one, as they do where each is a program of its own."""
    return lowered.compile(compiler_options={"xla_disable_hlo_passes": "fusion"})


def compiled(lowered: jax.stages.Lowered) -> jax.stages.Compiled:
    """Compiles a program for the device at hand."""
    if jax.default_backend() != "cpu":
        return lowered.compile()
    try:
        return lowered.compile(compiler_options=_CPU_OPTIONS)
    except jax.errors.JaxRuntimeError as error:
        if "No such compile option" not in str(error):
            raise
        return lowered.compile()  # an XLA that knows no such option: slower, same result
