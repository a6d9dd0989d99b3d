"""Tables of poses: a row a pose, PlotJuggler's CSV of topics, and the long CSV of Foxglove's plots."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from qocjax.network.columns import names_of, read_columns
from qocjax.network.values import Columns
from qocjax.recorded.patterns import matched

__all__ = ["PosesFormat", "read_poses"]

_FOXGLOVE = {"receive time", "header.stamp", "topic", "value"}
_LEAF = re.compile(r"(.*?)((?:[/.]pose)*)[/.](?:position[/.])?x")


@dataclass(frozen=True)
class PosesFormat:
    """Names of the columns of a table of poses; None for those that the format has."""

    time: str | None = None
    x: str | None = None
    y: str | None = None
    heading: str | None = None
    robot: str | None = None
    topics: tuple[str, ...] = ()  # patterns that names of topics are taken apart by

    def found_in(self, names: list[str]) -> bool:
        """Whether a table with these names is one."""
        if self.time is not None and self.x is not None and self.y is not None:
            return {self.time, self.x, self.y} <= set(names)
        return (
            {"time", "robot", "x", "y"} <= set(names) or _FOXGLOVE <= set(names)
            or ("__time" in names and bool(_topics(names)))
        )  # fmt: skip

    def robot_of(self, topic: str) -> str:
        """The robot whose poses a topic has."""
        for pattern in self.topics:
            if (found := matched(pattern, topic)) is not None:
                return found.get("robot", "robot")
        return topic.strip("/").replace("/", "_") or "robot"


def read_poses(path: Path, layout: PosesFormat) -> pd.DataFrame:
    """Time (s), robot, x, y (m), heading (rad), nu, omega; 0 or empty where the table has none of the last three.

    Raises:
        ValueError: A column is missing, or an entry is no number.
    """
    names = names_of(path)
    if layout.time is not None and layout.x is not None and layout.y is not None:
        return _named(path, layout, names)
    if {"time", "robot", "x", "y"} <= set(names):
        return _plain(path, names)
    return _foxglove(path, layout) if _FOXGLOVE <= set(names) else _plotjuggler(path, layout, names)


def _plain(path: Path, names: list[str]) -> pd.DataFrame:
    more = [name for name in ("heading", "nu", "omega") if name in names]
    found = read_columns(path, ["time", "robot", "x", "y", *more])
    return _frame(path, found, "time", found.texts["robot"], {name: name for name in ("x", "y", *more)})


def _named(path: Path, layout: PosesFormat, names: list[str]) -> pd.DataFrame:
    given = {"x": layout.x, "y": layout.y, "heading": layout.heading}
    columns = {name: column for name, column in given.items() if column is not None}
    found = read_columns(path, [str(layout.time), *columns.values(), *([layout.robot] if layout.robot else [])])
    robots = found.texts[layout.robot] if layout.robot else ["robot"] * len(found.lines)
    return _frame(path, found, str(layout.time), robots, columns)


def _frame(path: Path, found: Columns, time: str, robots: list[str], columns: dict[str, str]) -> pd.DataFrame:
    values, scale = found.times(time)
    table = pd.DataFrame({"time": pd.Series([None if v is None else v / (scale or 1.0) for v in values], dtype=float)})
    table["robot"] = robots
    for name, column in columns.items():
        table[name] = pd.Series(found.optional_numbers(column), dtype=float)
    for name in ("heading", "nu", "omega"):
        if name not in table:
            table[name] = 0.0 if name == "heading" else float("nan")
    if table["time"].isna().any():
        raise ValueError(f"{path}, row {int(table['time'].isna().idxmax()) + 1}: has no time, expected seconds")
    return table


def _topics(names: list[str]) -> dict[str, tuple[str, str]]:
    """Of each topic with a position, the names of its x and y."""
    found = {}
    for name in names:
        part = _LEAF.fullmatch(name)
        y = name[:-1] + "y"
        if part is not None and y in names and part[1] not in found and ("position" in name or part[2]):
            found[part[1]] = (name, y)
    return found


def _plotjuggler(path: Path, layout: PosesFormat, names: list[str]) -> pd.DataFrame:
    """A column a value of a topic, over `__time`; rows of other topics have no entry."""
    parts = []
    for topic, (x, y) in _topics(names).items():
        base = re.sub(r"position[/.]x$", "orientation", x)
        mark = base[-len("orientation") - 1]
        angles = [f"{base}{mark}{each}" for each in ("yaw", "x", "y", "z", "w")]
        table = read_columns(path, ["__time", x, y, *(name for name in angles if name in names)])
        frame = _frame(path, table, "__time", [layout.robot_of(topic)] * len(table.lines), {"x": x, "y": y})
        if angles[0] in names:
            frame["heading"] = pd.Series(table.optional_numbers(angles[0]), dtype=float)
        elif set(angles[1:]) <= set(names):
            frame["heading"] = _yaw(*(np.array(pd.Series(table.optional_numbers(a), dtype=float)) for a in angles[1:]))
        parts.append(frame.dropna(subset=["x", "y"]).fillna({"heading": 0.0}))
    return pd.concat(parts, ignore_index=True)


def _foxglove(path: Path, layout: PosesFormat) -> pd.DataFrame:
    """A row a value of a message path such as `/odom.pose.pose.position.x`, with the time of receipt."""
    found = read_columns(path, ["receive time", "topic", "value"])
    time, scale = found.times("receive time")
    long = pd.DataFrame({"time": pd.Series(time, dtype=float) / (scale or 1.0), "topic": found.texts["topic"]})
    long["value"] = pd.Series(found.optional_numbers("value"), dtype=float)
    wide = long.pivot_table(index="time", columns="topic", values="value", aggfunc="first")
    parts = []
    for topic, (x, y) in _topics(list(wide.columns)).items():
        frame = wide[[x, y]].dropna().set_axis(["x", "y"], axis=1).reset_index()
        base = x.removesuffix("position.x") + "orientation."
        angles = [wide.get(base + each) for each in "xyzw"]
        heading = (
            0.0 if any(each is None for each in angles) else _yaw(*(each[frame["time"]].to_numpy() for each in angles))
        )
        parts.append(frame.assign(robot=layout.robot_of(topic), heading=heading, nu=np.nan, omega=np.nan))
    if not parts:
        raise ValueError(f"{path}: holds no position, expected topics such as '/odom.pose.pose.position.x' and y")
    return pd.concat(parts, ignore_index=True).fillna({"heading": 0.0})


def _yaw(x: np.ndarray, y: np.ndarray, z: np.ndarray, w: np.ndarray) -> np.ndarray:
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
