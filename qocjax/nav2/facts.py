"""What is known of each parameter that is read or written: `facts.csv`, checked against the sources of Nav2."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

__all__ = ["RELEASES", "Fact", "fact", "facts", "plugins_of"]

RELEASES = ("jazzy", "kilted", "lyrical", "main")


@dataclass(frozen=True)
class Fact:
    """One parameter.

    Attributes:
        node: Who declares it; of the costmap with its namespace.
        plugin: Class of the plugin that declares it under its own name; empty where the node itself does.
        name: Without the plugin's name.
        type: As ROS names it: double, integer, bool, string, or one of these with `_array`.
        defaults: Of each of `RELEASES`, as YAML; empty where there is none, or no such parameter.
        file: Where it is declared, in the main branch of Nav2 unless it names another repository.
        meaning: What it is in the simulated loop, with its unit.
    """

    node: str
    plugin: str
    name: str
    type: str
    defaults: tuple[str, ...]
    file: str
    meaning: str

    @property
    def since(self) -> str:
        """First of `RELEASES` that has a default for it; empty where all have or none has."""
        found = [release for release, default in zip(RELEASES, self.defaults, strict=True) if default]
        return found[0] if found and found[0] != RELEASES[0] else ""


@cache
def facts(node: str | None = None, plugin: str | None = None) -> tuple[Fact, ...]:
    """All facts, or those of a node and of a class of plugin (empty for the node's own)."""
    if node is None:
        with (files("qocjax.nav2") / "facts.csv").open(encoding="utf-8") as file:
            return tuple(
                Fact(row["node"], row["plugin"], row["name"], row["type"], tuple(row[each] for each in RELEASES),
                     row["file"], row["meaning"])
                for row in csv.DictReader(file)
            )  # fmt: skip
    return tuple(each for each in facts() if each.node == node and plugin in (None, each.plugin))


@cache
def fact(node: str, name: str, plugin: str = "") -> Fact:
    """The fact of one parameter.

    Raises:
        KeyError: It is not in the table, so nothing reads or writes it.
    """
    for each in facts(node, plugin):
        if each.name == name:
            return each
    raise KeyError(f"{node} {plugin} {name}".replace("  ", " "))


def plugins_of(node: str) -> frozenset[str]:
    """Classes of plugins of a node that the table knows."""
    return frozenset(each.plugin for each in facts(node) if each.plugin)
