"""The program `qocjax`: commands by name, and completion in a shell."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import qocjax
from qocjax.commands import program
from qocjax.commands.completion import completion
from qocjax.config import conf_dir


def told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *given: str) -> tuple[int, str, str]:
    """Exit status, output and errors of the program."""
    monkeypatch.setattr(sys, "argv", ["qocjax", *given])
    try:
        program.main()
        code = 0
    except SystemExit as end:
        code = int(end.code or 0)
    return code, *capsys.readouterr()


def test_every_command_is_listed_with_its_question(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = told(monkeypatch, capsys)
    assert (code, err) == (0, "")
    commands = sorted(path.stem for path in conf_dir().glob("*.yaml"))
    assert sorted(program.questions()) == commands
    for name, question in program.questions().items():
        assert question.endswith("?") and len(question) < 90 and question in out
        assert any(line.split()[:1] == [name] for line in out.splitlines())


def test_version(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert told(monkeypatch, capsys, "--version") == (0, f"qocjax {qocjax.__version__}\n", "")


@pytest.mark.parametrize(
    ("given", "line"),
    [
        (["swep"], "error: command: got swep, expected one of sweep, advise, .* compare; did you mean sweep\\?\n"),
        (["kappa=2"], "error: command: got kappa=2, expected one of .* compare\n"),
        (["--completion"], "error: --completion: got nothing, expected one of bash, zsh\n"),
        (["--completion", "fish"], "error: --completion: got fish, expected one of bash, zsh\n"),
    ],
)
def test_wrong_words_end_in_one_line(
    given: list[str], line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = told(monkeypatch, capsys, *given)
    assert (code, out) == (2, "")
    assert re.fullmatch(line, err)


def test_a_command_takes_what_its_module_takes(tmp_path: Path) -> None:
    start = [sys.executable, "-c", "from qocjax.commands.program import main; main()"]
    done = subprocess.run([*start, "sweep", "loop.tau=-1"], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", "error: tau: got -1.0, expected > 0\n")


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_a_shell_completes_commands_options_and_choices(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    expected = {
        "qocjax sw": "sweep",
        "qocjax --com": "--completion",
        "qocjax fleet loop.hold": "loop.hold= loop.hold_decay= loop.hold_timeout=",
        "qocjax fleet key=3 controller=": "apf",
        "qocjax fleet delay@network.comp": "network.compute=",
        "qocjax fleet hydra.run.dir=mi": "mine",
        "qocjax fleet network=nothing": "",
        "qocjax nothing ": "",
    }
    calls = [f"try {line!r}" for line in expected]
    script = (
        completion("bash", ["fleet"]).replace('words="fleet ', 'words="sweep fleet ')
        + 'try() { COMP_LINE="$1"; COMP_POINT=${#1}; COMPREPLY=(); _qocjax; echo "${COMPREPLY[*]}"; }\n'
        + "\n".join(calls)
    )
    done = subprocess.run(["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True)
    assert done.stderr == ""
    assert dict(zip(expected, done.stdout.splitlines(), strict=True)) == expected
