"""A ROS parameter file as text with places: who is given which value, and where that stands.

Files are edited where a value stands, not loaded and dumped: a dump breaks lists anew and re-indents, also with a
library that keeps comments. What a scalar is follows ROS's own parser (rcl_yaml_param_parser), not YAML 1.1.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml

from qocjax._reading import read_bytes, read_text, told
from qocjax._yaml import composed

__all__ = ["Document", "Found", "Section", "Value", "source_text"]

Value = bool | int | float | str | list[bool] | list[int] | list[float] | list[str]

_TRUE = frozenset("y Y yes Yes YES true True TRUE on On ON".split())
_FALSE = frozenset("n N no No NO false False FALSE off Off OFF".split())
_INTEGER = re.compile(r"[-+]?(0[xX][0-9a-fA-F]+|[0-9]+)\Z")
_DOUBLE = re.compile(r"[-+]?((\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|\.?(inf|Inf|INF)|\.?(nan|NaN|NAN))\Z")
_NAMES = {bool: "bool", int: "integer", float: "double", str: "string"}


@dataclass(frozen=True)
class Section:
    """The parameters of one node, or of all that a pattern fits."""

    path: tuple[str, ...]  # namespaces and name, where * and ** are patterns
    parameters: yaml.MappingNode

    def fits(self, namespace: tuple[str, ...], node: str) -> bool:
        """Whether it is for this node."""
        return _fits(self.path, (*namespace, *node.split("/")))


@dataclass(frozen=True)
class Found:
    """A value and where it stands."""

    name: str
    key: yaml.Node
    node: yaml.Node
    value: Value

    @property
    def line(self) -> int:
        """Counted from 1."""
        return self.key.start_mark.line + 1


class Document:
    """A parameter file.

    Args:
        text: All of it; lines end with a line feed alone.
        name: How messages call it.

    Raises:
        ValueError: It is no YAML, no parameter file, or ROS's parser would refuse it; one line with file and line.
    """

    def __init__(self, text: str, name: str) -> None:
        self.text, self.name = text, name
        try:
            self.root = composed(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            raise ValueError(f"{name}:{mark.line + 1 if mark else 1}: no YAML: {error.problem}") from None
        except yaml.YAMLError as error:
            raise ValueError(f"{name}:1: no YAML: {str(error).splitlines()[0]}") from None
        except (ValueError, RecursionError) as error:
            raise ValueError(f"{name}:1: cannot be read: {told(error)}") from None
        if self.root is not None and not isinstance(self.root, yaml.MappingNode):
            raise ValueError(f"{name}:1: got no mapping, expected the parameters of ROS nodes")
        self._seen: set[int] = set()
        self.sections = [] if self.root is None else list(self._sections(self.root, ()))
        self._leaves = {id(section.parameters): list(self._flat(section.parameters, "")) for section in self.sections}

    def fail(self, line: int, what: str) -> ValueError:
        """The one line of an error."""
        return ValueError(f"{self.name}:{line}: {what}")

    def of(self, section: Section) -> list[Found]:
        """Parameters of a section, by dotted name."""
        return self._leaves[id(section.parameters)]

    def find(self, namespace: tuple[str, ...], node: str, name: str) -> Found | None:
        """A parameter as ROS resolves it: of all sections that fit, the last one counts."""
        hits = [each for section in self.sections if section.fits(namespace, node) for each in self.of(section)
                if each.name == name]  # fmt: skip
        return hits[-1] if hits else None

    def namespaces(self, node: str) -> list[tuple[str, ...]]:
        """Namespaces with a section that names this node, in the order of the file."""
        tail = tuple(node.split("/"))
        found = [each.path[: -len(tail)] for each in self.sections if each.path[-len(tail) :] == tail]
        return list(dict.fromkeys(found))

    def _sections(self, mapping: yaml.MappingNode, path: tuple[str, ...]) -> Iterator[Section]:
        for key, value in mapping.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode):
                raise self.fail(line, "got a key that is no name")
            if key.value == "ros__parameters":
                if not path:
                    raise self.fail(line, "ros__parameters: expected it below the name of a node")
                if not isinstance(value, yaml.MappingNode):
                    raise self.fail(line, "ros__parameters: got no parameters below it, which ROS's parser refuses")
                yield Section(path, value)
            elif isinstance(value, yaml.MappingNode):
                yield from self._sections(value, (*path, *(part for part in key.value.split("/") if part)))
            else:
                raise self.fail(line, f"{key.value}: got a value above ros__parameters, expected the name of a node")

    def _flat(self, node: yaml.MappingNode, prefix: str) -> Iterator[Found]:
        for key, value in node.value:
            name, line = f"{prefix}{key.value}", key.start_mark.line + 1
            if id(value) in self._seen or not isinstance(key, yaml.ScalarNode):
                raise self.fail(line, f"{name}: got an alias, which ROS's parser refuses")
            self._seen.add(id(value))
            if isinstance(value, yaml.MappingNode):
                yield from self._flat(value, f"{name}.")
            elif isinstance(value, yaml.SequenceNode):
                yield Found(name, key, value, self._list(name, value))
            else:
                if not value.style and not value.value:
                    raise self.fail(line, f"{name}: got no value, which ROS's parser refuses")
                yield Found(name, key, value, _scalar(value))

    def _list(self, name: str, node: yaml.SequenceNode) -> Value:
        values = []
        for item in node.value:
            line = item.start_mark.line + 1
            if not isinstance(item, yaml.ScalarNode):
                raise self.fail(line, f"{name}: got a list of lists or mappings, which ROS's parser refuses")
            values.append(_scalar(item))
            first, kind = _NAMES[type(values[0])], _NAMES[type(values[-1])]
            if kind != first:
                raise self.fail(line, f"{name}: got a {kind} in a list of type {first}, which ROS's parser refuses")
        return values  # type: ignore[return-value]  # all of one type


def source_text(source: str | Path) -> tuple[str, str, bool]:
    """Text with line feeds alone, its name for messages, and whether lines ended as on Windows.

    Args:
        source: A path, or the text of a file, which has more than one line or nothing.

    Raises:
        ValueError: It cannot be read; one line that names it.
    """
    if isinstance(source, str) and ("\n" in source or not source):
        return source.replace("\r\n", "\n"), "nav2_params.yaml", "\r\n" in source
    return read_text(source), str(source), b"\r\n" in read_bytes(source)


def _scalar(node: yaml.ScalarNode) -> bool | int | float | str:
    """A scalar as ROS's parser takes it."""
    text = str(node.value)
    if node.style:  # quoted
        return text
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if _INTEGER.match(text):
        digits = text.lstrip("+-")
        if digits[0] != "0" or len(digits) == 1:
            return int(text)
        if "x" in digits.lower():
            return int(text, 16)
        return int(text, 8) if max(digits) < "8" else float(text)  # C reads 010 as 8, and 08 as no integer
    return float(text.lower().replace(".inf", "inf").replace(".nan", "nan")) if _DOUBLE.match(text) else text


def _fits(pattern: tuple[str, ...], path: tuple[str, ...]) -> bool:
    """Whether a pattern fits a path; the pattern of a file that is started in a namespace lacks it."""
    if not pattern:
        return not path
    if pattern[0] == "**":
        return any(_fits(pattern[1:], path[k:]) for k in range(len(path) + 1))
    return bool(path) and pattern[0] in ("*", path[0]) and _fits(pattern[1:], path[1:])
