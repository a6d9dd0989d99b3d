"""YAML of others: plain values alone, and no more of them than its text has letters."""

from __future__ import annotations

from typing import Any

import yaml

__all__ = ["composed", "plain"]

_SPARE = 10_000  # values that aliases may add to what the text holds
_LONGEST = 1 << 24  # letters


def composed(text: str, loader: Any = yaml.SafeLoader, most: int = _LONGEST) -> yaml.Node | None:
    """The nodes of a text; None of an empty one.

    Args:
        text: Of up to `most` letters.
        loader: A safe one.
        most: Letters that such a text may have.

    Raises:
        YAMLError: It is no YAML.
        ValueError: It is too long, or its aliases make far more of it than there is, or something of itself.
    """
    if len(text) > most:
        raise ValueError(f"it has {len(text)} letters, expected at most {most}")
    node: yaml.Node | None = yaml.compose(text, Loader=loader)
    if node is not None and _size(node, {}) > len(text) + _SPARE:  # without aliases a value has a letter at least
        raise ValueError("its aliases stand for far more than there is in it")
    return node


def plain(text: str) -> Any:
    """The values of a text.

    Raises:
        YAMLError: It is no YAML.
        ValueError: What `composed` raises, or a value is none, such as a date in month 13.
        RecursionError: It is nested too deep.
    """
    composed(text)
    return yaml.safe_load(text)


def _size(node: yaml.Node, known: dict[int, int | None]) -> int:
    """Values in a node, each as often as aliases repeat it; what is known of a node under way is None."""
    if id(node) in known:
        if (size := known[id(node)]) is None:
            raise ValueError("something in it holds itself by an alias")
        return size
    known[id(node)] = None
    below = node.value if isinstance(node, yaml.CollectionNode) else ()
    parts = (part for each in below for part in (each if isinstance(each, tuple) else (each,)))
    size = known[id(node)] = 1 + sum(_size(part, known) for part in parts)
    return size
