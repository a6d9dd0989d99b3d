"""Going on with the study of a folder."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TypeVar

from qocjax.commands.command_line import given_options
from qocjax.config.part import Part
from qocjax.store.study_folder import read_identity

__all__ = ["resumed"]

C = TypeVar("C", bound=Part)


def resumed(config: C, resume: str | None, folder: Path, free: Collection[str]) -> C:
    """The configuration that a folder holds, with the options that may change; the given one where it was given.

    Args:
        config: What the command line asks.
        resume: The folder to go on with, if any.
        folder: Where results go.
        free: Options that results do not depend on.

    Raises:
        ValueError: The folder to go on with is not the one that the results go to, or holds no study of this command.
    """
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
