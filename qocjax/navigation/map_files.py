"""Static maps from the files of ROS: map.yaml beside a PGM, PNG or BMP image (nav2_map_server)."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from qocjax import _checks
from qocjax._reading import read_text, told
from qocjax.cost_values import FREE, LETHAL, UNKNOWN
from qocjax.navigation.grid import Grid
from qocjax.navigation.map_images import bands, size_of
from qocjax.navigation.maps import StaticMap

__all__ = ["read_map"]

_MODES = ("trinary", "scale", "raw")
_KEYS = ("image", "resolution", "origin", "occupied_thresh", "free_thresh", "negate", "mode")
_REQUIRED = _KEYS[:5]
_LONGEST = 1 << 18  # letters of a map's YAML
_OCCUPIED, _NO_INFORMATION = 100, -1  # of an occupancy grid
RELEASES = ("jazzy", "humble")
_LUMA = np.array([0.299, 0.587, 0.114])  # of red, green, blue in grey


def read_map(path: str | Path, trinary_costmap: bool = True, release: str = "jazzy") -> StaticMap:
    """Reads a map as Nav2's map server and static layer do (map_io.cpp, static_layer.cpp).

    With p the grey of a pixel from 0 to 1, it is occupied with occ = 1 - p, or p with `negate`. In mode `trinary` it is
    an obstacle from `occupied_thresh` on, free up to `free_thresh`, else unknown. Mode `scale` spreads what is in
    between over 0 to 100. In mode `raw` the pixel itself, 0 to 100, is the occupancy, unknown above. Since Jazzy a
    pixel that is not opaque is unknown in modes `trinary` and `scale`, and p is the luma of its colours (ITU-R
    BT.601). Up to Iron p is the mean of the channels, in mode `trinary` with the opacity as one of them, only mode
    `scale` has pixels that are not opaque unknown, and the thresholds themselves are in between.

    Args:
        path: Of the YAML file; `image` in it is relative to its folder.
        trinary_costmap: Nav2's parameter: whether an occupancy above 0 and below 100 is free; else it is a cost in
            proportion, 254 for 100.
        release: Of ROS 2, whose map server is meant: `jazzy` for it and later ones, `humble` for those before.

    Raises:
        ValueError: A file is not there or cannot be read, or a value is missing or wrong; the message has file and
            line.
    """
    _checks.choice("release", release, RELEASES)
    path = Path(path)
    values = _Values(path)
    image = path.parent / values.text("image")
    resolution = values.number("resolution", above=0)
    origin = values.origin()
    occupied, free = values.number("occupied_thresh", least=0, most=1), values.number("free_thresh", least=0, most=1)
    if not free < occupied:
        raise ValueError(f"{values.at('free_thresh')}: got {free:g}, expected below occupied_thresh, {occupied:g}")
    negate, mode = values.negate(), values.mode()
    try:
        found = image.is_file()
    except (OSError, ValueError):  # a name that is too long, or holds a NUL
        found = False
    if not found:
        raise ValueError(f"{values.at('image')}: found no file {_shown(values.text('image'))} in {path.parent}")
    rule = _occupancy if release == "jazzy" else _occupancy_humble

    def cost_of(shade: np.ndarray, opacity: np.ndarray | None) -> np.ndarray:
        return _cost(rule(shade, opacity, negate, mode, (occupied, free)), trinary_costmap)

    cost = _costs(image, cost_of)
    return StaticMap(Grid(resolution, origin, cost.shape), cost, path.name)


def _costs(image: Path, cost_of: Callable[[np.ndarray, np.ndarray | None], np.ndarray]) -> np.ndarray:
    """Costs [rows, cols] of an image, worked out some rows at a time; the first row of an image is its top."""
    cost = np.empty(size_of(image), np.uint8)
    for first, shade, opacity in bands(image):
        cost[first : first + len(shade)] = cost_of(shade, opacity)
    return cost[::-1]


def _occupancy(
    shade: np.ndarray, opacity: np.ndarray | None, negate: bool, mode: str, thresholds: tuple[float, float]
) -> np.ndarray:
    """Occupancy of each pixel since Jazzy: 0 to 100, -1 for unknown."""
    grey = np.rint(255.0 * shade @ _LUMA)  # the map server goes on with eight bits
    if mode == "raw":
        return _raw(grey)
    light = grey / 255.0
    occ = light if negate else 1.0 - light
    occupied, free = thresholds
    between = np.rint((occ - free) / (occupied - free) * _OCCUPIED) if mode == "scale" else _NO_INFORMATION
    found = np.where(occ <= free, 0, np.where(occ >= occupied, _OCCUPIED, between))
    return np.where(opacity < 1, _NO_INFORMATION, found).astype(int) if opacity is not None else found.astype(int)


def _occupancy_humble(
    shade: np.ndarray, opacity: np.ndarray | None, negate: bool, mode: str, thresholds: tuple[float, float]
) -> np.ndarray:
    """Occupancy of each pixel up to Iron: 0 to 100, -1 for unknown."""
    if mode == "raw":
        return _raw(np.round(shade.mean(axis=-1) * 255))
    if mode == "trinary" and opacity is not None:  # the map server counts the opacity as one more channel
        shade = np.concatenate([shade, opacity[..., None]], axis=-1)
    light = shade.mean(axis=-1)
    occ = light if negate else 1 - light
    occupied, free = thresholds
    between = np.rint((occ - free) / (occupied - free) * _OCCUPIED) if mode == "scale" else _NO_INFORMATION
    found = np.where(occ > occupied, _OCCUPIED, np.where(occ < free, 0, between))
    if mode == "scale" and opacity is not None:
        found = np.where(opacity < 1, _NO_INFORMATION, found)
    return found.astype(int)


def _raw(grey: np.ndarray) -> np.ndarray:
    return np.where(grey <= _OCCUPIED, grey, _NO_INFORMATION).astype(int)


def _cost(occupancy: np.ndarray, trinary_costmap: bool) -> np.ndarray:
    between = FREE if trinary_costmap else occupancy * LETHAL // _OCCUPIED
    known = np.where(occupancy >= _OCCUPIED, LETHAL, between)
    return np.where(occupancy == _NO_INFORMATION, UNKNOWN, known)


class _Values:
    """Values of a YAML file, each with its line."""

    def __init__(self, path: Path) -> None:
        import yaml  # type: ignore[import-untyped,unused-ignore]  # comes with OmegaConf

        from qocjax._yaml import composed

        self.path = path
        text = read_text(path)
        try:
            root: Any = composed(text, most=_LONGEST)
            content = yaml.safe_load(text)
        except yaml.YAMLError as error:
            mark = getattr(error, "problem_mark", None)
            where = f"{path}, line {mark.line + 1}" if mark else str(path)
            raise ValueError(f"{where}: is no YAML: {getattr(error, 'problem', None) or told(error)}") from None
        except Exception as error:  # nested too deep, a date that is none, a number of ten thousand digits
            raise ValueError(f"{path}: is no YAML: {told(error)}") from None
        if not isinstance(content, dict):
            raise ValueError(f"{path}: expected lines such as 'image: map.pgm' for {', '.join(_REQUIRED)}")
        self.lines = {str(key.value): key.start_mark.line + 1 for key, _ in root.value}
        self.content: dict[str, Any] = {str(key): value for key, value in content.items()}
        for key in self.content.keys() - set(_KEYS):
            warnings.warn(f"{self.at(key)}: is no key of a map and not read", stacklevel=3)
        for key in _REQUIRED:
            if key not in self.content:
                raise ValueError(f"{path}: has no {key}, expected {', '.join(_REQUIRED)}")

    def at(self, key: str) -> str:
        return f"{self.path}, line {self.lines.get(key, 1)}: {key}"

    def text(self, key: str) -> str:
        value = self.content[key]
        if not (isinstance(value, str) and value.strip()):
            raise ValueError(f"{self.at(key)}: got {_shown(value)}, expected the name of a file")
        return value

    def number(self, key: str, **bounds: float) -> float:
        return float(_checks.bounded(self.at(key), self.real(key, self.content[key]), shape=(), **bounds))

    def real(self, key: str, value: Any) -> float:
        try:
            return float("a truth" if isinstance(value, bool) else value)  # YAML 1.1 takes 5e-2 for text
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"{self.at(key)}: got {_shown(value)}, expected a real number") from None

    def origin(self) -> tuple[float, float]:
        value = self.content["origin"]
        if not (isinstance(value, list) and len(value) == 3):
            raise ValueError(f"{self.at('origin')}: got {_shown(value)}, expected [x, y, yaw]")
        x, y, yaw = (float(_checks.numbers(self.at("origin"), self.real("origin", each), ())) for each in value)
        if yaw != 0:
            raise ValueError(f"{self.at('origin')}: got yaw {yaw:g}, expected 0: turn the image instead")
        return x, y

    def negate(self) -> bool:
        value = self.content.get("negate", 0)
        if value not in (0, 1):
            raise ValueError(f"{self.at('negate')}: got {_shown(value)}, expected 0 or 1")
        return bool(value)

    def mode(self) -> str:
        value = self.content.get("mode", "trinary")
        value = str(value)[:80].lower()  # as Nav2's map server does
        return _checks.choice(self.at("mode"), value, _MODES) if "mode" in self.content else value


def _shown(value: Any) -> str:
    try:
        text = repr(value)
    except ValueError:  # Python refuses to write integers of thousands of digits
        return "a number too long to show"
    return text if len(text) <= 80 else f"{text[:80]}…"
