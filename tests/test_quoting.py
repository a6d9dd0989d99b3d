"""Names of files on a command line: as they are typed, whatever Hydra's grammar makes of them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from qocjax.commands.quoting import as_options, quoted_options

ROOT = Path(__file__).parents[1]
NAMES = ["a=b.csv", "a#b.csv", "läufe/ü.csv", "runs[1].csv", "[a].csv", "{x}.csv", "(1)/x.csv", "a,b.csv", "12", "1e3",
         "true", "it's.csv", 'a"b.csv', "a b.csv", "!x&y.csv", "😀.csv", "100%.csv", "x:y.csv", "*.csv", "a\\'b.csv",
         "日本/ログ.csv", "a;b|c.csv", "$x.csv", " a.csv"]  # fmt: skip


def values(*arguments: str) -> list[object]:
    """What Hydra makes of options after our hand."""
    parser = OverridesParser.create()
    found = [parser.parse_override(each).value() for each in quoted_options(arguments)]
    return [getattr(each, "text", each) for each in found]


@pytest.mark.parametrize("name", NAMES)
def test_a_name_comes_through_as_it_is(name: str) -> None:
    for option in ("path", "scenario.map", "network.path", "labels.file", "network.uplink.delay.path", "+a.path"):
        (found,) = values(f"{option}={name}")
        assert found.replace("\\'", "'") == name.replace("\\'", "'")


def test_a_tilde_is_the_home(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/someone")
    assert values("path=~/ping.csv", "path='~/ping.csv'", "resume=~/a#b") == [
        "/home/someone/ping.csv", "/home/someone/ping.csv", "/home/someone/a#b",
    ]  # fmt: skip
    assert values("studies=[~/a,'~/b']")[0] == ["/home/someone/a", "/home/someone/b"]
    assert quoted_options(["path=~nobody-of-that-name/x"]) == ["path='~nobody-of-that-name/x'"]


def test_what_hydra_understands_stays() -> None:
    kept = ["path=null", "path=${oc.env:HOME}/x", "path='a b'", "quality.goal=[2,0]", "~network", "-m", "experiment=ci",
            "delay@network.uplink.delay=gamma", "labels.pattern='{qos}_*'", "--help", "kappa=1,2",
            "--config-dir=/tmp/a b", "--info=all"]  # fmt: skip
    assert quoted_options(kept) == kept
    assert quoted_options(["-m", "path=a.csv,b.csv"]) == ["-m", "path=a.csv,b.csv"]
    assert values("network.column=delay(ms)", "labels.pattern={qos}/delay_{d}") == ["delay(ms)", "{qos}/delay_{d}"]


def test_a_list_of_studies_may_be_longer_than_a_name() -> None:
    line = f"studies=[{'a' * 300},{'b' * 300}]"
    assert as_options([line]) == [line]


ONE_BY_ONE = """
import sys
from qocjax.ingest import main
for k, name in enumerate(sys.argv[1:]):
    sys.argv = ["qocjax.ingest", f"path={name}", "figures=false", f"hydra.run.dir=~/out # {k}"]
    main()
"""


def test_the_command_line_takes_any_name(tmp_path: Path) -> None:
    names = ["~/a=b#[1].csv", "läufe/ü (1), 2.csv"]
    (tmp_path / "läufe").mkdir()
    for name in ("a=b#[1].csv", names[1]):
        (tmp_path / name).write_text("icmp_seq,rtt_ms\n1,20\n2,21\n")
    environment = os.environ | {"HOME": str(tmp_path), "PYTHONPATH": str(ROOT), "JAX_PLATFORMS": "cpu"}
    line = [sys.executable, "-c", ONE_BY_ONE, *names]
    done = subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, encoding="utf-8", timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("2 loops, 0 lost") == 2
    assert len(list(tmp_path.glob("out # */summary.csv"))) == 2


@pytest.mark.skipif(shutil.which("unshare") is None, reason="needs unshare")
def test_a_user_without_a_home(tmp_path: Path) -> None:
    (tmp_path / "ping.csv").write_text("icmp_seq,rtt_ms\n1,20\n2,21\n")
    tmp_path.chmod(0o777)
    keep = {name: value for name, value in os.environ.items() if name not in ("HOME", "XDG_CACHE_HOME")}
    unshare = ["unshare", "-U", "--map-user=12345", "--map-group=12345"]
    if subprocess.run([*unshare, "true"], capture_output=True).returncode != 0:
        pytest.skip("no user namespaces here")
    line = [*unshare, sys.executable, "-m", "qocjax.ingest", "path=ping.csv", "figures=false"]
    keep |= {"PYTHONPATH": str(ROOT), "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(line, cwd=tmp_path, env=keep, capture_output=True, encoding="utf-8", timeout=120)
    assert done.returncode == 0, done.stderr
    assert "2 loops, 0 lost" in done.stdout
