"""Changes to a parameter file, made where the values stand: all else stays as it is, to the byte."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from qocjax.nav2.document import Document, Found, Section, Value, source_text

__all__ = ["Change", "decimal", "merged"]

_COMMENT = re.compile(r"(^|\s)#")


@dataclass(frozen=True)
class Change:
    """One parameter that is advised.

    Attributes:
        node: Whose it is; of the costmap with its namespace.
        name: With the plugin's name and dots.
        value: A float is written with a point, whatever its value.
        why: For the comment at the end of the line.
    """

    node: str
    name: str
    value: Value
    why: str


def merged(source: str | Path, changes: Sequence[Change], namespace: tuple[str, ...] | None = None) -> str:
    """The same file with some values changed, or added where it lacks them.

    Args:
        source: A path, or the text of a file, which has more than one line or none.
        changes: What to change. A value that is there already is no change.
        namespace: Of the nodes; by default that of the first controller server.

    Raises:
        ValueError: The file cannot be read, or ROS's parser would refuse it; one line with file and line.
    """
    text, name, windows = source_text(source)
    was_there = bool(text)
    for change in changes:
        document = Document(text, name)
        spaces = document.namespaces("controller_server")
        space = namespace if namespace is not None else spaces[0] if spaces else ()
        found = document.find(space, change.node, change.name)
        if found is None:
            text = _added(document, space, change, was_there)
        elif not _same(found.value, change.value):
            text = _changed(document, found, change)
    return text.replace("\n", "\r\n") if windows else text


def decimal(value: float, digits: int = 10) -> str:
    """A number as ROS reads a double: with a point, also where it is whole.

    Raises:
        ValueError: It is not finite.
    """
    if not math.isfinite(value):
        raise ValueError(f"got {value}, expected a finite number")
    mantissa, mark, exponent = f"{value:.{digits}g}".partition("e")
    return (mantissa if "." in mantissa else mantissa + ".0") + mark + exponent


def _plain(value: Value) -> str:
    """A value as YAML."""
    if isinstance(value, list):
        return f"[{', '.join(_plain(item) for item in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return decimal(value) if isinstance(value, float) else str(value)


def _same(old: Value, new: Value) -> bool:
    """Whether a value stands there already, with its type."""
    a, b = (value if isinstance(value, list) else [value] for value in (old, new))
    return type(old) is type(new) and [*map(type, a)] == [*map(type, b)] and _plain(old) == _plain(new)


def _changed(document: Document, found: Found, change: Change) -> str:
    """A value in place of another; of a list of as many items each item, so that its layout stays."""
    lines = document.text.split("\n")
    spans, values = [found.node], [change.value]
    if isinstance(found.node, yaml.SequenceNode):
        if isinstance(change.value, list) and len(change.value) == len(found.node.value):
            spans, values = found.node.value, change.value  # type: ignore[assignment]  # items in place of the list
    last = _last_line(found.node)
    for node, value in reversed(list(zip(spans, values, strict=True))):
        start, end = node.start_mark, node.end_mark
        tail = lines[end.line][end.column :]
        lines[start.line : end.line + 1] = [lines[start.line][: start.column] + _plain(value) + tail]
        last -= end.line - start.line
    was = _plain(found.value) if not isinstance(found.value, float) else document.text.split("\n")[
        found.node.start_mark.line][found.node.start_mark.column : found.node.end_mark.column]  # fmt: skip
    lines[last] = _commented(lines[last], f"{change.why}; was {was}")
    return "\n".join(lines)


def _commented(line: str, comment: str) -> str:
    """A line with a comment at its end, after one that is there."""
    line = line.rstrip()
    return f"{line}; {comment}" if _COMMENT.search(line) else f"{line}  # {comment}"


def _last_line(node: yaml.Node) -> int:
    """Line that a value ends in; the mark of a block lies after the blank lines and comments that follow it."""
    if isinstance(node, (yaml.MappingNode, yaml.SequenceNode)) and not node.flow_style and node.value:
        last = node.value[-1]
        return _last_line(last[1] if isinstance(last, tuple) else last)
    return int(node.end_mark.line) - (getattr(node, "style", None) in ("|", ">"))


def _added(document: Document, namespace: tuple[str, ...], change: Change, was_there: bool) -> str:
    """A value that was missing, in the section that names the node, below as much of its name as there is."""
    lines = document.text.split("\n")
    why = f"{'added; ' if was_there else ''}{change.why}"
    tail = (*namespace, *change.node.split("/"))
    sections = [each for each in document.sections if each.path == tail]
    if not sections:
        above = ("/" if namespace else "") + "/".join((*namespace, change.node.split("/")[0]))
        parts = [above, *change.node.split("/")[1:], "ros__parameters"]
        blank = [""] if any(line.strip() for line in lines) else []
        while lines and not lines[-1].strip():
            lines.pop()
        return "\n".join([*lines, *blank, *_nested([*parts, *change.name.split(".")], change.value, why, 0), ""])
    mapping, parts = _innermost(sections[-1], change.name.split("."))
    if mapping.flow_style:
        return _into_flow(lines, mapping, f"{'.'.join(parts)}: {_plain(change.value)}", why)
    indent = mapping.value[0][0].start_mark.column
    at = _last_line(mapping) + 1
    return "\n".join([*lines[:at], *_nested(parts, change.value, why, indent), *lines[at:]])


def _innermost(section: Section, parts: list[str]) -> tuple[yaml.MappingNode, list[str]]:
    """The mapping that holds most of a dotted name, and what is left of the name."""
    mapping = section.parameters
    while len(parts) > 1:
        for k in range(len(parts) - 1, 0, -1):
            below = [value for key, value in mapping.value
                     if key.value == ".".join(parts[:k]) and isinstance(value, yaml.MappingNode)]  # fmt: skip
            if below:
                mapping, parts = below[-1], parts[k:]
                break
        else:
            flat = any(str(key.value).startswith(f"{parts[0]}.") for key, _ in mapping.value)
            return mapping, [".".join(parts)] if flat else parts
    return mapping, parts


def _nested(parts: list[str], value: Value, why: str, indent: int) -> list[str]:
    """Lines of a value below the parts of its name."""
    lines = [f"{' ' * (indent + 2 * k)}{part}:" for k, part in enumerate(parts)]
    return [*lines[:-1], _commented(f"{lines[-1]} {_plain(value)}", why)]


def _into_flow(lines: list[str], mapping: yaml.MappingNode, item: str, why: str) -> str:
    """An item before the closing brace of a mapping."""
    end = mapping.end_mark
    line = lines[end.line]
    inside = line[: end.column - 1].rstrip()
    lines[end.line] = _commented(f"{inside}{', ' if mapping.value else ''}{item}{line[end.column - 1 :]}", why)
    return "\n".join(lines)
