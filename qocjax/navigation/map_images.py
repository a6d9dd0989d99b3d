"""Pictures of maps, some rows at a time: of three formats alone, and of no more pixels than memory is meant for."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from qocjax._reading import check_regular, told

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["MOST_PIXELS", "bands", "size_of"]

# What Pillow may take a file for: others have readers that start programs (EPS) or hold several pictures.
_FORMATS = ("PPM", "PNG", "BMP")  # PPM is PGM too
MOST_PIXELS = 150_000_000  # about 12 000 x 12 000: 600 m at 5 cm
_AT_ONCE = 1 << 18  # pixels of a band


def size_of(path: Path) -> tuple[int, int]:
    """Rows and columns of a picture, once it is known to be whole as far as its checksums say.

    Raises:
        ValueError: It is no PGM, PNG or BMP image, it is damaged, or it has too many pixels.
    """
    check_regular(path)
    with _opened(path) as image:
        width, height = image.size
        if width * height > MOST_PIXELS:
            raise ValueError(f"{path}: has {width} x {height} pixels, expected at most "
                             f"{MOST_PIXELS / 1e6:.0f} million: a part of it, or a coarser resolution")  # fmt: skip
        image.verify()
    return height, width


def bands(path: Path) -> Iterator[tuple[int, np.ndarray, np.ndarray | None]]:
    """The first row, colours [rows, width, 3] and opacity [rows, width] of bands of a picture, from its top.

    Numbers are from 0 to 1; opacity is None where a picture has none.

    Raises:
        ValueError: It cannot be read.
    """
    with _opened(path) as image:
        if image.mode == "F":
            raise ValueError(f"{path}: got a picture of fractions (PFM), expected 8 or 16 bits a pixel")
        image.load()
        width, height = image.size
        rows = max(1, _AT_ONCE // width)
        for first in range(0, height, rows):
            yield first, *_of_band(image, (0, first, width, min(first + rows, height)))


def _of_band(image: Image, box: tuple[int, int, int, int]) -> tuple[np.ndarray, np.ndarray | None]:
    part = image.crop(box)
    if image.mode.startswith("I"):  # 16 bits of grey
        return np.repeat((np.asarray(part, dtype=float) / 65535)[..., None], 3, axis=-1), None
    pixels = np.asarray(part.convert("RGBA"), dtype=float) / 255
    clear = "A" in image.getbands() or "transparency" in image.info
    return pixels[..., :3], pixels[..., 3] if clear else None


@contextmanager
def _opened(path: Path) -> Iterator[Image]:
    """A picture; whatever its decoder raises ends in one line."""
    from PIL import Image  # comes with Matplotlib

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # asked here, by a lower limit
            image = Image.open(path, formats=_FORMATS)
        with image:
            yield image
    except Exception as error:  # decoders raise what they like: SyntaxError, struct.error, MemoryError, a bomb
        if isinstance(error, ValueError) and str(error).startswith(f"{path}: "):
            raise
        words = told(error).replace(f" '{path}'", "")
        raise ValueError(f"{path}: is no PGM, PNG or BMP image that can be read: {words}") from None
