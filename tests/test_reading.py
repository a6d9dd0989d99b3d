"""Files of others: never waited for, never too large, and each decoder's errors in one line."""

from __future__ import annotations

import gzip
import os
import socket
import zlib
from pathlib import Path

import pytest

from qocjax._reading import check_regular, decoding, read_bytes, read_text


def test_what_is_no_regular_file_is_never_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "pipe")
    (tmp_path / "gone").symlink_to(tmp_path / "nowhere")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    cases = {"pipe": "is a named pipe", "link": "is a named pipe", ".": "is a folder", "gone": "no such file",
             "loop": "cannot be read: Too many levels of symbolic links"}  # fmt: skip
    for name, said in cases.items():
        for read in (check_regular, read_bytes, read_text):
            with pytest.raises(ValueError, match=said) as error:
                read(tmp_path / name)
            assert str(error.value).startswith(str(tmp_path / name)) and "\n" not in str(error.value)
    with pytest.raises(ValueError, match="/dev/zero: cannot be read: is a device, expected a regular file"):
        read_bytes("/dev/zero")
    with pytest.raises(ValueError, match="cannot be read: .*embedded null"):
        read_bytes("a\0b")


def test_a_socket_is_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # names of sockets are short
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("socket")
        with pytest.raises(ValueError, match="socket: cannot be read: is a socket"):
            read_text("socket")


def test_text_comes_in_utf_8_in_utf_16_and_packed(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    for content in ("rtt\n1\n".encode("utf-8-sig"), "rtt\r\n1\r\n".encode("utf-16"), gzip.compress(b"rtt\n1\n")):
        path.write_bytes(content)
        assert read_text(path) == "rtt\n1\n"
    path.write_bytes(b"rtt\n1\n\xff\n")
    with pytest.raises(ValueError, match=r"log.txt, line 3: is no text in UTF-8"):
        read_text(path)


def test_packed_files_are_bounded_by_their_size(tmp_path: Path) -> None:
    path = tmp_path / "bomb.csv.gz"
    path.write_bytes(gzip.compress(bytes(64 << 20)))
    with pytest.raises(ValueError, match=r"bomb.csv.gz: unpacks to more than \d+ MiB, expected a table or log"):
        read_bytes(path)
    whole = gzip.compress(b"rtt\n" * 1000)
    for damaged in (whole[:-12], whole[:-8] + b"\0\0\0\0" + whole[-4:], whole[:12] + b"\xff\xff" + whole[14:]):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"bomb.csv.gz: cannot be read as what gzip packed: "):
            read_bytes(path)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OverflowError("int too large to convert to float"), "a number in it is too large"),
        (RecursionError("maximum recursion depth exceeded"), "it is nested too deep"),
        (MemoryError(), "a size in it is beyond the memory"),
        (zlib.error("Error -3"), "its packing is damaged"),
        (EOFError("Compressed file ended"), "it ends early"),
        (KeyError("a"), "KeyError 'a'"),
        (ValueError("two\nlines"), "two lines"),
        (OSError(5, "Input/output error"), "Input/output error"),
        (ZeroDivisionError(), "ZeroDivisionError"),
    ],
)
def test_whatever_a_decoder_raises_is_one_line(error: Exception, said: str) -> None:
    with pytest.raises(ValueError) as raised, decoding("a.bin", "a bag"):
        raise error
    assert str(raised.value) == f"a.bin: cannot be read as a bag: {said}"


def test_what_is_already_told_passes() -> None:
    with pytest.raises(ValueError, match=r"^a.bin, line 3: odd$"), decoding("a.bin", "a bag"):
        raise ValueError("a.bin, line 3: odd")
    with pytest.raises(ImportError), decoding("a.bin", "a bag"):
        raise ImportError("no library")
    with pytest.raises(KeyboardInterrupt), decoding("a.bin", "a bag"):
        raise KeyboardInterrupt
