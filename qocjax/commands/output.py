"""Standard output and error that never fail: what a terminal cannot show, or nobody reads, stops no study."""

from __future__ import annotations

import codecs
import errno
import functools
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO, cast

__all__ = ["steady_output", "written_too"]

_PLAIN = {
    "Δ": "Delta", "τ": "tau", "κ": "kappa", "η": "eta", "γ": "gamma", "ν": "nu", "ω": "omega", "φ": "phi", "±": "+/-",
    "×": "x", "·": "*", "−": "-", "–": "-", "…": "...", "²": "^2", "≥": ">=", "≤": "<=", "√": "sqrt", "→": "->",
}  # fmt: skip
_LETTERS = "qocjax.letters"


class _Steady:
    """A stream that takes whatever is written, also where it can no longer be handed on."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.lost: OSError | None = None

    def write(self, text: str) -> int:
        """Writes a text, or lets it go."""
        with self._kept():
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Hands on what was written."""
        with self._kept():
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    @contextmanager
    def _kept(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self.lost = self.lost or error
            self._to_nowhere()

    def _to_nowhere(self) -> None:
        """Has the rest, and what waits in buffers, go where it cannot fail."""
        with suppress(OSError, ValueError):  # a stream without a file
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)
            self._stream.flush()


@contextmanager
def steady_output() -> Iterator[None]:
    """Makes standard output and error such streams, with plain letters for those that they have not."""
    _open_closed()
    before, steady = (sys.stdout, sys.stderr), tuple(map(_steady, (sys.stdout, sys.stderr)))
    sys.stdout, sys.stderr = cast("tuple[TextIO, TextIO]", steady)
    try:
        yield
    finally:
        steady[0].flush()
        lost = steady[0].lost
        if lost is not None and lost.errno not in (errno.EPIPE, errno.EINVAL):  # of a reader that has seen enough
            sys.stderr.write(f"note: not all could be printed: {lost.strerror or lost}; files are complete\n")
        steady[1].flush()
        sys.stdout, sys.stderr = before


@contextmanager
def written_too(path: Path) -> Iterator[None]:
    """Keeps what is printed on standard output, letters as they are, in a file that is written in the end."""
    shown, kept = sys.stdout, io.StringIO()
    sys.stdout = cast(TextIO, _Both(shown, kept))
    try:
        yield
    finally:
        sys.stdout = shown
        if kept.getvalue():
            from qocjax.store.files import write_text  # with OmegaConf, which a program that starts does without

            write_text(path, kept.getvalue())


class _Both:
    """A stream that also keeps what is written to it."""

    def __init__(self, stream: TextIO, kept: io.StringIO) -> None:
        self._stream, self._kept = stream, kept

    def write(self, text: str) -> int:
        """Writes a text to both."""
        self._kept.write(text)
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _steady(stream: TextIO | None) -> _Steady:
    codecs.register_error(_LETTERS, _plain)
    stream = stream or _nowhere()
    with suppress(AttributeError, ValueError, OSError):  # of notebooks and tests
        cast(Any, stream).reconfigure(errors=_LETTERS)
    return _Steady(stream)


@functools.cache
def _nowhere() -> TextIO:
    """For as long as the process lives, as standard streams do."""
    return open(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8", closefd=False)


def _open_closed() -> None:
    """Opens streams that the shell has closed (`>&-`): the next files would take their numbers, and their output."""
    with suppress(OSError):
        while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
            os.set_inheritable(number, True)
        os.close(number)


def _plain(error: UnicodeError) -> tuple[str, int]:
    """Letters that an encoding lacks, in those that it has."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letters = error.object[error.start : error.end]
    return "".join(_PLAIN.get(each) or each.encode("ascii", "backslashreplace").decode() for each in letters), error.end
