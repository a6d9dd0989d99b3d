"""What `${...}` may ask for: a configuration is written with the results, and copies no variable but those allowed."""

from __future__ import annotations

import pytest
from omegaconf import OmegaConf
from omegaconf.errors import InterpolationResolutionError

from qocjax._conf import add_resolver
from qocjax.commands.resolvers import _variable, register_resolvers


@pytest.fixture(autouse=True)
def _guarded(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the guard in place, as commands put it; a secret beside it."""
    register_resolvers()
    monkeypatch.setenv("PASSWORD", "harmless")
    monkeypatch.setenv("QOCJAX_DATA", "/data")
    monkeypatch.delenv("QOCJAX_ALLOW_ENV", raising=False)


def resolved(text: str) -> object:
    return OmegaConf.create({"a": text}).a


@pytest.mark.parametrize(
    "text", ["${oc.env:PASSWORD}", "${oc.env:PASSWORD,x}", "x/${oc.env:HOME}", "${oc.decode:${oc.env:PASSWORD}}",
             "${oc.env:${oc.env:QOCJAX_NAME,PASSWORD}}"]
)  # fmt: skip
def test_variables_of_others_are_refused(text: str) -> None:
    with pytest.raises(InterpolationResolutionError, match=r"oc.env: got \w+, expected .* QOCJAX_ALLOW_ENV"):
        resolved(text)


def test_own_ones_and_those_that_a_user_allows_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    assert resolved("${oc.env:QOCJAX_DATA,x}/a") == "/data/a" and resolved("${oc.env:QOCJAX_NONE,x}") == "x"
    with pytest.raises(InterpolationResolutionError, match="got QOCJAX_NONE, which is not set"):
        resolved("${oc.env:QOCJAX_NONE}")
    monkeypatch.setenv("QOCJAX_ALLOW_ENV", "OTHER, PASSWORD")
    assert resolved("${oc.env:PASSWORD}") == "harmless"


def test_the_guard_is_what_commands_resolve_by() -> None:
    add_resolver("oc.env", lambda *_: "as it was")
    register_resolvers()
    with pytest.raises(ValueError, match="PASSWORD"):
        _variable("PASSWORD")
    with pytest.raises(InterpolationResolutionError):
        resolved("${oc.env:PASSWORD}")
