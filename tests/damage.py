"""Files damaged at random, as disks, radios and interrupted copies do it; a seed gives the same damage again."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Damage:
    """What was done to a file."""

    content: bytes
    words: str
    spans: tuple[tuple[int, int], ...]  # of the whole file, that are not as they were


def _flip(content: bytes, rng: random.Random) -> Damage:
    changed, spans = bytearray(content), []
    for _ in range(rng.choice((1, 1, 2, 4, 8))):
        place = rng.randrange(len(changed))
        changed[place] ^= 1 << rng.randrange(8)
        spans.append((place, place + 1))
    return Damage(bytes(changed), f"flip {spans}", tuple(spans))


def _cut(content: bytes, rng: random.Random) -> Damage:
    place = rng.randrange(len(content))
    return Damage(content[:place], f"cut at {place}", ((place, len(content)),))


def _overwrite(content: bytes, rng: random.Random) -> Damage:
    size = min(rng.choice((1, 4, 16, 64, 512, 4096)), len(content))
    place = rng.randrange(len(content) - size + 1)
    fill = rng.choice((bytes(size), b"\xff" * size, rng.randbytes(size)))
    changed = content[:place] + fill + content[place + size :]
    return Damage(changed, f"overwrite {place} to {place + size}", ((place, place + size),))


def _drop(content: bytes, rng: random.Random) -> Damage:
    size = min(rng.choice((1, 7, 64, 1000)), len(content))
    place = rng.randrange(len(content) - size + 1)
    return Damage(
        content[:place] + content[place + size :], f"drop {place} to {place + size}", ((place, len(content)),)
    )


def _insert(content: bytes, rng: random.Random) -> Damage:
    place = rng.randrange(len(content))
    more = rng.randbytes(rng.choice((1, 8, 300)))
    return Damage(content[:place] + more + content[place:], f"insert {len(more)} at {place}", ((place, len(content)),))


_KINDS: tuple[Callable[[bytes, random.Random], Damage], ...] = (
    _flip,
    _flip,
    _cut,
    _overwrite,
    _overwrite,
    _drop,
    _insert,
)


def damaged(content: bytes, seed: int) -> Damage:
    """The damage of a seed."""
    rng = random.Random(seed)
    return rng.choice(_KINDS)(content, rng)
