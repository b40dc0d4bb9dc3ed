"""Manifest: an append-only record of finished work, from which a run is resumed.

The work is the frames of a clip, or the pictures of a row. The first line has the hash of inputs and
settings. Each other line is a checksum and a JSON object. A line that is damaged, or was cut off when
a run was killed, is removed with all after it, and their work is done again.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib.metadata import version
from io import FileIO
from pathlib import Path
from typing import Annotated, Any, Generic, TypeVar
from zlib import crc32

import numpy as np
from pydantic import PlainValidator

from blurmatte.clips.table import FrameRecord, PictureRecord
from blurmatte.errors import FileError
from blurmatte.files.documents import parse_json, to_json
from blurmatte.motion.clip.detections import FrameSightings, Sighting
from blurmatte.motion.picture.motion import Motion
from blurmatte.trajectory import Trajectory

NAME = "manifest.jsonl"
_ARRAYS = "values", "covariance", "speeds", "speeds_std", "acceleration", "acceleration_covariance"
_HASHED_BYTES = 1 << 20  # of the beginning and of the end of a file


def _sightings(value: Any) -> FrameSightings | None:
    """The detections of a line, from what `to_json` wrote of them; ValueError if they are others."""
    if value is None:
        return None
    try:
        found = tuple(
            Sighting(**one | {"measured": _motion(one["measured"]), "box": tuple(one["box"])})
            for one in value["found"]
        )
        return FrameSightings(**value | {"found": found})
    except (KeyError, TypeError) as error:
        raise ValueError(f"must hold detections, got {error}") from error


def _motion(value: dict[str, Any]) -> Motion:
    """The same of a motion, whose fields are arrays and a trajectory."""
    arrays = {name: np.array(one, float) for name, one in value.items() if name in _ARRAYS and one}
    path = {"trajectory": Trajectory(**value["trajectory"])}
    tuples = {"size": tuple(value["size"]), "doubts": tuple(value["doubts"])}
    return Motion(**value | arrays | path | tuples)


@dataclass(frozen=True)
class Finished:
    """A line: a frame that is measured, the record of a layer, or names of layers without a record.

    That of a layer has what was measured in its solution.

    Parameters
    ----------
    shot : int
        Its number, from 1; 0 of names.
    seen : FrameSightings, optional
    layer : FrameRecord, optional
    files : tuple of str
        Layers in the same folder that are transparent, or that earlier runs wrote.
    """

    shot: int
    seen: Annotated[FrameSightings | None, PlainValidator(_sightings)] = None
    layer: FrameRecord | None = None
    files: tuple[str, ...] = ()

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of all layers of the line."""
        written = self.layer is not None and self.layer.layer
        return (*self.files, written) if written else self.files


@dataclass(frozen=True)
class FinishedPicture:
    """A line: a picture of a row that is solved.

    Parameters
    ----------
    key : str
        `key_of` the picture alone: a picture of other content is solved again, the others are not.
    record : PictureRecord
    """

    key: str
    record: PictureRecord


Line = TypeVar("Line", Finished, FinishedPicture)


@dataclass(frozen=True, eq=False)
class Manifest(Generic[Line]):
    """Finished work, and the open file to which more is appended.

    Parameters
    ----------
    finished : list of Finished or of FinishedPicture
        Of interrupted runs with the same hash, and of this one.
    replaced : list of Finished or of FinishedPicture
        Of the run with another hash that this one replaces.
    path : Path, optional
        For messages.
    file : FileIO, optional
        If there is none, nothing is written.
    """

    finished: list[Line] = field(default_factory=list)
    replaced: list[Line] = field(default_factory=list)
    path: Path | None = None
    file: FileIO | None = None

    def append(self, one: Line) -> None:
        """Write one line at once.

        Raises
        ------
        FileError
            If the disk is full.
        """
        self.finished.append(one)
        if self.file is not None and self.path is not None:
            with _reported(self.path):
                text = to_json(one).encode()
                self.file.write(_checksum(text) + text + b"\n")


@contextmanager
def opened_manifest(path: Path | None, key: str, kind: type[Line]) -> Iterator[Manifest[Line]]:
    """The manifest of this file; begun anew if it is of other inputs, settings or `kind` of lines.

    A file without finished work is removed at the end. Without a path nothing is kept.

    Raises
    ------
    FileError
        If it cannot be read or written.
    """
    if path is None:
        yield Manifest()
        return
    with _reported(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        same, found, size = _read(path, key, kind)
        file = path.open("ab", buffering=0)
    finished, replaced = (found, []) if same else ([], found)
    manifest = Manifest(finished, replaced, path, file)
    try:
        with file:
            with _reported(path):
                file.truncate(size if same else 0)
                if not same:
                    file.write(_head(key))
            yield manifest
    finally:
        if not manifest.finished:
            path.unlink(missing_ok=True)


def _head(key: str) -> bytes:
    """The first line."""
    return f"{to_json({'key': key})}\n".encode()


def _read(path: Path, key: str, kind: type[Line]) -> tuple[bool, list[Line], int]:
    """Whether a manifest has this key, its whole lines, and their size in bytes."""
    lines = list[Line]()
    if not path.exists():
        return False, lines, 0
    head, *rest = path.read_bytes().splitlines(keepends=True) or [b""]
    size = len(head)
    with suppress(ValueError):
        for line in rest:
            lines.append(_parsed(line, kind))
            size += len(line)
    return head == _head(key), lines, size


def _parsed(line: bytes, kind: type[Line]) -> Line:
    """The content of a line; ValueError if it was cut off, or is not what was written."""
    size = len(_checksum(b""))
    begin, text, end = line[:size], line[size:-1], line[-1:]
    if end != b"\n" or begin != _checksum(text):
        raise ValueError("the line is damaged")
    one: Line = parse_json(text.decode(), kind)
    return one


def _checksum(text: bytes) -> bytes:
    """Of a line, in hexadecimal digits, and a space."""
    return b"%08x " % crc32(text)


@contextmanager
def _reported(path: Path) -> Iterator[None]:
    """An OSError becomes a FileError that says what to do."""
    try:
        yield
    except OSError as error:
        raise FileError(
            f"{path}: check the folder and the free disk space; it cannot be read or written "
            f"({error.strerror})"
        ) from error


def key_of(paths: Iterable[Path], settings: Mapping[str, Any]) -> str:
    """Hash of input files and settings: their sizes, and what they begin and end with."""
    known = json.dumps([version("blurmatte"), settings], sort_keys=True, default=str)
    digest = hashlib.sha256(known.encode())
    for path in paths:
        size = path.stat().st_size
        digest.update(os.fsencode(f"{path.name}:{size};"))
        with path.open("rb") as file:
            digest.update(file.read(_HASHED_BYTES))
            file.seek(max(size - _HASHED_BYTES, 0))
            digest.update(file.read(_HASHED_BYTES))
    return digest.hexdigest()
