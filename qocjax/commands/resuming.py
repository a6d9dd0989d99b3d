"""Going on with what a folder holds."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from tqdm import tqdm

from qocjax.commands.command_line import given_options
from qocjax.config.kept import KeptConfig
from qocjax.store import write_config
from qocjax.store.journal import journal
from qocjax.store.study_folder import read_identity, study_folder

__all__ = ["going_on", "note", "resumed"]

C = TypeVar("C", bound=KeptConfig)


def note(text: str) -> None:
    """Tells on standard error what a user should know, beside the progress bar."""
    tqdm.write(f"note: {text}", file=sys.stderr)


@contextmanager
def going_on(config: KeptConfig, folder: Path | None, data: str) -> Iterator[None]:
    """Keeps what is simulated inside, piece by piece, and takes what a run of the same configuration kept before.

    Args:
        config: All options of the command; written as `config.yaml`.
        folder: Where results go; None keeps nothing.
        data: Digest of what lies behind the options.

    Raises:
        ValueError: The folder holds the work of another configuration, or another process works there.
        OSError: The folder cannot be written, or the disk is full; what is finished stays.
    """
    if folder is None:
        yield
        return
    with study_folder(folder, config.identity(), data, note) as chunks:
        write_config(folder, config.model_dump())
        with journal(chunks, note):
            yield


def resumed(config: C, folder: Path) -> C:
    """The configuration that a folder holds, with the options that may change; the given one where it was given.

    Args:
        config: What the command line asks.
        folder: Where results go.

    Raises:
        ValueError: The folder to go on with is not the one that the results go to, or holds no study of this command.
    """
    resume, free = config.resume, config.free
    if resume is None:
        return config
    if Path(resume).resolve() != folder.resolve():
        raise ValueError(f"resume: got {resume} with results in {folder}, expected one folder")
    there = read_identity(folder)["configuration"]
    if others := sorted(set(there) - set(type(config).model_fields)):
        raise ValueError(f"resume: got {resume}, a study with {', '.join(others)}, expected one of this command")
    if any(name.split(".")[0] not in free for name in given_options()):
        return config  # what was asked for, to be compared with what is there
    return type(config).model_validate({**config.model_dump(include=set(free)), **there})
