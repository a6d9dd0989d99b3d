"""Static maps from the files of ROS: map.yaml beside a PGM or PNG image (nav2_map_server)."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from qocjax import _checks
from qocjax._reading import check_regular, decoding, read_text
from qocjax.navigation.grid import Grid
from qocjax.navigation.maps import FREE, LETHAL, UNKNOWN, StaticMap

__all__ = ["read_map"]

_MODES = ("trinary", "scale", "raw")
_KEYS = ("image", "resolution", "origin", "occupied_thresh", "free_thresh", "negate", "mode")
_REQUIRED = _KEYS[:5]
_OF_IMAGES = (OSError, SyntaxError)  # what Pillow raises where it cannot read one
_OCCUPIED, _NO_INFORMATION = 100, -1  # of an occupancy grid


def read_map(path: str | Path, trinary_costmap: bool = True) -> StaticMap:
    """Reads a map as Nav2's map server and static layer do (map_io.cpp, static_layer.cpp).

    With p the mean of a pixel's channels from 0 to 1, it is occupied with occ = 1 - p, or p with `negate`. In mode
    `trinary` it is an obstacle above `occupied_thresh`, free below `free_thresh`, else unknown. Mode `scale` spreads
    what is in between over 0 to 100, and a pixel that is not opaque is unknown. In mode `raw` the pixel itself, 0 to
    100, is the occupancy, unknown above.

    Args:
        path: Of the YAML file; `image` in it is relative to its folder.
        trinary_costmap: Nav2's parameter: whether an occupancy above 0 and below 100 is free; else it is a cost in
            proportion, 254 for 100.

    Raises:
        ValueError: A file is not there or cannot be read, or a value is missing or wrong; the message has file and
            line.
    """
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
        check_regular(image)
    except ValueError:
        raise ValueError(f"{values.at('image')}: found no file {str(image)[:200]}") from None
    shade, opacity = _pixels(image)
    occupancy = _occupancy(shade, opacity, negate, mode, (occupied, free))[::-1]  # the first row of an image is its top
    return StaticMap(Grid(resolution, origin, occupancy.shape), _cost(occupancy, trinary_costmap), path.name)


def _occupancy(
    shade: np.ndarray, opacity: np.ndarray | None, negate: bool, mode: str, thresholds: tuple[float, float]
) -> np.ndarray:
    """Occupancy of each pixel: 0 to 100, -1 for unknown."""
    if mode == "raw":
        raw = np.round(shade.mean(axis=-1) * 255)
        return np.where(raw <= _OCCUPIED, raw, _NO_INFORMATION).astype(int)
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


def _cost(occupancy: np.ndarray, trinary_costmap: bool) -> np.ndarray:
    between = FREE if trinary_costmap else occupancy * LETHAL // _OCCUPIED
    known = np.where(occupancy >= _OCCUPIED, LETHAL, between)
    return np.where(occupancy == _NO_INFORMATION, UNKNOWN, known)


def _pixels(path: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """Colours [height, width, 3] and opacity [height, width] of an image, 0 to 1; None where it has no opacity."""
    from PIL import Image  # comes with Matplotlib

    try:
        with decoding(path, "an image", let=_OF_IMAGES), Image.open(path) as image:
            if image.mode.startswith("I"):  # 16 bits of grey
                grey = np.asarray(image, dtype=float) / 65535
                return np.repeat(grey[..., None], 3, axis=-1), None
            clear = "A" in image.getbands() or "transparency" in image.info
            pixels = np.asarray(image.convert("RGBA"), dtype=float) / 255
    except (*_OF_IMAGES, Image.DecompressionBombError) as error:
        words = " ".join(str(error).split()).replace(f" '{path}'", "")
        raise ValueError(f"{path}: is no PGM or PNG image that can be read: {words}") from None
    return pixels[..., :3], pixels[..., 3] if clear else None


class _Values:
    """Values of a YAML file, each with its line."""

    def __init__(self, path: Path) -> None:
        import yaml  # type: ignore[import-untyped,unused-ignore]  # comes with OmegaConf

        self.path = path
        try:
            text = read_text(path)
            with decoding(path, "YAML", let=yaml.YAMLError):
                root = yaml.compose(text, Loader=yaml.SafeLoader)
                content = yaml.safe_load(text)
        except yaml.YAMLError as error:
            mark = getattr(error, "problem_mark", None)
            where = f"{path}, line {mark.line + 1}" if mark else str(path)
            problem = " ".join(str(getattr(error, "problem", None) or error).split())
            raise ValueError(f"{where}: is no YAML: {problem}") from None
        if not isinstance(content, dict):
            raise ValueError(f"{path}: expected lines such as 'image: map.pgm' for {', '.join(_REQUIRED)}")
        self.lines = {key.value: key.start_mark.line + 1 for key, _ in root.value}
        self.content: dict[str, Any] = content
        for key in content.keys() - set(_KEYS):
            warnings.warn(f"{self.at(key)}: is no key of a map and not read", stacklevel=3)
        for key in _REQUIRED:
            if key not in content:
                raise ValueError(f"{path}: has no {key}, expected {', '.join(_REQUIRED)}")

    def at(self, key: str) -> str:
        return f"{self.path}, line {self.lines[key]}: {key}"

    def text(self, key: str) -> str:
        value = self.content[key]
        if not (isinstance(value, str) and value.strip()):
            raise ValueError(f"{self.at(key)}: got {repr(value)[:80]}, expected the name of a file")
        return value

    def number(self, key: str, **bounds: float) -> float:
        return float(_checks.bounded(self.at(key), self.real(key, self.content[key]), shape=(), **bounds))

    def real(self, key: str, value: Any) -> float:
        try:
            return float("a truth" if isinstance(value, bool) else value)  # YAML 1.1 takes 5e-2 for text
        except (TypeError, ValueError):
            raise ValueError(f"{self.at(key)}: got {repr(value)[:80]}, expected a real number") from None

    def origin(self) -> tuple[float, float]:
        value = self.content["origin"]
        if not (isinstance(value, list) and len(value) == 3):
            raise ValueError(f"{self.at('origin')}: got {str(value)[:80]}, expected [x, y, yaw]")
        x, y, yaw = (float(_checks.numbers(self.at("origin"), self.real("origin", each), ())) for each in value)
        if yaw != 0:
            raise ValueError(f"{self.at('origin')}: got yaw {yaw:g}, expected 0: turn the image instead")
        return x, y

    def negate(self) -> bool:
        value = self.content.get("negate", 0)
        if value not in (0, 1):
            raise ValueError(f"{self.at('negate')}: got {repr(value)[:80]}, expected 0 or 1")
        return bool(value)

    def mode(self) -> str:
        value = self.content.get("mode", "trinary")
        value = str(value)[:80].lower()  # as Nav2's map server does
        return _checks.choice(self.at("mode"), value, _MODES) if "mode" in self.content else value
