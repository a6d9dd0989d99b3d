"""What `--help` tells of a command: its own choices, and a line for each option from the comments of the YAML files."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from hydra.core.global_hydra import GlobalHydra
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from qocjax._conf import add_resolver

__all__ = [
    "Remarks", "choices_of", "choices_text", "described", "offered", "options_of", "options_text", "read_remarks",
    "register_help", "remarks_of",
]  # fmt: skip

_WIDTH, _COLUMN, _LONGEST = 118, 44, 60
_OWN = ("help", "output", "maps")  # groups that are parts of the program
_UNIT = re.compile(r"(s|m|ms|rad|1/s|1/m|m/s|rad/s)(?=;|$)")
# Choices that exist for others, and that a command would refuse.
_REFUSED = {
    **{(command, "controller"): {"cbf", "custom", "navigation"} for command in ("fleet", "qos")},
    ("qos", "network"): {"cell", "kth_5g", "loop", "paper", "trace"},
    ("fleet", "network"): {"trace"},
}

Path_ = tuple[str, ...]


@dataclass
class Remarks:
    """What the comments of YAML files say of their keys."""

    text: dict[Path_, str] = field(default_factory=dict)  # by the path of the key
    inline: set[Path_] = field(default_factory=set)  # keys with a mapping in braces


def register_help() -> None:
    """Makes `${own_choices:}` and `${own_options:}` known to the templates of `conf/help/`."""
    for name, make in (("own_choices", choices_text), ("own_options", options_text)):
        add_resolver(name, lambda *, _root_, make=make: make(_root_).replace("$", "$$"))


def choices_text(cfg: DictConfig) -> str:
    """The groups that a composed configuration has, a line each with what there is to choose; nothing without any."""
    lines = []
    for choice, chosen in choices_of(cfg).items():
        names = offered(cfg, choice.split("@")[0])
        if names and names != [chosen]:
            lines += textwrap.wrap(f"{choice}: {', '.join(names)}", _WIDTH, subsequent_indent="    ")
    return "\n".join(["Choices (option=name picks a file of the configuration):", *lines, "", ""]) if lines else ""


def choices_of(cfg: DictConfig) -> dict[str, str]:
    """The groups of a composed configuration, each with what is chosen; without those that are parts of the program."""
    every = reversed(cfg.hydra.runtime.choices.items())
    return {
        choice: chosen
        for choice, chosen in every
        if not choice.startswith("hydra/") and choice.split("@")[0] not in _OWN
    }


def offered(cfg: DictConfig, group: str) -> list[str]:
    """What there is to choose in a group, without what the command would refuse."""
    refused = _REFUSED.get((cfg.hydra.job.config_name, group), set())
    names = [name for name in GlobalHydra.instance().config_loader().get_group_options(group) if name not in refused]
    return [name for name in names if group != "experiment" or _fits(cfg, name)]


def _fits(cfg: DictConfig, name: str) -> bool:
    """Whether an experiment changes only what the command has, to what it takes."""
    content = yaml.safe_load(_file_of(f"experiment/{name}").read_text(encoding="utf-8"))
    groups = {choice.split("@")[0] for choice in cfg.hydra.runtime.choices}
    for item in content.pop("defaults", []):
        for key, option in item.items() if isinstance(item, dict) else ():
            group = key.removeprefix("override").strip(" /").split("@")[0]
            if group not in groups or option in _REFUSED.get((cfg.hydra.job.config_name, group), ()):
                return False
    return set(content) <= set(cfg.keys())


def options_text(cfg: DictConfig) -> str:
    """Every option as it is given, with its value and what it does."""
    lines: list[str] = []
    remarks, section = remarks_of(cfg), ""
    for path, value in options_of(cfg, remarks):
        if lines and (path[0] != section) and (len(path) > 1 or section):
            lines.append("")
        section = path[0] if len(path) > 1 else ""
        needed = "; must be given" if value == "???" else ""
        lines += _line(f"{'.'.join(path)}={'...' if needed else _shown(value)}", described(path, remarks) + needed)
    return "\n".join(lines)


def options_of(cfg: DictConfig, remarks: Remarks) -> list[tuple[Path_, Any]]:
    """The path and the value of each option of a composed configuration, interpolations as they are."""
    content: Any = OmegaConf.to_container(cfg, resolve=False)
    return [*_options({key: value for key, value in content.items() if key != "hydra"}, remarks)]


def _options(content: dict[str, Any], remarks: Remarks, at: Path_ = ()) -> Iterator[tuple[Path_, Any]]:
    """Options and their values; a mapping in braces whose parts have no words of their own is one option."""
    for key, value in content.items():
        path = (*at, str(key))
        whole = path in remarks.inline and not any(each[: len(path)] == path != each for each in remarks.text)
        if isinstance(value, dict) and value and not whole:
            yield from _options(value, remarks, path)
        else:
            yield path, value


def described(path: Path_, remarks: Remarks) -> str:
    """What the comments say of an option; what has none, or a unit alone, shares that of its part."""
    own = remarks.text.get(path, "")
    if not own or _UNIT.fullmatch(own):
        above = next((remarks.text[path[:k]] for k in range(len(path) - 1, 0, -1) if path[:k] in remarks.text), "")
        return "; ".join(filter(None, (own, above)))
    return own


def _line(option: str, text: str) -> list[str]:
    indent = " " * _COLUMN
    begin = option if len(option) > _COLUMN - 2 else option.ljust(_COLUMN) + text
    lines = textwrap.wrap(begin, _WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    if begin == option and text:
        lines = [option, *textwrap.wrap(text, _WIDTH, initial_indent=indent, subsequent_indent=indent)]
    return lines


def _shown(value: Any) -> str:
    """A value as the command line takes it; of long lists the ends."""
    if isinstance(value, list):
        parts = [_shown(each) for each in value]
        short = len(",".join(parts)) > _LONGEST and len(parts) > 4
        return f"[{','.join([*parts[:3], '...', parts[-1]] if short else parts)}]"
    if isinstance(value, dict):
        return "{" + ",".join(f"{key}:{_shown(each)}" for key, each in value.items()) + "}"
    if value is None or isinstance(value, bool):
        return "null" if value is None else str(value).lower()
    return f"{value:g}" if isinstance(value, float) and float(f"{value:g}") == value else str(value)


def remarks_of(cfg: DictConfig) -> Remarks:
    """Returns the comments of all files of a composed configuration; the last that says something holds."""
    loader = GlobalHydra.instance().config_loader()
    options = [*cfg.hydra.overrides.hydra, *cfg.hydra.overrides.task]
    every = Remarks()
    for each in loader.compute_defaults_list(cfg.hydra.job.config_name, options, RunMode.RUN).defaults:
        if each.config_path is None or each.config_path.split("/")[0] in ("hydra", *_OWN):
            continue
        at = tuple(each.package.split(".")) if each.package else ()
        found = read_remarks(_file_of(each.config_path))
        new = {(*at, *path): text for path, text in found.text.items()}
        # An experiment's remark is on its value.
        every.text = new | every.text if each.config_path.startswith("experiment/") else every.text | new
        every.inline |= {(*at, *path) for path in found.inline}
    return every


def _file_of(name: str) -> Path:
    places = [each.path for each in GlobalHydra.instance().config_loader().get_search_path().get_path()]
    files = [Path(place.removeprefix("file://")) / f"{name}.yaml" for place in places if "pkg://" not in place]
    return next(file for file in files if file.is_file())


def read_remarks(file: Path) -> Remarks:
    """Reads the comments of a YAML file: behind a key's value and on indented lines below, or on the lines above it."""
    text = file.read_text(encoding="utf-8")
    lines, ends = text.splitlines(), dict[int, int]()
    for token in yaml.scan(text):
        if token.end_mark.index > token.start_mark.index:
            ends[token.end_mark.line] = token.end_mark.column
    behind = {k: line[ends.get(k, 0) :].strip() for k, line in enumerate(lines)}
    comments = {k: rest for k, rest in behind.items() if rest.startswith("#")}
    remarks, head = Remarks(), next((k for k in range(len(lines)) if not lines[k].startswith("#")), 0)

    def alone(line: int, where: range) -> bool:
        return line in comments and line not in ends and lines[line].index("#") in where and line >= head

    def visit(node: yaml.Node | None, at: Path_) -> None:
        if not isinstance(node, yaml.MappingNode):
            return
        for key, value in node.value:
            path, first, column = (*at, str(key.value)), key.start_mark.line, key.start_mark.column
            leaf = not isinstance(value, yaml.MappingNode) or value.flow_style
            last = value.end_mark.line if leaf and value.end_mark.column else first
            said = [k for k in dict.fromkeys((first, last)) if k in comments][:1]
            if said:
                while alone(said[-1] + 1, range(column + 1, 200)):
                    said.append(said[-1] + 1)
            else:
                while alone(first - 1 - len(said), range(column, column + 1)):
                    said.insert(0, first - 1 - len(said))
            if said:
                remarks.text[path] = " ".join(comments[k].lstrip("# ") for k in said)
            if isinstance(value, yaml.MappingNode) and value.flow_style and value.value:
                remarks.inline.add(path)
            elif path != ("defaults",):
                visit(value, path)

    visit(yaml.compose(text), ())
    return remarks
