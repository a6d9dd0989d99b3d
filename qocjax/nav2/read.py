"""A user's `nav2_params.yaml`: the parameters that have a meaning in the simulated loop, and what is left alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from qocjax._reading import read_text
from qocjax._yaml import plain
from qocjax.nav2.checks import LIMITS, check_limits, qos_remarks
from qocjax.nav2.document import Document, Found, Value
from qocjax.nav2.facts import Fact, facts, plugins_of
from qocjax.nav2.known import CRITICS, DWB, HANDLER, INFLATION, MPPI, RPP, SHIM, SIMPLE_GOAL, goal_checker

__all__ = ["NavParams", "Plugin", "params_of", "read_params"]

_NODES = ("controller_server", "local_costmap/local_costmap", "velocity_smoother", "collision_monitor")
_TYPES = {"double": (float, int), "integer": (int, float), "bool": (bool,), "string": (str,)}


@dataclass(frozen=True)
class Plugin:
    """A controller, goal checker or layer."""

    name: str  # as its parameters begin, with a dot between parts
    kind: str  # its class; empty where the file does not say
    values: Mapping[str, Value]  # what the file gives, by the names of `facts.csv`


@dataclass(frozen=True)
class NavParams:
    """What a file says; what it leaves out is missing, not a default.

    Attributes:
        path: How messages call the file.
        namespace: Of the controller server that is read; others are left alone.
        values: Parameters of the nodes themselves, by node and name.
        controllers: Those of known classes; behind a rotation shim, the controller it wraps.
        shims: Rotation shims.
        goal: The first goal checker, if its class is known.
        inflation: The inflation of the local costmap.
        handler: The first path handler, if its class is known; Nav2 has them from Lyrical on.
        unknown: Plugins and critics that mean nothing here, and why.
        remarks: What Nav2 would refuse or take otherwise, with lines.
    """

    path: str
    namespace: tuple[str, ...]
    values: Mapping[tuple[str, str], Value]
    controllers: tuple[Plugin, ...]
    shims: tuple[Plugin, ...]
    goal: Plugin | None
    inflation: Plugin | None
    handler: Plugin | None
    unknown: tuple[str, ...]
    remarks: tuple[str, ...]

    def number(self, node: str, name: str) -> float | None:
        """A number of a node itself."""
        value = self.values.get((node, name))
        return float(value) if isinstance(value, (int, float)) else None

    def limits(self, name: str) -> tuple[float, ...] | None:
        """A list of the velocity smoother: m/s or m/s2, with the turn rate or its change last."""
        value = self.values.get(("velocity_smoother", name))
        return tuple(float(item) for item in value) if isinstance(value, list) else None

    @property
    def frequency(self) -> float | None:
        """Cycles of the controller (1/s)."""
        return self.number("controller_server", "controller_frequency")

    @property
    def v_max(self) -> float | None:
        """Cap of the speed (m/s): the lower of the controller's and the smoother's."""
        names = {MPPI: ("vx_max",), DWB: ("max_vel_x",), RPP: ("desired_linear_vel", "max_linear_vel")}
        return _least(self._cap(names), self.limits("max_velocity"), 0)

    @property
    def omega_max(self) -> float | None:
        """Cap of the turn rate (rad/s): the lower of the controller's and the smoother's."""
        names = {MPPI: ("wz_max",), DWB: ("max_vel_theta",), RPP: ("max_angular_vel",)}
        return _least(self._cap(names), self.limits("max_velocity"), -1)

    @property
    def ax_max(self) -> float | None:
        """Of the smoother, how fast the speed grows (m/s2)."""
        return _of(self.limits("max_accel"), 0)

    @property
    def ax_min(self) -> float | None:
        """Of the smoother, how fast the speed shrinks, negative (m/s2)."""
        return _of(self.limits("max_decel"), 0)

    @property
    def az_max(self) -> float | None:
        """Of the smoother, how fast the turn rate changes either way (rad/s2)."""
        rates = (_of(self.limits(name), -1) for name in ("max_accel", "max_decel"))
        return min((abs(rate) for rate in rates if rate is not None), default=None)

    @property
    def radius(self) -> float | None:
        """Of the robot, or of the circle around the origin that holds its footprint (m)."""
        points = _points(self.values.get(("local_costmap/local_costmap", "footprint")))
        if points:
            return max(math.hypot(x, y) for x, y in points)
        return self.number("local_costmap/local_costmap", "robot_radius")

    def _cap(self, names: Mapping[str, Sequence[str]]) -> float | None:
        for plugin in self.controllers[:1]:
            for name in names[plugin.kind]:
                if name in plugin.values:
                    return float(plugin.values[name])  # type: ignore[arg-type]  # a double, by the table
        return None


def read_params(path: str | Path) -> NavParams:
    """Reads a parameter file of Nav2.

    Raises:
        ValueError: It cannot be read, ROS's parser would refuse it, it has no controller server, or a value is of
            another kind than expected; one line with file and line.
    """
    return params_of(Document(read_text(path).replace("\r\n", "\n"), str(path)))


def params_of(document: Document) -> NavParams:
    """What a file says, see `read_params`."""
    spaces = document.namespaces("controller_server")
    if not spaces:
        raise document.fail(1, "got no controller_server, expected the parameters of Nav2")
    reader = _Reader(document, spaces[0])
    values = {(node, name): value for node in _NODES for name, value in reader.values(node, "", "").items()}
    controllers, shims = reader.controllers(values.get((_NODES[0], "controller_plugins"), ["FollowPath"]))
    reader.unknown += [f"controller_server of /{'/'.join(each)}: another robot's" for each in spaces[1:]]
    for section in document.sections:
        for found in document.of(section):
            reader.remarks += [f"{document.name}:{found.line}: {each}" for each in qos_remarks(found)]
            if found.name == "cmd_vel_timeout":
                known = facts("diff_drive_controller")[0]
                values["/".join(section.path), "cmd_vel_timeout"] = reader.checked(found, known)
    check_limits({name: reader.find("velocity_smoother", name) for name in LIMITS}, document)
    return NavParams(
        path=document.name, namespace=spaces[0], values=values, controllers=controllers, shims=shims,
        goal=reader.goal(values.get((_NODES[0], "goal_checker_plugins"), ["goal_checker"])),
        inflation=reader.inflation(), handler=reader.handler(), unknown=tuple(reader.unknown),
        remarks=tuple(reader.remarks),
    )  # fmt: skip


class _Reader:
    """Reads by the table, and keeps what it has to say."""

    def __init__(self, document: Document, namespace: tuple[str, ...]) -> None:
        self.document, self.namespace = document, namespace
        self.unknown: list[str] = []
        self.remarks: list[str] = []

    def find(self, node: str, name: str) -> Found | None:
        return self.document.find(self.namespace, node, name)

    def values(self, node: str, plugin: str, prefix: str) -> dict[str, Value]:
        found = {each.name: (each, self.find(node, prefix + each.name)) for each in facts(node, plugin)}
        return {name: self.checked(value, each) for name, (each, value) in found.items() if value is not None}

    def checked(self, found: Found, known: Fact) -> Value:
        """A value of the type that Nav2 declares; a number of the other kind is remarked, anything else an error."""
        base, listed = known.type.removesuffix("_array"), known.type.endswith("_array")
        items = found.value if isinstance(found.value, list) else [found.value]
        types = _TYPES[base]
        if isinstance(found.value, list) != listed or any(type(item) not in types for item in items):
            raise self.document.fail(found.line, f"{found.name}: got {found.value!r}, expected {known.type}")
        if base in ("double", "integer"):
            if any(type(item) is not types[0] for item in items):
                self.remarks.append(f"{self.document.name}:{found.line}: {found.name} is {found.value}; Nav2 declares "
                                    f"it {known.type} and refuses this")  # fmt: skip
            if not all(math.isfinite(item) for item in items):  # type: ignore[arg-type]  # numbers
                raise self.document.fail(found.line, f"{found.name}: got {found.value}, expected a finite number")
            items = [types[0](item) for item in items]
        return items if listed else items[0]  # type: ignore[return-value]  # all of one type

    def kind(self, node: str, name: str) -> str:
        found = self.find(node, f"{name}.plugin")
        return str(found.value).replace("/", "::") if found else ""

    def controllers(self, names: Value) -> tuple[tuple[Plugin, ...], tuple[Plugin, ...]]:
        node, controllers, shims = _NODES[0], [], []
        for name in names if isinstance(names, list) else []:
            kind = self.kind(node, str(name))
            if kind == SHIM:
                values = self.values(node, SHIM, f"{name}.")
                shims.append(Plugin(str(name), kind, values))
                later = values.get("primary_controller.plugin")
                kind = str(later or values.get("primary_controller", "")).replace("/", "::")
                name = f"{name}.primary_controller" if later else name
            if kind in (MPPI, DWB, RPP):
                plugin = Plugin(str(name), kind, self.values(node, kind, f"{name}."))
                controllers.append(plugin)
                critics = plugin.values.get("critics", [])
                self.unknown += [f"{name}.{each}: no such critic in the simulated stack"
                                 for each in (critics if isinstance(critics, list) else []) if each not in CRITICS
                                 ]  # fmt: skip
            else:
                self.unknown.append(f"{name}: {kind or 'no plugin is given'}")
        return tuple(controllers), tuple(shims)

    def goal(self, names: Value) -> Plugin | None:
        for name in names[:1] if isinstance(names, list) else []:
            kind = self.kind(_NODES[0], str(name))
            if goal_checker(kind):
                return Plugin(str(name), kind, self.values(_NODES[0], SIMPLE_GOAL, f"{name}."))
            self.unknown.append(f"{name}: {kind or 'no plugin is given'}")
        return None

    def handler(self) -> Plugin | None:
        names = self.find(_NODES[0], "path_handler_plugins")
        for name in names.value[:1] if names and isinstance(names.value, list) else []:
            kind = self.kind(_NODES[0], str(name))
            if kind == HANDLER:
                return Plugin(str(name), HANDLER, self.values(_NODES[0], HANDLER, f"{name}."))
            self.unknown.append(f"{name}: {kind or 'no plugin is given'}")
        return None

    def inflation(self) -> Plugin | None:
        node = _NODES[1]
        names = self.find(node, "plugins")
        for name in names.value if names and isinstance(names.value, list) else ["inflation_layer"]:
            if self.kind(node, str(name)) in plugins_of(node):
                return Plugin(str(name), INFLATION, self.values(node, INFLATION, f"{name}."))
        return None


def _least(cap: float | None, limits: tuple[float, ...] | None, index: int) -> float | None:
    """The lower of two caps, one of which may be missing."""
    known = [each for each in (cap, _of(limits, index)) if each is not None]
    return min(known) if known else None


def _of(limits: tuple[float, ...] | None, index: int) -> float | None:
    """One of a list that may be missing."""
    return limits[index] if limits else None


def _points(footprint: Value | None) -> list[tuple[float, float]]:
    """Corners of a footprint such as "[[0.3, 0.2], [-0.3, 0.2], ...]" (m); none where it gives none."""
    try:
        corners = plain(footprint) if isinstance(footprint, str) else None
    except (yaml.YAMLError, ValueError, RecursionError):
        return []
    return list(_pairs(corners)) if isinstance(corners, list) and len(corners) > 2 else []


def _pairs(corners: list) -> Iterator[tuple[float, float]]:
    for corner in corners:
        if isinstance(corner, list) and len(corner) == 2 and all(isinstance(each, (int, float)) for each in corner):
            yield float(corner[0]), float(corner[1])
