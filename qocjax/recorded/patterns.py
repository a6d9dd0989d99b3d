"""Names with places for words, such as `/{robot}/cmd_vel` or `{qos}_{d_cfg_ms}ms*`: for topics, files and labels."""

from __future__ import annotations

import re
from functools import cache

__all__ = ["filled", "matched", "words"]

_PART = re.compile(r"\{([A-Za-z_]\w*)\}|(\*)")


@cache
def _compiled(pattern: str, deep: bool = False) -> re.Pattern[str]:
    text, place, named = "", 0, set()
    for part in _PART.finditer(pattern):
        text += re.escape(pattern[place : part.start()])
        place = part.end()
        name = part[1]
        if name in named:
            text += f"(?P={name})"
        else:
            text += f"(?P<{name}>{'.' if deep else '[^/]'}+?)" if name else "[^/]*"
            named |= {name} - {None}
    text += re.escape(pattern[place:])
    if "{" in re.sub(_PART, "", pattern):
        raise ValueError(f"pattern: got {pattern!r}, expected names in braces such as {{robot}}, each of letters and _")
    return re.compile(text)


def words(pattern: str) -> tuple[str, ...]:
    """Names of the places of a pattern, in order.

    Raises:
        ValueError: A brace is not closed, or holds no name.
    """
    return tuple(_compiled(pattern).groupindex)


def matched(pattern: str, text: str, *, deep: bool = False) -> dict[str, str] | None:
    """Words that a text has in the places of a pattern; None where it does not match as a whole.

    `{name}` stands for one or more characters but `/`, as few as possible, `*` for any number of them. With `deep`,
    `/` may be among those of `{name}`.

    Raises:
        ValueError: A brace is not closed, or holds no name.
    """
    found = _compiled(pattern, deep).fullmatch(text)
    return found.groupdict() if found else None


def filled(pattern: str, places: dict[str, str]) -> str:
    """The pattern with words put in their places; a place without a word becomes `*`."""
    return _PART.sub(lambda part: places.get(part[1], "*") if part[1] else "*", pattern)
