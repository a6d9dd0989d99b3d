"""Configuration of `python -m qocjax.compare`."""

from __future__ import annotations

from pathlib import Path

from qocjax.config.part import Part

__all__ = ["CompareConfig"]


class CompareConfig(Part):
    """Everything that `python -m qocjax.compare` reads."""

    studies: list[str]
    names: list[str] | None
    figures: bool
    report: bool

    def build(self) -> dict[str, Path]:
        """Folders by the name of their study: the given one, or as much of the path as tells them apart.

        Raises:
            ValueError: Fewer than two folders, one twice, or names that do not fit.
        """
        folders = [Path(each) for each in self.studies]
        if len(folders) < 2:
            raise ValueError(f"studies: got {len(folders)}, expected at least two folders")
        places = [folder.resolve() for folder in folders]
        for folder, place in zip(folders, places, strict=True):
            if places.count(place) > 1:
                raise ValueError(f"studies: got {folder} twice, expected each study once")
        names = _short_names(places) if self.names is None else self.names
        if len(names) != len(folders) or len(set(names)) != len(names) or not all(name.strip() for name in names):
            raise ValueError(f"names: got {names}, expected {len(folders)} different names, one for each study")
        return dict(zip(names, folders, strict=True))


def _short_names(places: list[Path]) -> list[str]:
    """The ends of the paths, as long as needed to differ."""
    longest = max(len(place.parts) for place in places)
    for count in range(1, longest + 1):
        names = ["/".join(place.parts[-count:]) for place in places]
        if len(set(names)) == len(names):
            break
    return names
