"""Rows of pictures on the command line: patterns, numbers, folders."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from glob import glob
from pathlib import Path

import blurmatte as bm
from blurmatte.formats import is_clip, pictures_in

ROWS = "folder, ####, %04d, '*'"

_PARTS = re.compile(r"(\d+)|(\D+)")  # 10 is sorted after 9


def with_folders(paths: Sequence[Path], out: Path) -> list[tuple[Path, Path]]:
    """Each file and the folder for its results: `out` itself if there is but one."""
    if len(paths) == 1:
        return [(paths[0], out)]
    stems = [path.stem for path in paths]
    for stem in stems:
        if stems.count(stem) > 1:
            raise ValueError(f"give one file named {stem} at a time, got {stems.count(stem)}")
    return [(path, out / path.stem) for path in paths]


def pictures_of(texts: Iterable[str]) -> list[Path]:
    """The pictures that patterns and folders hold now, if any."""
    found: list[Path] = []
    for text in texts:
        with suppress(bm.errors.FileError):  # reading them says so
            found += _expanded(text)
    return found


def expanded(texts: Iterable[str]) -> list[Path]:
    """The files of these names, patterns (*, ####, %04d) and folders, each in the order of names."""
    return [path for text in texts for path in _expanded(text)]


def _expanded(text: str) -> list[Path]:
    path = Path(text)
    if path.is_dir():
        found = pictures_in(path)
    elif path.exists() or not _is_pattern(path):
        return [path]
    else:
        numbered = re.sub(r"#+|%\d*d", "[0-9]*", path.name)
        found = [Path(name) for name in glob(str(path.parent / numbered), recursive=True)]
    if not found:
        raise bm.errors.FileError(f"{text}: there are no such files; check the name or the pattern")
    return sorted(found, key=lambda p: [(int(n or 0), t) for n, t in _PARTS.findall(str(p))])


def given_files(images: Iterable[str], *others: str | Path | None) -> tuple[Path, ...]:
    """The files of images and options, each once; options may be values of other kinds."""
    paths = [*expanded(images), *(Path(one) for one in others if one is not None)]
    return tuple(dict.fromkeys(path for path in paths if path.is_file()))


def is_row(source: Path) -> bool:
    """Whether a clip or a row of files is meant, and not one picture or layer."""
    several = source.is_dir() or (_is_pattern(source) and not source.is_file())
    return several or is_clip(source)


def _is_pattern(path: Path) -> bool:
    return re.search(r"[#*?\[]|%\d*d", path.name) is not None or "*" in str(path)
