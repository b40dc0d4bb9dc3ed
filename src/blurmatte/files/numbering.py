"""Rows of files with a number in their names, as compositing programs write them.

layer.####.exr has a number of at least four digits there, and so has layer.%04d.exr; layer.#.exr and
layer.%d.exr have one without zeros in front.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from blurmatte.errors import FileError

_NUMBER = re.compile(r"#+|%(?:0(\d))?d")


@dataclass(frozen=True)
class Numbering:
    """Names of a row of files.

    Parameters
    ----------
    folder : Path
    before, after : str
        The name around the number.
    digits : int
        How many the number has at least.
    """

    folder: Path
    before: str
    digits: int
    after: str

    def name(self, number: int) -> str:
        """The name of one file."""
        return f"{self.before}{number:0{self.digits}d}{self.after}"

    def files(self) -> list[Path]:
        """Those that are there, by their number."""
        fits = re.compile(rf"{re.escape(self.before)}(\d+){re.escape(self.after)}")
        inside = self.folder.iterdir() if self.folder.is_dir() else ()
        numbers = (int(found[1]) for path in inside if (found := fits.fullmatch(path.name)))
        paths = (self.folder / self.name(number) for number in sorted(set(numbers)))
        return [path for path in paths if path.is_file()]


def numbering(path: Path) -> Numbering | None:
    """What the name of a file says of numbers; None if nothing.

    Raises
    ------
    FileError
        If there are several.
    """
    places = list(_NUMBER.finditer(path.name))
    if not places:
        return None
    if len(places) > 1:
        raise FileError(
            f"{path}: has {len(places)} places for a number in its name; leave one, like ball.####.exr"
        )
    (place,) = places
    digits = len(place[0]) if place[0].startswith("#") else int(place[1] or 1)
    return Numbering(path.parent, path.name[: place.start()], digits, path.name[place.end() :])
