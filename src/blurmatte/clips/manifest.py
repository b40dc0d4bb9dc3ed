"""Manifest: an append-only record of the finished frames of a clip, from which a run is resumed.

Each line is a JSON object. The first has the hash of inputs and settings; a line that was cut off when
a run was killed is ignored, and its frame done again.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from blurmatte.errors import FileError

NAME = "manifest.jsonl"
_HASHED_BYTES = 1 << 20  # of the beginning and of the end of a file


@dataclass(frozen=True, eq=False)
class Manifest:
    """Lines of finished work, and the open file to which new ones are appended.

    Parameters
    ----------
    lines : list of dict
        Those of interrupted runs with the same hash.
    file : text file
    """

    lines: list[dict[str, Any]]
    file: TextIO

    def of_kind(self, kind: str) -> Iterator[dict[str, Any]]:
        """The values of the lines of one kind, in order."""
        return (line[kind] for line in self.lines if kind in line)

    def append(self, kind: str, value: Mapping[str, Any]) -> None:
        """Write one line at once."""
        self.file.write(json.dumps({kind: value}, ensure_ascii=False) + "\n")
        self.file.flush()


@contextmanager
def opened_manifest(folder: Path, key: str) -> Iterator[Manifest]:
    """The manifest of a folder; begun anew if it is of other inputs or settings.

    Raises
    ------
    FileError
        If it cannot be written.
    """
    path = folder / NAME
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lines = _read(path, key)
        if lines is None:
            path.write_text(json.dumps({"key": key}) + "\n", encoding="utf-8")
            lines = []
        else:  # without a line that was cut off
            whole = "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines)
            temporary = path.with_suffix(".new")
            temporary.write_text(json.dumps({"key": key}) + "\n" + whole, encoding="utf-8")
            os.replace(temporary, path)
        with path.open("a", encoding="utf-8", newline="\n") as file:
            yield Manifest(lines, file)
    except OSError as error:
        raise FileError(
            f"{path}: check the folder and the free disk space; it cannot be written "
            f"({error.strerror})"
        ) from error


def _read(path: Path, key: str) -> list[dict[str, Any]] | None:
    """The whole lines of a manifest with this key; None if there is none."""
    if not path.exists():
        return None
    text = path.read_text(encoding="utf-8").rpartition("\n")[0]
    try:
        head, *lines = (json.loads(line) for line in text.splitlines())
    except ValueError:
        return None
    return lines if head == {"key": key} else None


def key_of(paths: Iterable[Path], settings: Mapping[str, Any]) -> str:
    """Hash of input files and settings: their sizes, and what they begin and end with."""
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True, default=str).encode())
    for path in paths:
        size = path.stat().st_size
        digest.update(f"{path.name}:{size};".encode())
        with path.open("rb") as file:
            digest.update(file.read(_HASHED_BYTES))
            file.seek(max(size - _HASHED_BYTES, 0))
            digest.update(file.read(_HASHED_BYTES))
    return digest.hexdigest()
