"""rosbag2 recordings, whole or not: which files make one, in which order, and how each is opened."""

from __future__ import annotations

import importlib.util
import re
import tempfile
from contextlib import ExitStack
from pathlib import Path

from qocjax.recorded.bag import Bag
from qocjax.recorded.findings import Findings
from qocjax.recorded.mcap import McapFile
from qocjax.recorded.metadata import METADATA, Metadata, read_metadata
from qocjax.recorded.sqlite import SqliteFile
from qocjax.recorded.storage import StorageFile
from qocjax.recorded.unpacking import unpacked_file

__all__ = ["is_bag", "open_bag", "storage_files"]

_SUFFIXES = (".db3", ".mcap", ".db3.zstd", ".mcap.zstd")


def is_bag(path: Path) -> bool:
    """Whether a path is a bag's file, or a folder with one."""
    return bool(storage_files(path)) or (path.is_dir() and (path / METADATA).is_file())


def storage_files(path: Path) -> list[Path]:
    """Files with messages: the path itself, or those directly in it, in the order of the numbers in their names."""
    each = path.iterdir() if path.is_dir() else [path]
    return sorted((file for file in each if file.name.endswith(_SUFFIXES) and file.is_file()), key=_in_order)


def _in_order(path: Path) -> list[tuple[int, str]]:
    """Sorts run_10 behind run_2."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.name)]


def open_bag(path: Path, findings: Findings) -> Bag:
    """Opens a rosbag2 folder or file; where it was cut off or is damaged, what is left of it.

    Raises:
        ValueError: There is no bag, rosbags is not installed, or nothing of it can be read.
    """
    if not path.exists():
        raise ValueError(f"{path}: no such file or folder, expected a rosbag2 folder or a .db3 or .mcap file")
    if path.suffix == ".bag":
        raise ValueError(f"{path}: is a bag of ROS 1, expected rosbag2 (rosbags-convert makes one)")
    if not is_bag(path):
        raise ValueError(f"{path}: holds no .db3 or .mcap file, expected a rosbag2 folder or file")
    if importlib.util.find_spec("rosbags") is None:
        raise ValueError(f"{path}: needs rosbags to be read, expected it installed: pip install 'qocjax[ros]'")
    metadata = _metadata(path, findings)
    with ExitStack() as stack:
        files, errors = [], []
        for file in _files(path, metadata, findings):
            try:
                files.append(_open_file(file, findings, stack))
            except (ValueError, OSError) as error:
                errors.append(str(error))
        if not files:
            raise ValueError("; ".join(errors) or f"{path}: names files in its {METADATA} that are not there")
        for text in errors:
            findings.count(path.name, "truncated")
            findings.note(text)
        return Bag(path, files, metadata, findings, stack.pop_all())


def _metadata(path: Path, findings: Findings) -> Metadata | None:
    """What metadata.yaml says, also of a file that is the only one it names."""
    folder = path if path.is_dir() else path.parent
    if not (folder / METADATA).is_file():
        if path.is_dir():
            findings.note(
                f"{path.name}: has no {METADATA}, as when recording was not ended; its files are read as they are"
            )
        return None
    try:
        found = read_metadata(folder)
    except ValueError as error:
        if path.is_dir():
            findings.note(f"{error}; its files are read as they are")
        return None
    return found if path.is_dir() or found.files == (path.name,) else None


def _files(path: Path, metadata: Metadata | None, findings: Findings) -> list[Path]:
    """The files to read: those that the metadata names, in its order, then the others."""
    here = {file.name: file for file in storage_files(path)}
    if metadata is None:
        found = _once(here, findings)
        _tell_missing(path, found, findings)
        return found
    found = []
    for name in metadata.files:
        same = next((each for each in (name, f"{name}.zstd", name.removesuffix(".zstd")) if each in here), None)
        if same is None:
            findings.count(path.name, "missing_files")
            findings.note(f"{path.name}: {name}, which its {METADATA} names, is not there")
        else:
            found.append(here.pop(same))
    named = {_stem(file) for file in found}
    others = {name: file for name, file in here.items() if _stem(file) not in named}
    for name in others:
        findings.note(f"{path.name}: {name} is not among the files that its {METADATA} names; it is read too")
    return [*found, *_once(others, findings)]


def _tell_missing(path: Path, files: list[Path], findings: Findings) -> None:
    """Counts the splits between two others that are not there: rosbag2 numbers them."""
    splits: dict[str, list[int]] = {}
    for file in files:
        if found := re.fullmatch(r"(.*_)(\d{1,6})", _stem(file)):
            splits.setdefault(found[1], []).append(int(found[2]))
    for name, numbers in splits.items():
        missing = sorted(set(range(min(numbers), max(numbers))) - set(numbers))
        findings.count(path.name, "missing_files", len(missing))
        if missing:
            told = ", ".join(f"{name}{number}" for number in missing[:3]) + (" ..." if len(missing) > 3 else "")
            findings.note(f"{path.name}: {told} is not there, between files that are")


def _once(files: dict[str, Path], findings: Findings) -> list[Path]:
    """Files without those that have the same content: packed beside unpacked, or one format beside the other."""
    found: dict[str, Path] = {}
    for name, file in sorted(files.items(), key=lambda each: len(each[0])):
        taken = found.setdefault(_stem(file), file)
        if taken != file:
            findings.note(f"{name}: lies beside {taken.name}, which has the same content by its name; left out")
    return sorted(found.values(), key=_in_order)


def _stem(file: Path) -> str:
    return re.sub(r"\.(db3|mcap)(\.zstd)?$", "", file.name)


def _open_file(path: Path, findings: Findings, stack: ExitStack) -> StorageFile:
    """Opens a file, unpacked where it is packed."""
    plain = path
    if path.suffix == ".zstd":
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="qocjax"))
        plain = Path(folder) / path.name.removesuffix(".zstd")
        if not unpacked_file(path, plain):
            findings.note(f"{path.name}: cannot be unpacked to its end")
    try:
        opened = (McapFile if plain.suffix == ".mcap" else SqliteFile)(plain, findings, path.name)
    except ValueError as error:
        raise ValueError(str(error).replace(str(plain), str(path))) from None
    stack.callback(opened.close)
    return opened
