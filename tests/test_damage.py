"""Damaged text files: the same result, one with findings or notes that account for it, or one line."""

from __future__ import annotations

import gzip
import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from logs import LOGS
from mutants import mutant
from tables import a_table

from qocjax.navigation import read_map
from qocjax.network import read_histogram, read_samples, read_trace
from qocjax.recorded.as_trace import read_file

FEW = 50  # mutants of each kind always, MANY with the slow tests
MANY = 500

Reader = Callable[[Path], Any]


def _file(path: Path) -> Any:
    run = read_file(path)
    loops = {name: each.table.to_numpy(dtype=object).tolist() for name, each in run.loops.items()}
    one_way = {name: each.tolist() for name, each in run.one_way.items()}
    poses = None if run.quality is None else run.quality.pose.tolist()
    return loops, one_way, poses, [str(each) for each in run.findings], run.findings.notes, run.format


def _trace(path: Path) -> Any:
    trace = read_trace(path, "rtt", "s", sequence="sequence", gaps_are_lost=True)
    return np.asarray(trace.delays).tolist(), trace.period


def _law(read: Callable[[Path], Any]) -> Reader:
    def values(path: Path) -> Any:
        law = read(path)
        return np.asarray(law.quantile(np.linspace(0.0, 1.0, 50))).tolist()

    return values


def _map(path: Path) -> Any:
    return read_map(path).cost.tolist()


def _table(kind: str) -> bytes:
    table = a_table(7).table.head(60)
    if kind == "csv":
        return table.to_csv(index=False, float_format="%.6f").encode()
    if kind == "json":
        return table.to_json(orient="records").encode()
    return table.to_json(orient="records", lines=True).encode()


def _parquet(folder: Path) -> bytes:
    a_table(7).table.head(60).to_parquet(folder / "whole.parquet")
    return (folder / "whole.parquet").read_bytes()


HISTOGRAM = "<histogram>\n" + "".join(f'<bin low="{k}.5 ms">{7 * k % 11}</bin>\n' for k in range(12)) + "</histogram>\n"
EMULATOR = [{"count": k, "lower_bound": k * 1000, "upper_bound": k * 1000 + 1000, "unit": "ns"} for k in range(8)]
POSES = "time,robot,x,y\n" + "".join(f"{0.1 * k:.1f},a,{0.05 * k:.2f},1.0\n" for k in range(40))
YAML = "image: map.pgm\nresolution: 0.1\norigin: [0, 0, 0]\noccupied_thresh: 0.65\nfree_thresh: 0.2\nnegate: 0\n"
IMAGE = b"P5 4 4 255\n" + bytes(range(0, 256, 16))


FILES: dict[str, tuple[str, bytes, Reader]] = {
    **{kind: (each.name, each.text.encode(), _file) for kind, each in LOGS.items()},
    "packed": ("ping.txt.gz", gzip.compress(LOGS["ping"].text.encode()), _file),
    "stamps": ("stamps.csv", _table("csv"), _file),
    "stamps in JSON": ("stamps.json", _table("json"), _file),
    "stamps in JSON lines": ("stamps.jsonl", _table("lines"), _file),
    "poses": ("poses.csv", POSES.encode(), _file),
    "trace": ("trace.csv", _table("csv"), _trace),
    "samples": ("samples.csv", _table("csv"), _law(lambda path: read_samples(path, "rtt", "s"))),
    "histogram": ("hist.xml", HISTOGRAM.encode(), _law(read_histogram)),
    "histogram in JSON": ("hist.json", json.dumps(EMULATOR).encode(), _law(read_histogram)),
    "map": ("map.yaml", YAML.encode(), _map),
    "image of a map": ("map.pgm", IMAGE, lambda path: _map(path.with_name("map.yaml"))),
}


def told(read: Reader, path: Path) -> tuple[str, Any, list[str]]:
    """What reading comes to: a result with what was warned of, or the one line of an error."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result: tuple[str, Any] = ("result", json.loads(json.dumps(read(path), default=str)))
        except ValueError as error:
            assert "\n" not in str(error).strip() and len(str(error)) < 3000, str(error)[:300]
            result = ("line", str(error))
    return *result, [str(each.message) for each in caught]


def accounts(found: tuple[str, Any, list[str]]) -> Any:
    """What a result says of what was found."""
    return found[1][3:5], found[2]


def rows(result: Any) -> int:
    """Loops or delays of a result."""
    return sum(len(each) for part in result[:2] for each in part.values())


def damage(kind: str, seeds: range, folder: Path) -> dict[str, int]:
    """Reads mutants of a file; how many came to what."""
    name, whole, read = FILES[kind]
    (folder / "map.pgm").write_bytes(IMAGE)
    (folder / "map.yaml").write_text(YAML)
    path = folder / name
    path.write_bytes(whole)
    sound = told(read, path)
    assert sound[0] == "result", sound
    counts = {"same": 0, "other": 0, "line": 0}
    for seed in seeds:
        path.write_bytes(mutant(whole, seed))
        found = told(read, path)
        counts["line" if found[0] == "line" else "same" if found == sound else "other"] += 1
        if kind in LOGS and kind != "fping -C" and found[0] == "result" and accounts(found) == accounts(sound):
            gone = rows(sound[1]) - rows(found[1])  # no more than lines that are gone
            assert gone <= max(whole.count(b"\n") - path.read_bytes().count(b"\n"), 0) + 1, f"{kind}, seed {seed}"
    return counts


@pytest.mark.parametrize("kind", FILES)
def test_a_few_damaged_files_end_in_a_result_or_a_line(kind: str, tmp_path: Path) -> None:
    assert sum(damage(kind, range(FEW), tmp_path).values()) == FEW


@pytest.mark.slow
@pytest.mark.parametrize("kind", FILES)
def test_many_damaged_files_end_in_a_result_or_a_line(kind: str, tmp_path: Path) -> None:
    counts = damage(kind, range(1000, 1000 + MANY), tmp_path)
    print(kind, counts)
    assert sum(counts.values()) == MANY and counts["line"] > 0


@pytest.mark.slow
def test_many_damaged_parquet_files(tmp_path: Path) -> None:
    FILES["parquet"] = ("stamps.parquet", _parquet(tmp_path), _file)
    assert sum(damage("parquet", range(MANY), tmp_path).values()) == MANY


@pytest.mark.parametrize("kind", LOGS)
def test_no_line_is_left_out_in_silence(kind: str, tmp_path: Path) -> None:
    """A line that cannot be read is counted, ends in an error, or said nothing of loops."""
    name, whole, read = FILES[kind]
    path = tmp_path / name
    path.write_bytes(whole)
    _, sound, _ = told(read, path)
    lines = whole.decode().split("\n")
    for k, line in enumerate(lines):
        if any(letter.isdigit() for letter in line):
            path.write_text(
                "\n".join([*lines[:k], line.replace("=", "~").replace(" ", "?", 1).replace(".", "!"), *lines[k + 1 :]])
            )
            state, found, _ = told(read, path)
            if state == "result" and found[:3] != sound[:3]:
                assert (found[3], found[4]) != (sound[3], sound[4]), f"line {k + 1}: {line}"
