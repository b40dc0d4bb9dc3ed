"""Names of image sequences: files with a number in their names, folders and patterns.

layer.####.exr and layer.%04d.exr have a number of at least four digits; layer.#.exr and layer.%d.exr
are written without leading zeros. Files that are read may have more leading zeros.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from glob import glob, has_magic
from itertools import pairwise
from math import gcd
from pathlib import Path

from blurmatte.errors import FileError
from blurmatte.formats import pictures_in

Source = str | Path | Sequence[str | Path]
_NUMBER = re.compile(r"#+|%(?:0(\d))?d")


@dataclass(frozen=True)
class Numbering:
    """File names of a sequence."""

    folder: Path
    # before, after: the name around the number
    before: str
    digits: int  # minimum number of digits
    after: str

    def name(self, number: int) -> str:
        """The name of one file."""
        return f"{self.before}{number:0{self.digits}d}{self.after}"

    def files(self) -> list[Path]:
        """The existing files, sorted by number; it may have more digits, as layer.000123.exr."""
        pattern = re.compile(
            rf"{re.escape(self.before)}(\d{{{self.digits},}}){re.escape(self.after)}"
        )
        inside = sorted(self.folder.iterdir()) if self.folder.is_dir() else []
        found: dict[int, Path] = {}
        for path in inside:
            match = pattern.fullmatch(path.name)
            if match is not None and path.is_file():
                exact = path.name == self.name(int(match[1]))
                found[int(match[1])] = path if exact else found.get(int(match[1]), path)
        return [found[number] for number in sorted(found)]


def numbering(path: Path) -> Numbering | None:
    """The numbering that a file name stands for; None without a number, FileError with several."""
    places = list(_NUMBER.finditer(path.name))
    if not places:
        return None
    if len(places) > 1:
        raise FileError(
            f"{path}: keep one number in the name, like ball.####.exr; it has {len(places)}"
        )
    (place,) = places
    digits = len(place[0]) if place[0].startswith("#") else int(place[1] or 1)
    return Numbering(path.parent, path.name[: place.start()], digits, path.name[place.end() :])


def source_paths(source: Source) -> list[Path]:
    """The files of a sequence, see `read_frames`, or one file; raises FileError if there are none."""
    if not isinstance(source, str | Path):
        paths = [Path(path) for path in source]
        if not paths:
            raise FileError("name a clip or pictures; there are no frames to read")
        return paths
    path = Path(source)
    numbers = None if path.exists() else numbering(path)
    if numbers is not None:
        found = numbers.files()
    elif path.is_dir():
        found = pictures_in(path)
        if not found:
            raise FileError(f"{path}: name a clip or pictures; the folder holds no pictures")
    elif has_magic(str(source)) and not path.exists():
        found = [p for p in map(Path, glob(str(source))) if is_visible(p)]
    else:
        return [path]
    if not found:
        raise FileError(f"{source}: name a clip or pictures; no file matches")
    return sorted(found, key=natural_order)


def is_visible(path: Path) -> bool:
    """False for hidden files, like the ._ files that macOS leaves on other disks."""
    return not path.name.startswith(".")


def picture_numbers(paths: Sequence[Path]) -> tuple[int, ...] | None:
    """Numbers of the pictures of a sequence: those in which alone their names differ.

    Of one picture the last number in its name. None if there is none, or it does not rise.
    """
    if len(paths) == 1:
        return tuple(int(text) for text in re.findall(r"\d+", paths[0].stem)[-1:]) or None
    names = [re.split(r"(\d+)", path.name) for path in paths]
    if len({(path.parent, len(n)) for path, n in zip(paths, names, strict=True)}) > 1:
        return None
    differing = [k for k, parts in enumerate(zip(*names, strict=True)) if len(set(parts)) > 1]
    if len(differing) != 1 or differing[0] % 2 == 0:
        return None
    numbers = tuple(int(parts[differing[0]]) for parts in names)
    return numbers if all(a < b for a, b in pairwise(numbers)) else None


def missing_numbers(numbers: Sequence[int]) -> Iterator[int]:
    """Numbers that are missing between those of a sequence, in units of their usual step."""
    known, step = set(numbers), gcd(*(b - a for a, b in pairwise(numbers)))
    return (n for n in range(numbers[0], numbers[-1], max(step, 1)) if n not in known)


def natural_order(path: Path) -> list[tuple[int, str]]:
    """A sort key that puts 10 after 9."""
    return [
        (int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", str(path))
    ]
