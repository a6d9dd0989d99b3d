"""Damaged maps: the same map, another one that the format allows, or one line. Never a traceback, and nothing waits."""

from __future__ import annotations

import os
import tracemalloc
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from damage import damaged
from PIL import Image

from qocjax.navigation import read_map
from qocjax.recorded.bags import open_bag, storage_files
from qocjax.recorded.findings import Findings

YAML = "image: {}\nresolution: 0.05\norigin: [-1.0, 2.5, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
PIXELS = np.where(np.random.default_rng(0).random((30, 40)) < 0.3, 0, 254).astype(np.uint8)


def _pgm(folder: Path) -> Path:
    (folder / "map.pgm").write_bytes(b"P5\n# made\n40 30\n255\n" + PIXELS.tobytes())
    return folder / "map.pgm"


def _plain(folder: Path) -> Path:
    (folder / "map.pgm").write_text("P2\n40 30\n255\n" + "\n".join(" ".join(map(str, row)) for row in PIXELS) + "\n")
    return folder / "map.pgm"


def _png(folder: Path) -> Path:
    Image.fromarray(PIXELS).save(folder / "map.png")
    return folder / "map.png"


def _yaml(folder: Path) -> Path:
    _pgm(folder)
    return folder / "map.yaml"


FORMATS: dict[str, Callable[[Path], Path]] = {"pgm": _pgm, "plain": _plain, "png": _png, "yaml": _yaml}
CHECKED = ("png",)  # every part of it has a checksum


def outcome(path: Path) -> np.ndarray | None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a key that is no map's is warned of
            found = read_map(path)
    except ValueError as error:
        assert str(error) and "\n" not in str(error), error
        return None
    return found.cost


def mutate(name: str, folder: Path, seeds: range) -> Counter[str]:
    file = FORMATS[name](folder)
    (folder / "map.yaml").write_text(YAML.format("map.png" if name == "png" else "map.pgm"))
    content, whole = file.read_bytes(), outcome(folder / "map.yaml")
    assert whole is not None and whole.shape == (30, 40)
    counts: Counter[str] = Counter()
    for seed in seeds:
        file.write_bytes(damaged(content, seed).content)
        got = outcome(folder / "map.yaml")
        equal = got is not None and got.shape == whole.shape and bool((got == whole).all())
        counts["refused" if got is None else "equal" if equal else "another map"] += 1
    assert name not in CHECKED or not counts["another map"], counts
    return counts


@pytest.mark.parametrize("name", FORMATS)
def test_damaged_maps_are_read_or_told(name: str, tmp_path: Path) -> None:
    assert mutate(name, tmp_path, range(50)).total() == 50


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_500_damaged_maps_of_each_format(name: str, tmp_path: Path) -> None:
    counts = mutate(name, tmp_path, range(1000, 1500))
    print(name, dict(counts))
    assert counts.total() == 500


@pytest.mark.parametrize(
    "text",
    [
        "[" * 5000, "{a: " * 3000, "image: map.pgm\nresolution: 1" + "0" * 5000, "? [1, 2]\n: 3\n",
        "image: \"a\\0b\"\n", YAML.format("m" * 5000), YAML.format("map.pgm").replace("0.05", "2001-99-99"),
        "image: !!python/object:os.x {}\n",
        YAML.format("map.pgm").replace("-1.0", "1e400"), YAML.format("map.pgm").replace("0.05", "1" + "0" * 400),
    ],
    ids=range(10),
)  # fmt: skip
def test_odd_yaml_is_one_line(text: str, tmp_path: Path) -> None:
    _pgm(tmp_path)
    (tmp_path / "map.yaml").write_text(text)
    assert outcome(tmp_path / "map.yaml") is None


def test_a_picture_that_unpacks_to_far_more_is_refused(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(YAML.format("map.pgm"))
    (tmp_path / "map.pgm").write_bytes(b"P5\n200000 200000\n255\n" + bytes(100))
    assert outcome(tmp_path / "map.yaml") is None


@pytest.mark.parametrize("kind", ["EPS", "TIFF", "GIF", "JPEG", "ICO"])
def test_pictures_of_other_formats_are_not_opened(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the file is called; that of EPS would start a program."""
    monkeypatch.setattr("PIL.EpsImagePlugin.Ghostscript", lambda *_, **__: pytest.fail("started a program"))
    (tmp_path / "map.yaml").write_text(YAML.format("map.pgm"))
    Image.fromarray(PIXELS).save(tmp_path / "map.pgm", format=kind)
    with pytest.raises(ValueError, match="map.pgm: is no PGM, PNG or BMP image that can be read"):
        read_map(tmp_path / "map.yaml")


def test_a_bitmap_is_the_same_map(tmp_path: Path) -> None:
    for name in ("map.pgm", "map.bmp"):
        Image.fromarray(PIXELS).save(tmp_path / name)
        (tmp_path / f"{name}.yaml").write_text(YAML.format(name))
    found, same = (read_map(tmp_path / f"{name}.yaml").cost for name in ("map.pgm", "map.bmp"))
    assert (found == same).all()


def test_a_picture_of_fractions_is_refused(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(YAML.format("map.pgm"))
    (tmp_path / "map.pgm").write_bytes(b"Pf\n2 2\n-1.0\n" + np.ones(4, "<f4").tobytes())
    with pytest.raises(ValueError, match=r"map.pgm: got a picture of fractions \(PFM\), expected 8 or 16 bits"):
        read_map(tmp_path / "map.yaml")


def test_a_large_map_takes_a_few_times_its_pixels(tmp_path: Path) -> None:
    """3000 x 3000 in bands whose edges fall within it, against its own pixels; NumPy tells what was allocated."""
    cells = np.where(np.random.default_rng(1).random((3000, 3000)) < 0.3, 0, 254).astype(np.uint8)
    (tmp_path / "map.yaml").write_text(YAML.format("map.pgm"))
    (tmp_path / "map.pgm").write_bytes(b"P5\n3000 3000\n255\n" + cells.tobytes())
    tracemalloc.start()
    try:
        found = read_map(tmp_path / "map.yaml").cost
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert (found == np.where(cells[::-1] == 0, 254, 0)).all()
    assert peak < 6 * cells.size, peak


def test_more_pixels_than_any_map_are_refused(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(YAML.format("map.pgm"))
    (tmp_path / "map.pgm").write_bytes(b"P5\n12500 12500\n255\n" + bytes(100))
    with pytest.raises(ValueError, match="map.pgm: has 12500 x 12500 pixels, expected at most 150 million"):
        read_map(tmp_path / "map.yaml")


def test_pipes_are_not_waited_for(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(YAML.format("map.pgm"))
    os.mkfifo(tmp_path / "map.pgm")
    assert outcome(tmp_path / "map.yaml") is None
    os.mkfifo(tmp_path / "pipe.yaml")
    assert outcome(tmp_path / "pipe.yaml") is None
    bag = tmp_path / "bag"
    bag.mkdir()
    for name in ("bag_0.mcap", "bag_1.db3", "metadata.yaml", "bag_2.mcap.zstd"):
        os.mkfifo(bag / name)
    assert storage_files(bag) == []
    for path in (bag, bag / "bag_0.mcap", bag / "bag_1.db3"):
        with pytest.raises(ValueError, match=r"holds no .db3 or .mcap file"):
            open_bag(path, Findings())
