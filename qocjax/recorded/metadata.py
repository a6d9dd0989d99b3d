"""What metadata.yaml says of a bag: its files in their order, and how many messages each topic has."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from qocjax._reading import decoding, read_text

__all__ = ["METADATA", "Metadata", "profiles", "read_metadata"]

METADATA = "metadata.yaml"
_RELIABILITY = {"0": "system_default", "1": "reliable", "2": "best_effort", "3": "unknown", "4": "best_available"}
_HISTORY = {"0": "system_default", "1": "keep_last", "2": "keep_all", "3": "unknown"}


@dataclass(frozen=True)
class Metadata:
    """What is promised."""

    files: tuple[str, ...]
    counts: dict[tuple[str, str], int] = field(default_factory=dict)  # messages by name and type of a topic


def read_metadata(folder: Path) -> Metadata:
    """Reads a folder's metadata.yaml.

    Raises:
        ValueError: It cannot be read as one.
    """
    import yaml  # type: ignore[import-untyped,unused-ignore]  # comes with OmegaConf

    from qocjax._yaml import composed

    path = folder / METADATA
    text = read_text(path)
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    with decoding(path, "metadata of rosbag2"):
        composed(text, loader)
        values = yaml.load(text, Loader=loader)["rosbag2_bagfile_information"]
        counts: dict[tuple[str, str], int] = {}
        for topic in values["topics_with_message_count"]:
            about = topic["topic_metadata"]
            key = (str(about["name"]), str(about["type"]))
            counts[key] = counts.get(key, 0) + int(topic["message_count"])
        return Metadata(tuple(Path(str(name)).name for name in values["relative_file_paths"]), counts)


def profiles(text: str) -> list[str]:
    """The QoS profiles of offered_qos_profiles in few words, such as `reliable keep_last(10)`; one a publisher."""
    found = [re.findall(rf"\b{key}: *['\"]?(\w+)", text) for key in ("reliability", "history", "depth")]
    return [_words(_RELIABILITY.get(r, r), _HISTORY.get(h, h), depth) for r, h, depth in zip(*found, strict=False)]


def _words(reliability: str, history: str, depth: str) -> str:
    return f"{reliability} keep_last({depth})" if history == "keep_last" else f"{reliability}, history {history}"


def joined(words: Iterable[str]) -> str:
    """Each of some words once."""
    return " | ".join(dict.fromkeys(words))
