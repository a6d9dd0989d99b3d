"""Damage, as disks and editors do it: a few bytes of a valid file turned, cut, doubled, put in or overwritten."""

from __future__ import annotations

import numpy as np

__all__ = ["mutant"]

_ODD = (b"", b"\x00", b"\xff\xfe", b"\n", b",", b"-", b"1e999", b"nan", b'"', b"{", b"[" * 3000, b"9" * 400, b"<",
        b"\r", b"9" * 5000, b"inf", "ü".encode(), b"0x1", b"1_0")  # fmt: skip


def mutant(whole: bytes, seed: int) -> bytes:
    """A damaged copy; the seed tells how."""
    rng = np.random.default_rng(seed)
    found = bytearray(whole)
    for _ in range(int(rng.integers(1, 4))):
        size = len(found)
        at = int(rng.integers(0, max(size, 1)))
        end = min(at + int(rng.choice([1, 2, 8, 64, 512])), size)
        match int(rng.integers(0, 7)):
            case 0 if size:  # a bit turned over
                found[min(at, size - 1)] ^= 1 << int(rng.integers(0, 8))
            case 1:  # cut short
                del found[at:]
            case 2:  # a piece missing
                del found[at:end]
            case 3:  # a piece twice
                found[at:at] = found[at:end]
            case 4:  # overwritten
                found[at:end] = bytes(rng.integers(0, 256, end - at).astype(np.uint8))
            case 5:  # something odd put in
                found[at:at] = _ODD[int(rng.integers(0, len(_ODD)))]
            case _:  # a line elsewhere
                lines = bytes(found).split(b"\n")
                k, j = int(rng.integers(0, len(lines))), int(rng.integers(0, len(lines)))
                lines[k], lines[j] = lines[j], lines[k]
                found = bytearray(b"\n".join(lines))
    return bytes(found)
