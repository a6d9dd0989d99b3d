"""What cannot be printed: letters that an encoding lacks, readers that leave, closed streams, a full device."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from qocjax.commands.output import steady_output, written_too

ROOT = Path(__file__).parents[1]
HELP = "from qocjax.commands.program import main; main()"
STUDY = ["sweep=kappa", "sweep.grids.kappa=[1,2]", "sweep.deadline_ms=[200,400]", "sweep.seeds=2",
         "sweep.evaluation_seeds=2", "scenario.horizon=2", "loop.tau=0.1", "figures=false", "report=false"]  # fmt: skip


@contextmanager
def streams() -> Iterator[tuple[int, io.BytesIO]]:
    """Standard output on a pipe, whose reading end this gives, and standard error in memory."""
    reading, writing = os.pipe()
    err = io.BytesIO()
    with open(writing, "w", encoding="ascii") as out, pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(sys, "stdout", out)
        monkeypatch.setattr(sys, "stderr", letters := io.TextIOWrapper(err, encoding="cp1252"))
        yield reading, err
    letters.detach()


def test_letters_that_an_encoding_lacks_are_written_plainly() -> None:
    with streams() as (reading, err), steady_output():
        print("F(Δ) = 1 ± 0.1 at τ, κ² → 漢 \udcff")
        print("Δ ± ä", file=sys.stderr)
    with open(reading, "rb") as pipe:
        written = pipe.read()
    assert written.decode() == "F(Delta) = 1 +/- 0.1 at tau, kappa^2 -> \\u6f22 \\udcff\n"
    assert err.getvalue().decode("cp1252").split() == ["Delta", "±", "ä"]


def test_a_reader_that_leaves_is_let_go() -> None:
    with streams() as (reading, err), steady_output():
        os.close(reading)
        print("x" * 100_000)
        print("more", flush=True)
    assert err.getvalue() == b""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_device_is_told_of(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    with open("/dev/full", "w", encoding="utf-8") as full:
        monkeypatch.setattr(sys, "stdout", full)
        with steady_output():
            print("a page")
    note = "note: not all could be printed: No space left on device; files are complete\n"
    assert capsys.readouterr().err == note


def test_streams_that_python_does_not_have(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", None)
    with steady_output():
        sys.stderr.write("a progress bar")
        print("a page", flush=True)
    assert sys.stdout is None


def shell(command: str, **more: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "JAX_PLATFORMS": "cpu", "P": sys.executable} | more
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", command], env=environment, capture_output=True, text=True, errors="replace"
    )


@pytest.mark.skipif(os.name == "nt", reason="needs bash")
@pytest.mark.parametrize("end", ["| true", ">&- 2>&- <&-"])
def test_a_shell_that_closes_streams(end: str) -> None:
    done = shell(f'"$P" -c "{HELP}" {end}')
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize(
    "end", ["| head -1", "| true", ">&-", "2>&-", ">&- 2>&- <&-", ">/dev/full", "2>/dev/full", ">/dev/full 2>&1"]
)
@pytest.mark.parametrize("encoding", ["utf-8", "ascii", "cp1252"])
def test_a_study_is_whole_whatever_becomes_of_its_output(end: str, encoding: str, tmp_path: Path) -> None:
    done = shell(
        f'"$P" -m qocjax.sweep {" ".join(STUDY)} hydra.run.dir={tmp_path}/run {end}', PYTHONIOENCODING=encoding
    )
    assert done.returncode == 0 and "Traceback" not in done.stderr, done
    assert (tmp_path / "run" / "record.json").is_file() and (tmp_path / "run" / "policies.csv").is_file()


def test_what_is_printed_is_in_the_folder_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also where the command ends with an error; and nothing where nothing is printed."""
    with pytest.raises(KeyError), written_too(tmp_path / "page.txt"):
        print("Δ = 0.2 s")
        raise KeyError
    assert capsys.readouterr().out == (tmp_path / "page.txt").read_text(encoding="utf-8") == "Δ = 0.2 s\n"
    with written_too(tmp_path / "none.txt"):
        pass
    assert not (tmp_path / "none.txt").exists()
