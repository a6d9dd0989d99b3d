"""Dask's TLS: who has no certificate of the authority is not let in; the options, refused in one line."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

pytest.importorskip("distributed")

from distributed import Client
from distributed.security import Security
from test_cluster import configured, same

from qocjax.cluster import DaskEngine
from qocjax.cluster.local import start_local
from qocjax.study.chunks import Part, Result, compute, plan

FILES = {"tls_ca": "cert.pem", "tls_cert": "cert.pem", "tls_key": "key.pem"}


def certified(folder: Path) -> dict[str, str]:
    """A certificate that is its own authority, made as docs/cluster.md says."""
    if shutil.which("openssl") is None:
        pytest.skip("needs openssl")
    folder.mkdir()
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=qocjax",
         "-keyout", folder / "key.pem", "-out", folder / "cert.pem"], check=True, capture_output=True,
    )  # fmt: skip
    return {option: str(folder / name) for option, name in FILES.items()}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tls_ca": "a.pem"}, "engine.tls_cert: got null beside other files, expected all three, or none"),
        ({"tls_cert": "a.pem", "tls_key": "a.pem"}, "engine.tls_ca: got null beside other files"),
        ({"tls_ca": "/no/a", "tls_cert": "/no/b", "tls_key": "/no/c"}, "engine.tls_ca: /no/a: no such file"),
        ({"tls": "temporary", "tls_ca": "a", "tls_cert": "b", "tls_key": "c"}, "engine.tls: got temporary beside"),
        ({"tls": "temporary", "address": "tls://10.0.0.1:8786"}, "engine.tls: got temporary beside engine.address"),
    ],
)
def test_what_contradicts_itself_is_one_line(options: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        DaskEngine(**options)  # type: ignore[arg-type]


def test_temporary_keys_need_a_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ValueError, match="engine.tls: got temporary without cryptography, expected `pip install"):
        DaskEngine(tls="temporary")


def test_no_more_workers_than_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("qocjax.cluster.local._cores", lambda: [0, 1])
    monkeypatch.setattr("qocjax.cluster.local.LocalCluster", lambda **options: options["n_workers"])
    for workers in (3, 10**6):
        with pytest.raises(ValueError, match=f"engine.workers: got {workers} processes .* at most the 2 cores here, or "
                                             "engine.oversubscribe=true"):  # fmt: skip
            start_local(workers, None, None)
    assert start_local(2, None, None)[0] == 2 and start_local(3, None, None, True)[0] == 3


@pytest.mark.slow
@pytest.mark.parametrize("made", ["files", "temporary"])
def test_only_who_has_the_keys_takes_part(made: str, tmp_path: Path) -> None:
    own = certified(tmp_path / "own") if made == "files" else {"tls": "temporary"}
    if made == "temporary":
        pytest.importorskip("cryptography")
    other = certified(tmp_path / "other")
    foreign = Security(require_encryption=True, tls_ca_file=other["tls_ca"], tls_client_cert=other["tls_cert"],
                       tls_client_key=other["tls_key"])  # fmt: skip
    problem = configured().build_problem()
    chunks = plan(problem, Part("selection", range(4)), 1e5)[:2]
    with DaskEngine(workers=1, **own) as engine:  # type: ignore[arg-type]
        found = {chunk.name: result for chunk, result in engine.run(problem, chunks)}
        assert engine._cluster is not None
        address = engine._cluster.scheduler_address
        assert address.startswith("tls://127.0.0.1:")
        for security, at in ((None, address.replace("tls://", "tcp://")), (foreign, address)):
            with pytest.raises((OSError, ValueError, TypeError, RuntimeError)):
                Client(at, security=security, timeout=3, set_as_default=False)
    for chunk in chunks:
        result = found[chunk.name]
        assert isinstance(result, Result)
        same(result, compute(problem, chunk))
