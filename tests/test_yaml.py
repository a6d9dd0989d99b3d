"""YAML of others: aliases that stand for more than there is, or for themselves, are one line wherever YAML is read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from qocjax._yaml import composed, plain
from qocjax.config.scale import given_scale
from qocjax.nav2.read import _points, read_params
from qocjax.navigation import read_map
from qocjax.recorded.metadata import read_metadata
from qocjax.scenario import Scenario
from qocjax.store.study_folder import command_of
from qocjax.study.results import open_results

# A billion values in 400 letters; harmless as long as nobody writes them out.
MANY = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 9)
)
MERGED = "a0: &a0 {x0: 1, y0: 1}\n" + "".join(
    f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 10)}], z{k}: 1}}\n" for k in range(1, 9)
)
ITSELF = "a: &a [1, *a]\n"


@pytest.mark.parametrize(("text", "words"), [(MANY, "far more"), (MERGED, "far more"), (ITSELF, "holds itself")])
def test_aliases_are_bounded(text: str, words: str) -> None:
    for read in (plain, composed, lambda text: composed(text, yaml.CSafeLoader)):
        with pytest.raises(ValueError, match=words):
            read(text)


def test_aliases_as_people_write_them_are_read() -> None:
    text = "defaults: &usual {rate: 20, gains: &gains [1, 2]}\nrobot: {<<: *usual, name: a}\nother: *gains\n"
    assert plain(text) == yaml.safe_load(text)
    assert plain("") is None and plain("[]") == []
    with pytest.raises(ValueError, match="expected at most 10"):
        composed("[1, 2, 3, 4, 5]", most=10)


def _metadata(path: Path) -> object:
    path.rename(path.parent / "metadata.yaml")
    return read_metadata(path.parent)


def _results(path: Path) -> object:
    (path.parent / "record.json").write_text("{}")
    (path.parent / "table.csv").write_text("a\n1\n")
    path.rename(path.parent / "config.yaml")
    return open_results(path.parent, "tune")


READERS: dict[str, Callable[[Path], object]] = {
    "map": read_map, "nav2": read_params, "metadata": _metadata, "results": _results,
    "scale": lambda path: given_scale("sweep", None, None, str(path), Scenario()),
}  # fmt: skip


@pytest.mark.parametrize("text", [MANY, MERGED, ITSELF], ids=["many", "merged", "itself"])
@pytest.mark.parametrize("reader", READERS)
def test_whoever_reads_yaml_ends_in_one_line(reader: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / "file.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"\.yaml") as caught:
        READERS[reader](path)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 500


def test_others_take_such_a_file_for_none(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text(MANY)
    assert command_of(tmp_path) is None
    assert _points(MANY) == [] == _points("[" * 1500)
