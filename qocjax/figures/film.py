"""Frames into a file: GIF with Pillow, MP4 with ffmpeg."""

from __future__ import annotations

import itertools
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from qocjax.store import written

__all__ = ["FORMATS", "find_ffmpeg", "write_film"]

FORMATS = ("gif", "mp4")

_LAST = 1500  # ms that a GIF rests on its last frame before it begins anew
_WHITE = 247  # from which on a grey is drawn as white
_SAMPLES = 12  # frames that the palette is taken from

Frame = NDArray[np.uint8]  # [height, width, 3]


def write_film(frames: Iterator[Frame], path: Path, fps: float) -> Path:
    """Writes frames of equal size to a file whose suffix says how.

    Args:
        frames: [height, width, 3] each.
        path: `.gif` or `.mp4`.
        fps: Frames per second; a GIF keeps whole hundredths of a second.

    Raises:
        ValueError: Another suffix, or an MP4 where there is no ffmpeg.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise ValueError(f"path: got '{path.name}', expected a name that ends in {' or '.join(FORMATS)}")
    if kind == "gif":
        return written(path, lambda file: _write_gif(list(frames), file, fps))
    ffmpeg = find_ffmpeg()
    return written(path, lambda file: _write_mp4(frames, file, fps, ffmpeg))


def find_ffmpeg() -> str:
    """The program that writes MP4.

    Raises:
        ValueError: It is not installed.
    """
    found = shutil.which("ffmpeg")
    if found is None:
        raise ValueError("format: got mp4, but there is no ffmpeg on this machine: install it, or choose gif")
    return found


def _write_gif(frames: list[Frame], path: Path, fps: float) -> None:
    """One palette for all frames and no dithering, so that what stands still costs no bytes."""
    palette = _palette(frames)
    images = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    # Each frame begins at the nearest hundredth of a second, so that roundings do not add up.
    begins = np.round(100.0 * np.arange(len(images) + 1) / fps)
    durations = [int(10 * ms) for ms in np.diff(begins)]
    durations[-1] = max(durations[-1], _LAST)
    images[0].save(path, save_all=True, append_images=images[1:], duration=durations, loop=0, optimize=True)


def _palette(frames: list[Frame]) -> Image.Image:
    chosen = [frames[k] for k in np.unique(np.linspace(0, len(frames) - 1, _SAMPLES).astype(int))]
    image = Image.fromarray(np.concatenate(chosen)).quantize(255, method=Image.Quantize.MEDIANCUT)
    colours = np.reshape(image.getpalette() or [], (-1, 3))
    colours[colours.min(axis=1) > _WHITE] = 255  # Pillow looks colours up in coarse boxes, and the ground is white
    image.putpalette([int(level) for level in colours.ravel()])
    return image


def _write_mp4(frames: Iterator[Frame], path: Path, fps: float, ffmpeg: str) -> None:
    first = next(frames)
    height, width = first.shape[:2]
    command = [
        ffmpeg, "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}",
        "-r", f"{fps:g}", "-i", "-", "-an", "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(path),
    ]  # fmt: skip
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None and process.stderr is not None  # both are pipes; for the type checker
        try:
            for frame in itertools.chain([first], frames):
                process.stdin.write(frame.tobytes())
            process.stdin.close()
        except BrokenPipeError:
            pass
        words = " ".join(process.stderr.read().decode(errors="replace").split())
    if process.returncode:
        raise ValueError(f"format: ffmpeg could not write {path.name}: {words}")
